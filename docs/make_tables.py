# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tables, lists and diagrams of the docs that come from code and data, no wider than 120 columns.

`make tables` writes them into the pages, between `<!-- made: NAME -->` and `<!-- end -->`. A test
compares the pages with the code.
"""

import re
import textwrap
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path
from xml.etree import ElementTree

import make_diagrams

from epson_driver.error_texts import NO_ERROR, load_error_texts
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.profiles.profile_rules import RULES
from epson_driver.remote_ethernet.client import MEANINGS
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.setup.table import TABLE, Row, joint_rows
from epson_driver.sim_controller.faults.fault_kinds import FAULTS, parameter_texts
from epson_driver.sim_controller.remote.remote_commands import COMMANDS as REMOTE_COMMANDS
from epson_driver.sim_controller.remote.sim_commands import SIM_COMMANDS
from epson_driver.spel.commands import COMMANDS
from epson_driver.spel.errors import ErrorNumber, meaning
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.lint import RULES as LINT_RULES
from epson_driver.spel.words import CONSTANTS

DOCS = Path(__file__).parent
WIDTH = 120
KINDS = {bool: 'bool', int: 'integer', float: 'double', str: 'string', list: 'array'}


def parameters() -> Iterator[str]:
    """Yield an item for each parameter. `<joint>` is a joint name."""
    for row in (*TABLE, *joint_rows('<joint>')):
        written = _written(row.default)
        kind = KINDS[type(row.default)]
        change = 'any time' if row.now else 'at start'
        about = ', '.join(filter(None, (kind, written and f'`{written}`', _allowed(row), change)))
        description = row.description.replace('<joint>', '`<joint>`')
        yield item(f'`{row.name}` ({about}): {description}')


def errors() -> Iterator[str]:
    """Yield an item for each error number."""
    for number, text in load_error_texts('epson').items():
        if number != NO_ERROR:
            doubt = '' if text.confirmed else ' (**not confirmed**)'
            remedy = f' → {text.remedy}' if text.remedy else ''
            yield item(f'`{number}`{doubt}: {text.meaning}{remedy}')


def spel_words() -> Iterator[str]:
    """Yield the supported words of SPEL+."""
    for kind, table in (('statements', COMMANDS), ('functions', FUNCTIONS)):
        names = sorted((rule.name for rule in table.values()), key=str.lower)
        yield item(f'{len(names)} {kind}: {", ".join(f"`{name}`" for name in names)}')
    yield item(f'{len(CONSTANTS)} constants: all of appendix D, and those of the force option')


def spel_rules() -> Iterator[str]:
    """Yield an item for each rule of the linter."""
    yield from (item(f'`{name}`: {text}') for name, text in LINT_RULES.items())


def spel_errors() -> Iterator[str]:
    """Yield an item for each error number of the interpreter."""
    yield from (item(f'`{number:d}`: {meaning(number)}') for number in ErrorNumber)


def keys() -> Iterator[str]:
    """Yield an item for each key of a controller profile."""
    yield from (item(f'`{key}`: {rule.text}') for key, rule in RULES.items())


def faults() -> Iterator[str]:
    """Yield an item for each fault of the simulated controller, with its parameters."""
    for name, kind in FAULTS.items():
        yield item(f'**`{name}`**: {kind.text}')
        for key, text in parameter_texts(kind).items():
            yield textwrap.indent(item(f'`{key}`: {text}', WIDTH - 2), '  ')


def remote_commands() -> Iterator[str]:
    """Yield the table of the commands of Remote Ethernet."""
    yield _row('command', 'what it does', 'accepted')
    yield _row('---', '---', '---')
    for name, command in REMOTE_COMMANDS.items():
        written = ','.join(part for part in (f'${name}', command.usage) if part)
        needs = ', '.join(need.text for need in command.requirements)
        yield _row(f'`{written}`', command.text, needs or 'always')


def remote_errors() -> Iterator[str]:
    """Yield an item for each error number of Remote Ethernet."""
    yield from (item(f'`{number:d}`: {text}') for number, text in MEANINGS.items())


def sim_commands() -> Iterator[str]:
    """Yield an item for each command that only the simulation has."""
    yield from (item(f'`$Sim,{row.usage}`: {row.text}') for row in SIM_COMMANDS.values())


def models() -> Iterator[str]:
    """Yield the table of the robot models."""
    quantities = ('range', 'speed', 'acceleration', 'pulses', 'origins')
    heads = ('range', 'speed', 'acceleration', 'encoder', 'chain')
    yield _row('model', 'kind', 'reach [mm]', 'payload [kg]', *heads)
    yield _row(*['---'] * (4 + len(heads)))
    for name in robot_models():
        model = load_robot_model(name)
        yield _row(
            f'[{name}](../config/robots/{name.partition("_")[0]}.yaml)',
            model.kind,
            f'{model.reach[0] * 1e3:.0f}',
            '' if model.payload is None else f'{model.payload:g}',
            *(_mark(model, quantity) for quantity in quantities),
        )


def _mark(model: RobotModel, quantity: str) -> str:
    result = model.provenance.get(quantity)
    mark = result.worst if result else 'not known'
    return {'confirmed': '', 'estimated': '**estimated**'}.get(mark, mark)


def approximate(profile: str) -> Iterator[str]:
    """Yield an item for each approximate value of a controller profile."""
    yield from map(item, load_controller_profile(profile).approximate)


def licences() -> Iterator[str]:
    """Yield the table of installed packages and their declared licences."""
    yield '# Licences of installed packages\n\n'
    yield 'As each Python package states it in the environment in which this site was built.\n\n'
    yield _row('package', 'version', 'licence')
    yield _row('---', '---', '---')
    packages = {
        distribution.metadata['Name'].lower(): distribution for distribution in distributions()
    }
    for _, package in sorted(packages.items()):
        yield _row(package.metadata['Name'], package.version, _licence(package))


def _licence(package: Distribution) -> str:
    """Return the licence of a package: expression, classifiers, field, or ROS manifest."""
    about = package.metadata
    classifiers = [
        element.rpartition(' :: ')[2]
        for element in about.get_all('Classifier') or ()
        if element.startswith('License :: ') and not element.endswith('OSI Approved')
    ]
    field = (about.get('License') or '').strip().partition('\n')[0]
    stated = about.get('License-Expression') or ', '.join(classifiers) or field
    if stated in ('', 'UNKNOWN'):
        manifests = [file for file in package.files or () if file.name == 'package.xml']
        roots = [ElementTree.parse(str(package.locate_file(file))) for file in manifests]  # noqa: S314
        result = {entry.text or '' for root in roots for entry in root.findall('license')}
        stated = ', '.join(sorted(result))
    return stated or 'not stated'


def item(text: str, width: int = WIDTH) -> str:
    """Return an item of a list, wrapped."""
    return (
        textwrap.fill(
            text,
            width,
            initial_indent='* ',
            subsequent_indent='  ',
            break_long_words=False,
            break_on_hyphens=False,
        )
        + '\n'
    )


def _row(*cells: str) -> str:
    return f'| {" | ".join(cells)} |\n'


def _written(default: object) -> str:
    if isinstance(default, list):
        return ', '.join(map(str, default))
    return str(default).lower() if isinstance(default, bool) else str(default)


def _allowed(row: Row) -> str:
    if row.choices:
        return ', '.join(row.choices)
    return '' if row.low is None else f'{row.low:g} … {row.high:g}'


MADE: dict[str, Callable[..., Iterable[str]]] = {
    'approximate': approximate,
    'controller': make_diagrams.condition,
    'errors': errors,
    'faults': faults,
    'keys': keys,
    'machines': make_diagrams.machines,
    'models': models,
    'parameters': parameters,
    'remote_commands': remote_commands,
    'remote_errors': remote_errors,
    'sim_commands': sim_commands,
    'spel_errors': spel_errors,
    'spel_rules': spel_rules,
    'spel_words': spel_words,
}
PART = re.compile(r'(?s)(<!-- made: (\w+) ?([^\n]*?) -->\n).*?(<!-- end -->\n)')


def with_tables(text: str) -> str:
    """Return a page with its generated parts up to date."""

    def part(found: re.Match[str]) -> str:
        start, name, arguments, end = found.groups()
        made = ''.join(MADE[name](*arguments.split())).strip()
        return f'{start}\n{made}\n\n{end}'

    return PART.sub(part, text)


def main() -> None:
    """Write the generated parts of all pages."""
    for page in DOCS.glob('*.md'):
        text = page.read_text('utf-8')
        if (new := with_tables(text)) != text:
            page.write_text(new, 'utf-8')
            print(f'{page.name} has new tables')


if __name__ == '__main__':
    main()
