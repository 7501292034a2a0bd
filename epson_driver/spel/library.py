# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Functions that depend on their arguments only, and conversion of numbers to text."""

import math
import re
from collections.abc import Callable
from datetime import datetime
from typing import Any

from epson_driver.spel.errors import bad
from epson_driver.spel.values import LONGEST_STRING, SINGLE, Array, Point, overflow

_NUMBER = re.compile(
    r'\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|&[hH][0-9a-fA-F]+|&[oO][0-7]+|&[bB][01]+)'
)
_MAX_ELEMENTS = 200


REAL_DIGITS, DOUBLE_DIGITS = 7, 15


def text_of(value: object, kind: str) -> str:
    """Return a value as Print displays it: a Real with 7 digits, a Double with 15."""
    if isinstance(value, float):
        return number_text(value, REAL_DIGITS if kind == SINGLE else DOUBLE_DIGITS)
    return value.printed if isinstance(value, Point) and value.kind == 'xy' else str(value)


def number_text(value: float, digits: int = DOUBLE_DIGITS) -> str:
    """Return the text of a number, such as 1.000000E+014 if it is large (SPEL+ manual p795)."""
    text = f'{value:.{digits}g}'
    if abs(value) < 1e14 and 'e' not in text:
        return text
    mantissa, exponent = f'{value:.6E}'.split('E')
    return f'{mantissa}E{int(exponent):+04d}'


def _string(value: float, digits: int = DOUBLE_DIGITS) -> str:
    """Return the result of `Str$`: a number as text.

    A whole number outside the range of Long is written with 7 digits, like a Real.
    """
    if isinstance(value, int) and abs(value) < 1 << 31:
        return str(value)
    return number_text(float(value), REAL_DIGITS if isinstance(value, int) else digits)


def power(base: float, exponent: float) -> float:
    try:
        result: float | complex = float(base) ** float(exponent)
    except OverflowError:
        raise overflow('Double', math.inf) from None
    if isinstance(result, complex):
        raise bad('**', 'a negative number has no fractional power')
    return result


def remainder(left: int, right: int) -> int:
    """Return `left Mod right`, which has the sign of `left`, as in C."""
    if right == 0:
        raise ZeroDivisionError
    rest = abs(left) % abs(right)
    return -rest if left < 0 else rest


_LARGEST_LONG, _LARGEST_UINT32 = 0x7FFF_FFFF, 0xFFFF_FFFF


def _on_bits(change: Callable[[int, int], int]) -> Callable[..., int]:
    """Return a function that applies `change` to the 32 bits of a Long or a UInt32."""

    def changed(value: int, number: int, unsigned: bool = False) -> int:
        if not ~_LARGEST_LONG <= value <= _LARGEST_UINT32:
            raise overflow('Long', value)
        bits = change(value & _LARGEST_UINT32, number) & _LARGEST_UINT32
        negative = bits > _LARGEST_LONG and not unsigned and value <= _LARGEST_LONG
        return bits - _LARGEST_UINT32 - 1 if negative else bits

    return changed


def _code(text: str) -> int:
    if not text:
        raise bad('Asc', 'the string is empty')
    return ord(text[0])


def _mid(text: str, start: int, count: int = LONGEST_STRING) -> str:
    return text[start - 1 : start - 1 + count]


def _right(text: str, count: int) -> str:
    return text[-count:] if count else ''


def _find(text: str, part: str) -> int:
    at = text.find(part)
    return at + 1 if at >= 0 else -1


def value_of(text: str) -> float:
    """Return the number at the start of a text, or 0. Raises SpelError if it exceeds Double."""
    result = _NUMBER.match(text)
    if result is None:
        return 0.0
    word = result[1]
    if word[0] == '&':
        return float(int(word[2:], {'h': 16, 'o': 8, 'b': 2}[word[1].lower()]))
    number = float(word)
    if math.isinf(number):
        raise overflow('Double', number)
    return number


def _hex(value: int) -> str:
    return f'{value & 0xFFFFFFFF:X}'


_DATE = re.compile(
    r'yyyy|yy|y|mmmm|mmm|mm|m|dddd|ddd|dd|d|hh|h|nn|n|ss|s|w|q|am/?pm|a/p', re.IGNORECASE
)
_DATES = ('%Y/%m/%d %H:%M:%S', '%Y/%m/%d', '%H:%M:%S')


def format_string(value: float | str, pattern: str) -> str:
    """Return the result of `FmtStr$`.

    `value` is a number, or a date or time as a string that `Date$` or `Time$` returns.
    """
    return _date(value, pattern) if isinstance(value, str) else _format(value, pattern)


def _date(text: str, pattern: str) -> str:
    """Format a date or a time.

    The pattern contains y, m, d, h, n (minutes), s, w (weekday, 1 is Sunday), q (quarter), AM/PM
    and A/P.
    """
    for layout in _DATES:
        try:
            date = datetime.strptime(text.strip(), layout)
        except ValueError:
            continue
        break
    else:
        raise bad('FmtStr$', f'{text[:40]!r} is not a date: yyyy/mm/dd hh:nn:ss')
    twelve = any(found[0][0] in 'aA' for found in _DATE.finditer(pattern))
    hour = (date.hour - 1) % 12 + 1 if twelve else date.hour
    half = 'AM' if date.hour < 12 else 'PM'
    shown = {
        'yyyy': f'{date:%Y}', 'yy': f'{date:%y}', 'y': f'{date.timetuple().tm_yday}',
        'mmmm': f'{date:%B}', 'mmm': f'{date:%b}', 'mm': f'{date:%m}', 'm': f'{date.month}',
        'dddd': f'{date:%A}', 'ddd': f'{date:%a}', 'dd': f'{date:%d}', 'd': f'{date.day}',
        'hh': f'{hour:02}', 'h': f'{hour}', 'nn': f'{date:%M}', 'n': f'{date.minute}',
        'ss': f'{date:%S}', 's': f'{date.second}', 'w': f'{date.isoweekday() % 7 + 1}',
        'q': f'{(date.month + 2) // 3}', 'AM/PM': half, 'ampm': half, 'am/pm': half.lower(),
        'A/P': half[0], 'a/p': half[0].lower(),
    }  # fmt: skip
    return _DATE.sub(lambda found: shown.get(found[0]) or shown[found[0].lower()], pattern)


def _format(value: float, pattern: str) -> str:
    """Format a number.

    The pattern contains 0 (digit), # (optional digit), a decimal point and commas. A comma at the
    end of the whole part divides by 1000. Other commas separate thousands.
    """
    result = re.fullmatch(r'([0#,]*?)(,*)(?:\.([0#]*))?', pattern)
    if result is None:
        rule = 'must contain only 0, #, commas and at most one point, with no comma after it'
        raise bad('FmtStr$', f'{pattern[:40]!r} {rule}')
    value /= 1000 ** len(result[2])
    whole, broken = result[1].replace(',', ''), result[3] or ''
    digits = f'{abs(value):.{len(broken)}f}'
    before, _, after = digits.partition('.')
    before = before.lstrip('0').rjust(whole.count('0'), '0')
    if ',' in result[1]:
        before = re.sub(r'(?<=\d)(?=(\d{3})+$)', ',', before)
    for sign in reversed(broken):
        if sign == '#' and after.endswith('0'):
            after = after[:-1]
        else:
            break
    text = before + ('.' + after if after or '.' in pattern else '')
    return '-' + text if value < 0 and float(digits) != 0.0 else text


def parse_string(text: str, into: Array, delimiters: str) -> int:
    """Split a text at delimiters into an array, which is resized.

    Return the number of parts.
    """
    parts = [text]
    if delimiters:
        parts = [part for part in re.split(f'[{re.escape(delimiters)}]', text) if part]
    if len(into.bounds) != 1:
        raise bad('ParseStr', 'needs an array of one dimension')
    into.resize((max(len(parts[:_MAX_ELEMENTS]) - 1, 0),), keep=False)
    into.d[: len(parts)] = parts[:_MAX_ELEMENTS]
    return min(len(parts), _MAX_ELEMENTS)


def upper_bound(array: Array, dimension: int = 1) -> int:
    if not 1 <= dimension <= len(array.bounds):
        raise bad('UBound', f'the array has no dimension {dimension}')
    return array.bounds[dimension - 1]


def _point(kind: str) -> Callable[..., Point]:
    def point(*values: float) -> Point:
        return Point(kind, tuple(float(value) for value in values))

    return point


def _xy(*values: float) -> Point:
    return Point('xy', (*(float(value) for value in values), *([0.0] * (6 - len(values)))))


VALUE_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'abs': abs,
    'int': math.floor,
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
    'lshift': _on_bits(lambda value, count: value << count),
    'rshift': _on_bits(lambda value, count: value >> count),
    'bset': _on_bits(lambda value, bit: value | 1 << bit),
    'bclr': _on_bits(lambda value, bit: value & ~(1 << bit)),
    'btst': _on_bits(lambda value, bit: value >> bit & 1),
    'len': len,
    'asc': _code,
    'chr$': chr,
    'left$': lambda text, count: text[:count],
    'mid$': _mid,
    'right$': _right,
    'instr': _find,
    'lcase$': str.lower,
    'ucase$': str.upper,
    'ltrim$': str.lstrip,
    'rtrim$': str.rstrip,
    'trim$': str.strip,
    'space$': lambda count: ' ' * count,
    'tab$': lambda count: '\t' * count,
    'lset$': lambda text, count: text.ljust(count)[:count],
    'rset$': lambda text, count: text.rjust(count)[:count],
    'str$': _string,
    'val': value_of,
    'hex$': _hex,
    'fmtstr$': format_string,
    'parsestr': parse_string,
    'ubound': upper_bound,
    'xy': _xy,
    'ja': _point('angles'),
    'agltopls': _point('angles'),
    'pulse': _point('pulses'),
}
"""Name of a SPEL+ function in lower case → Python function. These are the functions that
functions.py marks with 'value'."""
