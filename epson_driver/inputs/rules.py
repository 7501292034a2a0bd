# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules that a value keeps to, and the sentence for one that does not."""

import ipaddress
import math
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass
from reprlib import Repr
from typing import Any

MAX_SHOWN_CHARACTERS = 200
"""Characters of a value in a sentence; of a longer one the beginning and the end."""

MAX_JOINT_NAME_CHARACTERS = 100
"""Characters of a joint's name."""

MAX_HOST_CHARACTERS = 253
"""Characters of a host's name (RFC 1035)."""


class InputError(ValueError):
    """What was given cannot be used. The text is one sentence: where, the value, the rule."""


class _Shortened(Repr):
    """What `repr` gives, of bounded length and depth, and of any value."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = MAX_SHOWN_CHARACTERS
        self.maxlevel = 4
        self.maxlist = self.maxtuple = self.maxdict = 8

    def repr_int(self, value: int, level: int) -> str:
        """Return its digits, or their number where Python does not write so many."""
        try:
            return super().repr_int(value, level)
        except ValueError:
            return f'a number of {math.ceil(value.bit_length() * math.log10(2.0))} digits'

    def repr_dict(self, value: dict[Any, Any], level: int) -> str:
        """Return it in its own order."""
        if level <= 0 and value:
            return '{...}'
        items = list(value.items())
        pairs = [
            f'{self.repr1(key, level - 1)}: {self.repr1(held, level - 1)}'
            for key, held in items[: self.maxdict]
        ]
        return '{' + ', '.join(pairs + ['...'] * (len(items) > self.maxdict)) + '}'


def shown(value: object) -> str:
    """Return a value for a sentence: what `repr` gives, shortened in the middle."""
    text = _Shortened().repr(value)
    if len(text) <= MAX_SHOWN_CHARACTERS:
        return text
    return f'{text[: MAX_SHOWN_CHARACTERS // 2]}…{text[-MAX_SHOWN_CHARACTERS // 4 :]}'


def printable(text: object) -> str:
    """Return a text as one line that every terminal and log takes; odd characters are escaped."""
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
    """What a value must be: `read` returns what it stands for, or raises for any other."""

    read: Callable[[Any], Any]
    text: str

    def checked(self, value: object, where: str) -> Any:
        """Return what the value stands for. Raises InputError: where, the value, the rule."""
        try:
            return self.read(value)
        except (TypeError, ValueError, KeyError, OverflowError):
            raise InputError(f'{where} = {shown(value)}: {self.text}') from None


def number(low: float, high: float, unit: str = '') -> Rule:
    """Return the rule of a finite number within bounds; true and false are none."""

    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError
        if not low <= value <= high:  # nor is NaN
            raise ValueError
        return float(value)

    return Rule(read, f'must be a number from {low:g} to {high:g}{unit and " " + unit}')


def count(low: int, high: int) -> Rule:
    """Return the rule of a whole number within bounds; true and false are none."""

    def read(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise TypeError
        if not low <= value <= high:
            raise ValueError
        return value

    return Rule(read, f'must be a whole number from {low} to {high}')


def choice(*values: str | int) -> Rule:
    """Return the rule of one value out of several."""

    def read(value: Any) -> Any:
        if value not in values:
            raise ValueError
        return value

    return Rule(read, f'must be {" or ".join(map(str, values))}')


def list_of(rule: Rule) -> Rule:
    """Return the rule of a list, not empty, of which each value keeps to a rule."""

    def read(value: Any) -> list[Any]:
        if not isinstance(value, list) or not value:
            raise TypeError
        return [rule.read(each) for each in value]

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
    'must be a list of names that differ, each of letters, digits, _, - and /, not beginning with '
    f'a digit, of at most {MAX_JOINT_NAME_CHARACTERS} characters',
)
"""A dot is none of them: each name is a part of names of parameters."""

_LABEL = re.compile(r'[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?', re.ASCII)


def _host(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    if ':' in value:
        ipaddress.IPv6Address(value)
        return value
    name = value.encode('idna').decode('ascii')  # what the resolver does; UnicodeError: it cannot
    labels = name.removesuffix('.').split('.')
    if len(name) > MAX_HOST_CHARACTERS or not all(map(_LABEL.fullmatch, labels)):
        raise ValueError
    if labels[-1].isdecimal():  # no name ends so: a short form of an IPv4 address, or a mistake
        try:
            socket.inet_aton(value)
        except OSError:
            raise ValueError from None
    return value


HOST = Rule(
    _host,
    'must be an IP address or the name of a host: parts of 1 to 63 letters, digits and hyphens '
    'with dots between them',
)
"""What can be looked up; whether there is such a host is another question."""
