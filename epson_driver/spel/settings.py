# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""spel.yaml, a file in a project's folder with settings that RC+ stores outside the project.

RC+ stores these settings in the controller or in its system configuration. `KEYS` is the table of
keys for the file and for the option --set.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from epson_driver.inputs import (
    InputError,
    Rule,
    count,
    near_name,
    number,
    printable,
    read_yaml,
    shown,
    yaml_line,
    yaml_value,
)
from epson_driver.spel.errors import SETTINGS_FILE
from epson_driver.spel.files import Answer
from epson_driver.spel.host import NetSettings
from epson_driver.spel.ranges import PORTS
from epson_driver.spel.words import WORDS

MAX_FRAMES = 15
"""Highest number of a tool or a local."""

_ENDS = {'CR': '\r', 'LF': '\n', 'CRLF': '\r\n'}
_COORDINATE = number(-1e6, 1e6)


@dataclass(frozen=True)
class Settings:
    """The settings of a project.

    * robot, controller: model of the robot and of the controller, or None if not set.
    * ports: settings of ports 201 to 216.
    * stubs: statement or function that is not simulated → its results, in order.
    * setup: statements to run before main.
    * source: the file that contains the settings, or `--set` if there is no file.
    """

    robot: str | None = None
    controller: str | None = None
    ports: Mapping[int, NetSettings] = field(default_factory=dict)
    stubs: Mapping[str, list[Answer]] = field(default_factory=dict)
    tools: Mapping[int, list[float]] = field(default_factory=dict)
    locals: Mapping[int, list[float]] = field(default_factory=dict)
    setup: str = ''
    source: str = ''

    @property
    def statements(self) -> str:
        frames = (
            f'{statement} {index}, XY({", ".join(f"{value:.9g}" for value in values)})'
            for statement, defined in (('TLSet', self.tools), ('Local', self.locals))
            for index, values in sorted(defined.items())
        )
        return '; '.join([*frames, *([self.setup] if self.setup else [])])


class Key(NamedTuple):
    """The rule for the value of a key.

    If the value is a mapping, `item` is the rule for its keys.
    """

    value: Rule
    item: Rule | None = None


def _index(low: int, high: int) -> Rule:
    return Rule(lambda text: count(low, high).read(int(text)), f'must be from {low} to {high}')


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable() or not value:
        raise ValueError
    return value


def _port(value: Any) -> NetSettings:
    result = re.fullmatch(r'([^:=\s]*):([0-9]{1,5})(?::(CRLF|CR|LF))?', value, re.IGNORECASE)
    if result is None:
        raise ValueError
    end = _ENDS[(result[3] or 'crlf').upper()]
    return NetSettings(result[1], count(1, 65_535).read(int(result[2])), end)


def _frame(value: Any) -> list[float]:
    if not isinstance(value, list) or len(value) not in (4, 6):
        raise TypeError
    return [float(_COORDINATE.read(item)) for item in value]


def _word(value: str) -> str:
    if value.split()[0].lower() not in WORDS:
        raise ValueError
    return value


def _answers(value: Any) -> list[Answer]:
    answers = value if isinstance(value, list) else [value]
    for answer in answers:
        for item in answer if isinstance(answer, list) else [answer]:
            if not (item is None or isinstance(item, int | float | str)):
                raise TypeError
    return answers


_FRAME = Rule(_frame, 'must be [X, Y, Z, U] or [X, Y, Z, U, V, W], mm and degrees')

KEYS = {
    'robot': Key(Rule(_text, 'must be a robot model, or a .yaml file')),
    'controller': Key(Rule(_text, 'must be a controller profile, or a .yaml file')),
    'ports': Key(Rule(_port, 'must be ADDRESS:PORT[:CR|:LF|:CRLF]'), _index(*PORTS)),
    'stubs': Key(
        Rule(_answers, 'must be a value, or a list of values and of lists of values'),
        Rule(_word, 'must be a word of SPEL+, or a word and its first argument'),
    ),
    'tools': Key(_FRAME, _index(1, MAX_FRAMES)),
    'locals': Key(_FRAME, _index(1, MAX_FRAMES)),
    'setup': Key(Rule(_text, 'must be one line of statements, separated by ;')),
}


def read_settings(
    folder: Path | None, overrides: Iterable[str] = (), **names: str | None
) -> Settings:
    """Return the settings of a folder's spel.yaml, if any, with the overrides KEY[.ITEM]=VALUE.

    `names`: further overrides by key, as plain texts, or None for no override. Raises InputError
    with the allowed values if a key or a value is invalid.
    """
    path = None if folder is None else folder / SETTINGS_FILE
    there = path is not None and (path.exists() or path.is_symlink())
    values = file_values(path) if path is not None and there else {}
    for text in overrides:
        name, _, value = text.partition('=')
        key, dot, item = name.partition('.')
        where = f'--set {printable(name)}'
        _add(values, where, key, item if dot else None, yaml_value(value, where))
    for key, given in names.items():
        if given is not None:
            _add(values, f'--{key}', key, None, given)
    return Settings(source=str(path) if there else '--set', **values)


def file_values(path: Path) -> dict[str, Any]:
    content = read_yaml(path)
    if content is not None and not isinstance(content, dict):
        raise InputError(f'{printable(path)}: must have lines KEY: VALUE, with {_keys()}')
    values: dict[str, Any] = {}
    for key, value in (content or {}).items():
        if key in KEYS and KEYS[key].item is not None and isinstance(value, dict):
            for item, one in value.items():
                _add(values, _where(path, key, item), key, item, one)
        else:
            _add(values, _where(path, key), key, None, value)
    for name in 'robot', 'controller':
        if str(values.get(name, '')).endswith('.yaml'):
            values[name] = str(path.parent / values[name])
    return values


def _add(values: dict[str, Any], where: str, key: str, item: str | None, value: Any) -> None:
    if key not in KEYS:
        near = near_name(key, KEYS)
        meant = f': did you mean {near}?' if near else ''
        raise InputError(f'{where}: must be one of {_keys()}{meant}')
    row = KEYS[key]
    if row.item is None and item is not None:
        raise InputError(f'{where}: {key} has no items')
    if row.item is None:
        values[key] = row.value.checked(value, where)
    elif item is None:
        rule = f'each item {row.item.text}, and each value {row.value.text}'
        raise InputError(f'{where} = {shown(value)}: must have lines ITEM: VALUE, where {rule}')
    else:
        try:
            name = row.item.read(item)
        except (ValueError, IndexError, TypeError):
            raise InputError(f'{where}: {printable(shown(item))} {row.item.text}') from None
        values.setdefault(key, {})[name] = row.value.checked(value, where)


def _where(path: Path, *keys: str) -> str:
    return f'{printable(path)}, line {yaml_line(path, keys)}: {printable(".".join(keys))}'


def _keys() -> str:
    return ', '.join(KEYS)
