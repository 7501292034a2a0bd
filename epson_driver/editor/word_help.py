# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The syntax of SPEL+'s words in one line each, and their pages in EPSON's manual."""

import re
from functools import cache

from epson_driver.inputs import read_yaml
from epson_driver.share import share_path
from epson_driver.spel.commands import COMMANDS
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.words import CONSTANTS, FIRST, SPELLING, WORDS

MANUAL = 'SPEL+ Language Reference, RC+ 8.0'
_KINDS = {
    kind: name
    for names in (
        'n number, i integer, s text$, x value, p point, q point, v variable, a array()',
        't task, # #port',
    )
    for kind, name in (pair.split() for pair in names.split(', '))
}


@cache
def _syntax() -> dict[str, str]:
    table = read_yaml(share_path('config', 'spel', 'words.yaml'))['syntax']
    return {name.lower(): syntax for name, syntax in table.items()}


def _arguments(form: str) -> str:
    result = ''
    for place, kind in enumerate(form.split(',') if form else []):
        words = re.fullmatch(r'w\((.*)\)(\??)', kind)
        text = words[1] if words else _KINDS[kind.rstrip('?*')]
        text = f'{", " if place else ""}{text}{", …" if kind.endswith("*") else ""}'
        result += f'[{text}]' if kind[-1] in '?*' else text
    return result


def syntax_of(name: str) -> list[str]:
    key = name.lower()
    lines = []
    rule = COMMANDS.get(key)
    if key in _syntax():
        lines.append(_syntax()[key])
    elif rule is not None and not rule.form.startswith('@'):
        lines.append(f'{rule.name} {_arguments(rule.form)}'.rstrip())
    function = FUNCTIONS.get(key)
    if function is not None:
        arguments = _arguments(function.arguments)
        lines.append(f'{function.name}({arguments})' if arguments else function.name)
    return lines


def word_help(name: str) -> str | None:
    key = name.lower()
    if key not in SPELLING:
        return None
    lines = ['```spel', *(syntax_of(name) or [SPELLING[key]] * (key in WORDS))]
    lines += [f'{SPELLING[key]} = {CONSTANTS[key]!r}'] if key in CONSTANTS else []
    word = WORDS.get(key)
    if word is None:
        return '\n'.join([*lines, '```'])
    notes = [f'{MANUAL}, page {word.page}'] if word.page is not None else []
    if word.since > FIRST:
        notes.append(f'since RC+ {".".join(map(str, word.since))}')
    if not word.background:
        notes.append('not in NoEmgAbort and background tasks')
    return '\n'.join([*lines, '```', '; '.join(notes)])
