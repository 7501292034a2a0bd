# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Functions whose value follows from their arguments alone, and how numbers become text."""

import math
import re
from collections.abc import Callable
from typing import Any

from epson_driver.spel.errors import ErrorNumber, SpelError
from epson_driver.spel.values import DOUBLE, LONGEST_STRING, SINGLE, Array, Point, overflow

_NUMBER = re.compile(
    r'\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|&[hH][0-9a-fA-F]+|&[bB][01]+)'
)
_MOST_ELEMENTS = 200


def text_of(value: object, kind: str) -> str:
    """Return a value as Print shows it: Real with 7 digits, Double with 15."""
    if isinstance(value, float):
        return number_text(value, 7 if kind == SINGLE else 15)
    return str(value)


def number_text(value: float, digits: int = 15) -> str:
    """Return a number: from 1e14 on as 1.000000E+014."""
    if abs(value) >= 1e14:
        mantissa, exponent = f'{value:.6E}'.split('E')
        return f'{mantissa}E{int(exponent):+04d}'
    text = f'{value:.{digits}g}'
    if 'e' not in text:
        return text
    mantissa, exponent = text.split('e')
    return f'{mantissa}E{int(exponent):+04d}'


def power(base: float, exponent: float) -> float:
    """Return base ** exponent, always a Double. Raises SpelError."""
    try:
        result: float | complex = float(base) ** float(exponent)
    except OverflowError:
        raise overflow('Double', math.inf) from None
    if isinstance(result, complex):
        raise _bad('**', 'a negative number has no broken power')
    return result


def remainder(left: int, right: int) -> int:
    """Return Mod: with the sign of the left operand, as C has it."""
    if right == 0:
        raise ZeroDivisionError
    rest = abs(left) % abs(right)
    return -rest if left < 0 else rest


def _bad(name: str, text: str) -> SpelError:
    return SpelError(ErrorNumber.ARGUMENT, f'{name}: {text}')


def _signed(value: int, bits: int) -> int:
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def _shift(name: str, bits: int, left: bool) -> Callable[[int, int], int]:
    def shift(value: int, count: int) -> int:
        if not 0 <= count < bits:
            raise _bad(name, f'a shift by {count} is not in 0..{bits - 1}')
        value = _signed(value, bits)
        return _signed(value << count, bits) if left else value >> count

    return shift


def _bit(name: str, change: Callable[[int, int], int]) -> Callable[[int, int], int]:
    def bit(value: int, number: int) -> int:
        if not 0 <= number <= 31:
            raise _bad(name, f'bit {number} is not in 0..31')
        return change(_signed(value, 32), number)

    return bit


def _floor(value: float) -> int:
    return math.floor(value)


def _character(number: int) -> str:
    if not 1 <= number <= 255:
        raise _bad('Chr$', f'{number} is not in 1..255')
    return chr(number)


def _code(text: str) -> int:
    if not text:
        raise _bad('Asc', 'the string is empty')
    return ord(text[0])


def _length(name: str, count: int) -> int:
    if not 0 <= count <= LONGEST_STRING:
        raise _bad(name, f'{count} is not in 0..{LONGEST_STRING}')
    return count


def _mid(text: str, start: int, count: int = LONGEST_STRING) -> str:
    if start < 1:
        raise _bad('Mid$', f'position {start}: the first one is 1')
    return text[start - 1 : start - 1 + _length('Mid$', count)]


def _right(text: str, count: int) -> str:
    count = _length('Right$', count)
    return text[-count:] if count else ''


def _find(text: str, part: str) -> int:
    at = text.find(part)
    return at + 1 if at >= 0 else -1


def value_of(text: str) -> float:
    """Return the number that a text begins with, 0 without one. Raises SpelError."""
    found = _NUMBER.match(text)
    if found is None:
        return 0.0
    word = found[1]
    if word[0] == '&':
        return float(int(word[2:], 16 if word[1] in 'hH' else 2))
    number = float(word)
    if math.isinf(number):
        raise overflow('Double', number)
    return number


def _hex(value: int) -> str:
    return f'{value & 0xFFFFFFFF:X}'


def _format(value: float, pattern: str) -> str:
    """Return FmtStr$: 0 a digit, # one if there is any, a point."""
    found = re.fullmatch(r'([0#,]*)(?:\.([0#]*))?', pattern)
    if found is None:
        raise _bad('FmtStr$', f'{pattern[:40]!r} may have 0, # and one point only')
    whole, broken = found[1].replace(',', ''), found[2] or ''
    digits = f'{abs(value):.{len(broken)}f}'
    before, _, after = digits.partition('.')
    before = before.lstrip('0').rjust(whole.count('0'), '0')
    for sign in reversed(broken):
        if sign == '#' and after.endswith('0'):
            after = after[:-1]
        else:
            break
    text = before + ('.' + after if after or '.' in pattern else '')
    return '-' + text if value < 0 and float(digits) != 0.0 else text


def parse_string(text: str, into: Array, delimiters: str) -> int:
    """Cut a string at any of the delimiters into an array, resized; return how many there are."""
    parts = [text]
    if delimiters:
        parts = [part for part in re.split(f'[{re.escape(delimiters)}]', text) if part]
    if len(into.bounds) != 1:
        raise _bad('ParseStr', 'needs an array of one dimension')
    into.resize((max(len(parts[:_MOST_ELEMENTS]) - 1, 0),), keep=False)
    into.d[: len(parts)] = parts[:_MOST_ELEMENTS]
    return min(len(parts), _MOST_ELEMENTS)


def upper_bound(array: Array, dimension: int = 1) -> int:
    """Return the upper bound of a dimension, the first one being 1. Raises SpelError."""
    if not 1 <= dimension <= len(array.bounds):
        raise _bad('UBound', f'the array has no dimension {dimension}')
    return array.bounds[dimension - 1]


def _point(kind: str) -> Callable[..., Point]:
    def point(*values: float) -> Point:
        return Point(kind, tuple(float(value) for value in values))

    return point


def _xy(*values: float) -> Point:
    return Point('xy', (*(float(value) for value in values), *([0.0] * (6 - len(values)))))


VALUE_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'abs': abs,
    'int': _floor,
    'fix': math.trunc,
    'sgn': lambda value: (value > 0) - (value < 0),
    'sqr': math.sqrt,
    'sin': math.sin,
    'cos': math.cos,
    'tan': math.tan,
    'asin': math.asin,
    'acos': math.acos,
    'atan': math.atan,
    'atan2': lambda x, y: math.atan2(y, x),
    'degtorad': math.radians,
    'radtodeg': math.degrees,
    'lshift': _shift('LShift', 32, True),
    'rshift': _shift('RShift', 32, False),
    'lshift64': _shift('LShift64', 64, True),
    'rshift64': _shift('RShift64', 64, False),
    'bset': _bit('BSet', lambda value, bit: _signed(value | 1 << bit, 32)),
    'bclr': _bit('BClr', lambda value, bit: _signed(value & ~(1 << bit), 32)),
    'btst': _bit('BTst', lambda value, bit: value >> bit & 1),
    'len': len,
    'asc': _code,
    'chr$': _character,
    'left$': lambda text, count: text[: _length('Left$', count)],
    'mid$': _mid,
    'right$': _right,
    'instr': _find,
    'lcase$': str.lower,
    'ucase$': str.upper,
    'ltrim$': str.lstrip,
    'rtrim$': str.rstrip,
    'trim$': str.strip,
    'space$': lambda count: ' ' * _length('Space$', count),
    'str$': lambda value: text_of(value, DOUBLE),
    'val': value_of,
    'hex$': _hex,
    'fmtstr$': _format,
    'parsestr': parse_string,
    'ubound': upper_bound,
    'xy': _xy,
    'ja': _point('angles'),
    'agltopls': _point('angles'),
    'pulse': _point('pulses'),
}
"""By name in lower case: those of functions.py that are worked out by 'value'."""
