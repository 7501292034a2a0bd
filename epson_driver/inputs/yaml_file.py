# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads YAML files as plain data. Errors are one sentence with the line.

Scalars follow YAML 1.2's core schema (https://yaml.org/spec/1.2.2/#103-core-schema), like ROS 2:
1e3 is a number. In contrast to YAML 1.1, 1:30 is not 90, 010 is not 8, yes is not true, and
2026-01-01 is not a date. Keys are strings. Features that these files do not need are rejected:
aliases (nine lines can expand to a billion values), tags, duplicate keys (YAML would use the
last), and deep nesting.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from epson_driver.inputs.files import MEGABYTE, read_file
from epson_driver.inputs.rules import DECIMAL, InputError, printable, shown

MAX_NESTING = 20
"""Maximum number of nesting levels. Files of this package have at most 5 levels."""

_Loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # ten times as fast, if available

_WORDS: dict[str, object] = {
    **dict.fromkeys(('', '~', 'null', 'Null', 'NULL')),
    **dict.fromkeys(('true', 'True', 'TRUE'), True),
    **dict.fromkeys(('false', 'False', 'FALSE'), False),
    **dict.fromkeys(('.nan', '.NaN', '.NAN'), float('nan')),
    **{
        sign + word: float(sign + 'inf')
        for sign in ('', '+', '-')
        for word in ('.inf', '.Inf', '.INF')
    },
}
_INTEGER = re.compile(r'[-+]?[0-9]+', re.ASCII)
_BASED = re.compile(r'0o[0-7]+|0x[0-9a-fA-F]+', re.ASCII)


def read_yaml(path: Path, *, largest: int = MEGABYTE, several: bool = False) -> Any:
    """Return the data of a YAML file of at most `largest` bytes.

    The data consists of mappings with string keys, lists, strings, numbers, true, false and None,
    without shared objects. `several`: use the first of several documents. If False, exactly one
    document is required. Raises InputError with the file and the line for anything else.
    """
    file = printable(path)
    content = read_file(path, largest)
    try:
        text = content.decode('utf-8-sig')  # with a byte order mark, or without
    except UnicodeDecodeError as error:
        line = content.count(b'\n', 0, error.start) + 1
        raise InputError(f'{file}: not YAML: line {line} is not UTF-8 text') from error
    try:
        return _built(text, several=several)
    except yaml.YAMLError as error:
        raise InputError(f'{file}: not YAML: {_sentence(error)}') from error
    except _WrongError as wrong:
        raise InputError(f'{file}: {wrong}') from None


def yaml_value(text: str, where: str) -> Any:
    """Return the value of a YAML text. `where`: the name of the value in an InputError."""
    try:
        return _built(text, several=False)
    except (yaml.YAMLError, _WrongError, UnicodeError) as error:
        why = _sentence(error) if isinstance(error, yaml.YAMLError) else error
        raise InputError(f'{where} = {shown(text)}: not YAML: {why}') from error


def yaml_line(path: Path, keys: Sequence[str]) -> int | None:
    """Return the line number, from 1, of a nested key in a file already read by `read_yaml`.

    If the key is missing, return the line of its deepest existing parent, or None if no parent
    exists.
    """
    try:
        node: Any = yaml.compose(read_file(path, MEGABYTE).decode('utf-8-sig'), Loader=_Loader)
    except (InputError, UnicodeDecodeError, yaml.YAMLError):  # the file has changed
        return None
    line = None
    for key in keys:
        pairs = node.value if isinstance(node, yaml.MappingNode) else ()
        result = [(item, value) for item, value in pairs if item.value == key]
        if not result:
            return line
        line, node = result[0][0].start_mark.line + 1, result[0][1]
    return line


class _WrongError(Exception):
    def __init__(self, event: Any, what: str) -> None:
        super().__init__(f'line {event.start_mark.line + 1}: {what}')


def _sentence(error: yaml.YAMLError) -> str:
    mark = getattr(error, 'problem_mark', None)
    problem = getattr(error, 'problem', None) or str(error)
    place = f'line {mark.line + 1}, column {mark.column + 1}: ' if mark is not None else ''
    return place + printable(' '.join(problem.split()))


class _Open:
    def __init__(self, value: dict[str, Any] | list[Any]) -> None:
        self.value = value
        self._key: str | None = None

    def take(self, value: Any, event: Any) -> None:
        """Add a value to its parent. A key is stored for the next value instead."""
        if isinstance(self.value, list):
            self.value.append(value)
        elif self._key is not None:
            self.value[self._key] = value
            self._key = None
        elif not isinstance(event, yaml.ScalarEvent):
            raise _WrongError(event, 'a mapping or a list cannot be a key')
        elif event.value in self.value:
            raise _WrongError(event, f'{shown(event.value)} occurs twice')
        else:
            self._key = event.value


def _built(text: str, *, several: bool) -> Any:
    """Build the value from the parser's events, without recursion."""
    result: Any = None
    levels: list[_Open] = []
    documents = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                if several:
                    break
                raise _WrongError(event, 'it must contain one document')
        elif isinstance(event, yaml.AliasEvent):
            raise _WrongError(event, f'*{event.anchor}: aliases are not supported')
        elif isinstance(event, yaml.ScalarEvent):
            value = _scalar(event)
            if levels:
                levels[-1].take(value, event)
            else:
                result = value
        elif isinstance(event, yaml.CollectionStartEvent):
            _no_tag(event)
            opened = _Open({} if isinstance(event, yaml.MappingStartEvent) else [])
            if levels:
                levels[-1].take(opened.value, event)
            else:
                result = opened.value
            levels.append(opened)
            if len(levels) > MAX_NESTING:
                raise _WrongError(event, f'nested more than {MAX_NESTING} levels deep')
        elif isinstance(event, yaml.CollectionEndEvent):
            levels.pop()
    return result


def _no_tag(event: Any) -> None:
    if event.tag is not None and event.tag != '!':
        raise _WrongError(event, f'{shown(event.tag)}: tags are not supported')


def _scalar(event: Any) -> Any:
    _no_tag(event)
    text: str = event.value
    if not event.implicit[0]:  # in quotes, or a block of text
        return text
    if text in _WORDS:
        return _WORDS[text]
    try:
        if _INTEGER.fullmatch(text):
            return int(text)
        if _BASED.fullmatch(text):
            return int(text, 0)
    except ValueError:  # more digits than Python reads
        raise _WrongError(event, f'{shown(text)}: has too many digits for a number') from None
    return float(text) if DECIMAL.fullmatch(text) else text
