# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/remote.md has the tables of the code."""

from pathlib import Path

from support.pages import items

from epson_driver.remote_ethernet.errors import MEANINGS
from epson_driver.sim_controller.remote.remote_commands import COMMANDS
from epson_driver.sim_controller.remote.sim_commands import SIM_COMMANDS
from epson_driver.sim_controller.remote.spel_functions import FUNCTIONS
from epson_driver.sim_controller.remote.spel_statements import MOTION_STATEMENTS, STATEMENTS
from epson_driver.sim_controller.remote.status_words import FLAGS

DOCS = Path(__file__).parents[1] / 'docs' / 'remote.md'
ESCAPED = r'\|'
"""How a | is written within a table."""


def section(heading):
    """Return the text under a heading."""
    return DOCS.read_text(encoding='utf-8').split(f'## {heading}\n')[1].split('\n## ')[0]


def rows(heading):
    """Return the cells of the table under a heading, but for its head."""
    lines = [line for line in section(heading).splitlines() if line.startswith('|')]
    return [tuple(cell.strip() for cell in line.strip('|').split(' | ')) for line in lines[2:]]


def usage(name, *rest):
    return '`' + ','.join(part for part in (name, *rest) if part) + '`'


def test_the_documented_commands_are_those_of_the_code():
    assert rows('Commands') == [
        (
            usage(f'${name}', command.usage),
            command.text,
            ', '.join(need.text for need in command.requirements) or 'always',
        )
        for name, command in COMMANDS.items()
    ]


def test_the_documented_simulation_commands_are_those_of_the_code():
    expected = [(f'{usage("$Sim", row.usage)}: {row.text}', []) for row in SIM_COMMANDS.values()]
    assert items(section('What only the simulation has')) == expected


def test_the_documented_statements_and_functions_are_those_of_the_code():
    expected = [(f'`{row.usage.replace("|", ESCAPED)}`', row.text) for row in STATEMENTS.values()]
    assert rows('Statements') == expected
    assert rows('Functions for Print') == [
        (
            f'`{name}`',
            row.text,
            str(row.most) if row.least == row.most else f'{row.least} or {row.most}',
        )
        for name, row in FUNCTIONS.items()
    ]
    text = DOCS.read_text(encoding='utf-8')
    assert all(f'`{name}`' in text for name in MOTION_STATEMENTS)


def test_the_documented_errors_and_flags_are_those_of_the_code():
    assert rows('Errors') == [(f'{number:d}', text) for number, text in MEANINGS.items()]
    assert [row[0] for row in rows('Flags of GetStatus')] == [f'`{name}`' for name in FLAGS]
