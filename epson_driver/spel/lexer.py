# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Splits a line of SPEL+ into tokens."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

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


@dataclass(frozen=True, slots=True)
class Token:
    kind: str
    text: str
    position: Position
    value: int | float | str = ''

    @property
    def lower(self) -> str:
        return self.text.lower()


def tokens(text: str, file: str, line: int, column: int = 1) -> list[Token]:
    """Return the tokens of a line without its comment.

    Raises SyntaxProblem if the line is invalid.
    """
    if len(text) > LONGEST_LINE:
        where = Position(file, line, LONGEST_LINE)
        raise SyntaxProblem(where, 'the line is too long: RC+ takes 512 characters', 'line-length')
    result: list[Token] = []
    at = 0
    while at < len(text):
        position = Position(file, line, column + at)
        match = TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            raise SyntaxProblem(position, _unreadable(text[at]))
        kind, word = match.lastgroup, match.group()
        at = match.end()
        if kind in ('space', 'comment'):
            continue
        if kind == 'string':
            result.append(Token(STRING, word, position, word[1:-1]))
        elif kind in ('hex', 'binary', 'number'):
            result.append(Token(NUMBER, word, position, _number(kind, word, position)))
        else:
            result.append(Token(NAME if kind == 'name' else SYMBOL, word, position))
    return result


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
