# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Values of a running program: types with their ranges, arrays, points, conversions."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from epson_driver.spel.errors import ErrorNumber, SpelError
from epson_driver.spel.functions import subject

INT: Final = 'i'
SINGLE: Final = 'f'
DOUBLE: Final = 'n'
STRING: Final = 's'
POINT: Final = 'p'
NUMBERS: Final = (INT, SINGLE, DOUBLE)

LONGEST_STRING = 255


class Type(NamedTuple):
    """A type of variables: kind of value, range of whole numbers, and initial value."""

    kind: str
    least: int = 0
    most: int = 0
    blank: int | float | str = 0


def _whole(bits: int, signed: bool) -> Type:
    half = 1 << (bits - 1)
    return Type(INT, -half, half - 1) if signed else Type(INT, 0, 2 * half - 1)


TYPES: dict[str, Type] = {
    'boolean': Type(INT, -1, 0),
    'byte': _whole(8, True),
    'ubyte': _whole(8, False),
    'integer': _whole(16, True),
    'short': _whole(16, True),
    'ushort': _whole(16, False),
    'long': _whole(32, True),
    'int32': _whole(32, True),
    'uint32': _whole(32, False),
    'int64': _whole(64, True),
    'uint64': _whole(64, False),
    'real': Type(SINGLE, blank=0.0),
    'double': Type(DOUBLE, blank=0.0),
    'string': Type(STRING, blank=''),
}

_WORDS = {'ubyte': 'UByte', 'ushort': 'UShort', 'uint32': 'UInt32', 'uint64': 'UInt64'}

Value = int | float | str


def type_word(name: str) -> str:
    return _WORDS.get(name, name.capitalize())


class Array:
    """An array: its elements `d` row by row, the upper bound of each dimension, and its type."""

    __slots__ = ('bounds', 'd', 'type')

    def __init__(self, type_name: str, bounds: tuple[int, ...]) -> None:
        self.type = type_name
        self.bounds = bounds
        self.d: list[Value] = [TYPES[type_name].blank] * size(bounds)

    def at(self, *indices: int) -> int:
        place = 0
        for index, bound in zip(indices, self.bounds, strict=True):
            if not 0 <= index <= bound:
                raise SpelError(ErrorNumber.INDEX, f'index {index} is not in 0..{bound}')
            place = place * (bound + 1) + index
        return place

    def resize(self, bounds: tuple[int, ...], keep: bool) -> None:
        """Change the upper bounds of all dimensions.

        With `keep`, elements that are within both the old and the new bounds keep their values.
        """
        old = Array.__new__(Array)
        old.bounds, old.d = self.bounds, self.d
        self.bounds = bounds
        self.d = [TYPES[self.type].blank] * size(bounds)
        if keep:
            for place in range(len(old.d)):
                indices = old.indices(place)
                if all(i <= b for i, b in zip(indices, bounds, strict=True)):
                    self.d[self.at(*indices)] = old.d[place]

    def indices(self, place: int) -> list[int]:
        """Return the index in each dimension of the element `d[place]`."""
        result = []
        for bound in reversed(self.bounds):
            place, index = divmod(place, bound + 1)
            result.append(index)
        return result[::-1]


def size(bounds: Sequence[int]) -> int:
    """Return the number of elements of an array with these upper bounds."""
    return math.prod(bound + 1 for bound in bounds)


@dataclass(frozen=True, slots=True)
class Point:
    """A point of the robot: six numbers, their kind, and flags for posture and local.

    * 'xy': x, y, z in mm and u, v, w in degrees.
    * 'angles': joint positions in degrees (or mm).
    * 'pulses': encoder pulses.
    """

    kind: str
    values: tuple[float, ...]
    flags: tuple[str, ...] = ()

    def flagged(self, flag: str) -> 'Point':
        """Return the point with a new flag, which replaces the flag for the same property."""
        others = (item for item in self.flags if subject(item) != subject(flag))
        return replace(self, flags=(*others, flag))

    def __str__(self) -> str:
        return f'{self.kind}({", ".join(f"{value:.3f}" for value in self.values)})'

    @property
    def printed(self) -> str:
        """The point as Print displays it (SPEL+ manual p166).

        Each coordinate has 12 characters.
        """
        shown = (
            f' {axis}:{value:9.3f}' for axis, value in zip('XYZUVW', self.values, strict=True)
        )
        local = next((flag for flag in self.flags if flag.isdigit()), '0')
        flags = [flag.upper() for flag in self.flags if not flag.isdigit()]
        return ''.join(shown) + ''.join(f' /{flag}' for flag in (*flags, local))


def single(value: float) -> float:
    """Return a value rounded to binary32. Raises SpelError if it exceeds Real."""
    try:
        rounded: float = struct.unpack('<f', struct.pack('<f', value))[0]
    except (OverflowError, struct.error):
        raise overflow('Real', value) from None
    return finite(rounded)


def finite(value: float) -> float:
    if value - value != 0.0:
        raise overflow('Double', value)
    return float(value)


def overflow(type_name: str, value: object) -> SpelError:
    return SpelError(ErrorNumber.OVERFLOW, f'{shown(value)} does not fit {type_word(type_name)}')


def too_long(text: str) -> SpelError:
    return SpelError(ErrorNumber.STRING_LENGTH, f'a string of {len(text)} characters')


def shown(value: object) -> str:
    if isinstance(value, int):
        return str(value) if abs(value) < 10**30 else 'a number of more than 30 digits'
    return f'{value:g}' if isinstance(value, float) else repr(value)[:40]


def nearest(value: float) -> int:
    """Return the nearest whole number, with halves rounded away from zero.

    Raises SpelError if the value is not finite.
    """
    if value - value != 0.0:
        raise overflow('Long', value)
    return math.floor(value + 0.5) if value >= 0 else math.ceil(value - 0.5)


def store(value: Value, type_name: str) -> Value:
    kind = TYPES[type_name]
    if kind.kind == STRING:
        text = str(value)
        if len(text) > LONGEST_STRING:
            raise too_long(text)
        return text
    if isinstance(value, str):
        raise SpelError(ErrorNumber.ARGUMENT, f'{value[:40]!r} is not a number')
    if type_name == 'boolean':
        return -1 if value else 0
    if kind.kind == INT:
        whole = value if isinstance(value, int) else nearest(value)
        if not kind.least <= whole <= kind.most:
            raise overflow(type_name, whole)
        return whole
    return single(value) if kind.kind == SINGLE else finite(value)
