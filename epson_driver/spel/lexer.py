# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Splits a line of SPEL+ into tokens."""

import math
import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from epson_driver.spel.errors import Position, SyntaxProblem

NAME: Final = 'name'
NUMBER: Final = 'number'
STRING: Final = 'string'
SYMBOL: Final = 'symbol'
END: Final = 'end of the line'

LONGEST_LINE = 5_000
"""Maximum number of characters in a line. RC+ accepts 512."""

_LONGEST_NUMBER = 400

TOKEN = re.compile(
    r"""
    (?P<space>[ \t\f\v\r\x1a\ufeff]+)
    | (?P<comment>'.*)
    | (?P<string>"[^"]*")
    | (?P<hex>&[hH][0-9a-fA-F]+)
    | (?P<binary>&[bB][01]+)
    | (?P<number>([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?)
    | (?P<name>[^\W\d]\w*\$?)
    | (?P<symbol>\*\*|<>|<=|>=|=<|=>|[-+*/=<>(),;:\#!@.])
    """,
    re.VERBOSE,
)
"""Matches one token, a comment or blanks. The name of the matching group is the kind."""


class Token(NamedTuple):
    """A token. `lower`: its text in lower case."""

    kind: str
    text: str
    lower: str
    position: Position
    value: int | float | str = ''


def tokens(text: str, file: str, line: int, column: int = 1) -> tuple[Token, ...]:
    """Return the tokens of a line without its comment.

    Raises SyntaxProblem if the line is invalid.
    """
    if len(text) > LONGEST_LINE:
        where = Position(file, line, LONGEST_LINE)
        raise SyntaxProblem(where, 'the line is too long: RC+ takes 512 characters', 'line-length')
    result: list[Token] = []
    at = 0
    for match in TOKEN.finditer(text):
        if match.start() != at:
            break
        kind, word = match.lastgroup, match.group()
        if kind not in ('space', 'comment'):
            position = Position(file, line, column + at)
            value: int | float | str = ''
            if kind == 'string':
                value = word[1:-1]
            elif kind not in ('name', 'symbol'):
                kind, value = NUMBER, _number(kind, word, position)
            result.append(Token(kind, word, word.lower(), position, value))
        at = match.end()
    if at < len(text):
        raise SyntaxProblem(Position(file, line, column + at), _unreadable(text[at]))
    return tuple(result)


def statements_in(line: str) -> Iterator[list[tuple[str, str, int]]]:
    """Yield the statements of a line, which may have errors.

    Parallel statements (`!…!`) are not split. A token is its kind, its text in lower case, and its
    column from 0.
    """
    statement: list[tuple[str, str, int]] = []
    parallel = False
    for match in TOKEN.finditer(line):
        kind, word = match.lastgroup or '', match.group().lower()
        parallel ^= word == '!'
        if word == ';' and not parallel:
            if statement:
                yield statement
            statement = []
        elif kind not in ('space', 'comment'):
            statement.append((kind, word, match.start()))
    if statement:
        yield statement


def _unreadable(character: str) -> str:
    if character == '"':
        return 'the string has no end: put a quote (") after it'
    if character == '$':
        return "unexpected '$': for memory bits, write MemSw, MemOn and MemOff (p544), without $"
    return f'unexpected {character!r}'


def _number(kind: str, word: str, position: Position) -> int | float:
    if len(word) > _LONGEST_NUMBER:
        raise SyntaxProblem(position, 'the number has too many digits')
    if kind == 'hex':
        return int('0x' + word[2:], 0)
    if kind == 'binary':
        return int('0b' + word[2:], 0)
    if word.isdigit() and len(word) < 25:
        return int(word)
    number = float(word)
    if math.isinf(number):
        raise SyntaxProblem(position, f'{word[:20]} is larger than a Double')
    return number
