# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules for values, and the error text for an invalid value."""

import ipaddress
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from reprlib import Repr
from typing import Any

MAX_SHOWN_CHARACTERS = 200
"""Maximum length of a value in an error text. A longer value is shortened in the middle."""

MAX_JOINT_NAME_CHARACTERS = 100

MAX_HOST_CHARACTERS = 253

MIN_LIKENESS = 0.8
"""Minimum similarity of a probable misspelling, as computed by difflib (1: identical)."""

MIN_RELATED = 0.6
"""Minimum similarity of a name that an error text suggests."""


ADDRESS = re.compile('add?ress|host(name)?')


def near_name(name: str, known: Iterable[str]) -> str | None:
    plain = {_plain(item): item for item in known}
    near = get_close_matches(_plain(name), plain, 1, MIN_LIKENESS)
    return plain[near[0]] if near else None


def near_names(name: str, known: Sequence[str]) -> list[str]:
    """Return all known names, sorted by their similarity to `name`."""
    near = get_close_matches(name.lower(), known, max(len(known), 1), 0.5)
    return [*near, *(item for item in known if item not in near)]


def meant(name: str, known: Iterable[str]) -> str:
    """Return the end of an error text: known names similar to `name`, or all known names."""
    known = list(known)
    alike = {_plain(item): item for item in known}
    plain = _plain(name)
    near = [item for item in known if plain and _plain(item).startswith(plain)]
    near = near or [alike[match] for match in get_close_matches(plain, alike, 2, MIN_RELATED)]
    return f'did you mean {" or ".join(near)}?' if near else f'must be {", ".join(known)}'


def _plain(name: str) -> str:
    return ADDRESS.sub('ip', name.replace('_', '').replace('-', '').lower())


class InputError(ValueError):
    """Invalid input. The text is one sentence with place, value and rule."""


class RobotError(RuntimeError):
    """A request failed. The text contains the reason and the remedy."""


class ArgumentError(RobotError, InputError):
    """A method was called with an invalid argument. Nothing was sent to the controller."""


class FileError(RobotError, OSError):
    """A file cannot be written."""


class _Shortened(Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = MAX_SHOWN_CHARACTERS
        self.maxlevel = 4
        self.maxlist = self.maxtuple = self.maxdict = 8

    def repr_int(self, value: int, level: int) -> str:
        """Return a number's digits, or the number of digits if Python refuses a conversion.

        Return their count if Python refuses to convert the number.
        """
        try:
            return super().repr_int(value, level)
        except ValueError:
            return f'a number of {math.ceil(value.bit_length() * math.log10(2.0))} digits'

    def repr_dict(self, value: dict[Any, Any], level: int) -> str:
        if level <= 0 and value:
            return '{...}'
        items = list(value.items())
        pairs = [
            f'{self.repr1(key, level - 1)}: {self.repr1(item, level - 1)}'
            for key, item in items[: self.maxdict]
        ]
        return '{' + ', '.join(pairs + ['...'] * (len(items) > self.maxdict)) + '}'


def shown(value: object) -> str:
    """Return a value's `repr` for an error text, shortened in the middle."""
    text = _Shortened().repr(value)
    if len(text) <= MAX_SHOWN_CHARACTERS:
        return text
    return f'{text[: MAX_SHOWN_CHARACTERS // 2]}…{text[-MAX_SHOWN_CHARACTERS // 4 :]}'


def printable(text: object) -> str:
    """Return a text as one printable line, with other characters escaped."""
    text = str(text)
    if text.isprintable():
        return text
    return ''.join(
        character
        if character.isprintable()
        else character.encode('unicode_escape', 'backslashreplace').decode()
        for character in text
    )


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule for a value. `read` returns the converted value, or raises an exception.

    `hint` returns a more precise text for an invalid value, or ''.
    """

    read: Callable[[Any], Any]
    text: str
    hint: Callable[[object], str] = lambda _: ''

    def text_for(self, value: object) -> str:
        return self.hint(value) or self.text

    def checked(self, value: object, where: str) -> Any:
        try:
            return self.read(value)
        except (TypeError, ValueError, KeyError, OverflowError):
            raise InputError(f'{where} = {shown(value)}: {self.text_for(value)}') from None

    def argument(self, value: object, name: str) -> Any:
        """Return the converted argument `name` of a public function, or raise ArgumentError."""
        try:
            return self.checked(value, name)
        except InputError as error:
            raise ArgumentError(str(error)) from None


def number(low: float, high: float, unit: str = '') -> Rule:
    """Return the rule for a finite number from `low` to `high`. It excludes true and false."""

    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError
        if not low <= value <= high:  # also rejects NaN
            raise ValueError
        return float(value)

    return Rule(read, f'must be a number from {low:g} to {high:g}{unit and " " + unit}')


DECIMAL = re.compile(r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?')


def decimal(text: str) -> float:
    """Return the finite number in a text of ASCII digits. Raises ValueError for any other text."""
    if not DECIMAL.fullmatch(text) or not math.isfinite(value := float(text)):
        raise ValueError(text)
    return value


def count(low: int, high: int) -> Rule:
    """Return the rule for a whole number from `low` to `high`. It excludes true and false."""

    def read(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise TypeError
        if not low <= value <= high:
            raise ValueError
        return value

    return Rule(read, f'must be a whole number from {low} to {high}')


def choice(*values: str | int) -> Rule:
    def read(value: Any) -> Any:
        if value not in values:
            raise ValueError
        return value

    return Rule(read, f'must be {" or ".join(map(str, values))}')


def list_of(rule: Rule) -> Rule:
    def read(value: Any) -> list[Any]:
        if not isinstance(value, list) or not value:
            raise TypeError
        return [rule.read(item) for item in value]

    return Rule(read, f'must be a list, of which each {rule.text}')


_JOINT_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_/-]*', re.ASCII)


def _joint_names(value: Any) -> tuple[str, ...]:
    names = tuple(value) if isinstance(value, list | tuple) else ()
    for name in names:
        if not _JOINT_NAME.fullmatch(name) or len(name) > MAX_JOINT_NAME_CHARACTERS:
            raise ValueError
    if not names or len(set(names)) != len(names):
        raise ValueError
    return names


JOINT_NAMES = Rule(
    _joint_names,
    'must be a list of unique names, each of letters, digits, _, - and /, not beginning with '
    f'a digit, of at most {MAX_JOINT_NAME_CHARACTERS} characters',
)
"""Rule for joint names. Dots are not allowed, because joint names are parts of parameter names."""

_FRAME_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*', re.ASCII)


def _frame_name(value: Any) -> str:
    if not _FRAME_NAME.fullmatch(value) or len(value) > MAX_JOINT_NAME_CHARACTERS:
        raise ValueError
    name: str = value
    return name


FRAME_NAME = Rule(
    _frame_name,
    'must be a word of letters, digits and _, not beginning with a digit, of at most '
    f'{MAX_JOINT_NAME_CHARACTERS} characters',
)

_LABEL = re.compile(r'[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?', re.ASCII)


def _host(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    if ':' in value:
        ipaddress.IPv6Address(value)
        return value
    name = value.encode('idna').decode('ascii')  # like the resolver (raises UnicodeError)
    labels = name.removesuffix('.').split('.')
    if len(name) > MAX_HOST_CHARACTERS or not all(map(_LABEL.fullmatch, labels)):
        raise ValueError
    if labels[-1].isdecimal():  # no host name ends in a number
        ipaddress.IPv4Address(value)  # no leading zeros, which the resolver reads as octal
    return value


_FOUR_NUMBERS = (
    'must be an IP address without leading zeros: four numbers from 0 to 255, such as 192.168.0.1'
)
_WITH_PORT = re.compile(r'(?:[a-z]+://)?([^/:\s]+)(?::[0-9]*)?(?:/.*)?', re.ASCII)


def _address_alone(value: object) -> str:
    found = _WITH_PORT.fullmatch(value) if isinstance(value, str) else None
    try:
        alone = _host(found and found[1])
    except (TypeError, ValueError):
        numbers = found and found[1].replace('.', '').isdecimal()
        return _FOUR_NUMBERS if numbers else ''
    return f'must be the address alone: {alone} (ports are separate settings)'


HOST = Rule(
    _host,
    'must be an IP address without leading zeros, or the name of a host: parts of 1 to 63 '
    'letters, digits and hyphens with dots between them',
    _address_alone,
)
"""Rule for a host. It checks only the syntax, not whether the host exists."""


def _variable(value: Any) -> str:
    if not isinstance(value, str) or (value and not (value.isascii() and value.isidentifier())):
        raise ValueError
    return value


VARIABLE = Rule(_variable, 'must be the name of an environment variable, not its value')
