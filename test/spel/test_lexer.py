# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines as tokens."""

import pytest

from epson_driver.spel.errors import SyntaxProblem
from epson_driver.spel.lexer import tokens


def texts(line: str) -> list[str]:
    return [token.text for token in tokens(line, 'a.prg', 1)]


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        ('', []),
        ("  ' only a comment ; If \"", []),
        ('a=b<>c<=d>=e', ['a', '=', 'b', '<>', 'c', '<=', 'd', '>=', 'e']),
        ('a=<b=>c', ['a', '=<', 'b', '=>', 'c']),
        ('a$ = "it\'s; #1"+Chr$(34)\' e', ['a$', '=', '"it\'s; #1"', '+', 'Chr$', '(', '34', ')']),
        ('x=2**3*.5', ['x', '=', '2', '**', '3', '*', '.5']),
        ('WriteBin #201, b(), 4', ['WriteBin', '#', '201', ',', 'b', '(', ')', ',', '4']),
        ('Go P1 :Z(0) /L @1', ['Go', 'P1', ':', 'Z', '(', '0', ')', '/', 'L', '@', '1']),
        ('\tPrint 1;Print 2;\r', ['Print', '1', ';', 'Print', '2', ';']),
        ('_a1 = &H1F And &b101', ['_a1', '=', '&H1F', 'And', '&b101']),
    ],
)  # fmt: skip
def test_a_line_as_tokens(line: str, expected: list[str]) -> None:
    assert texts(line) == expected


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('0', 0),
        ('32768', 32_768),
        ('1.', 1.0),
        ('.25', 0.25),
        ('1e3', 1000.0),
        ('1.5E-3', 0.0015),
        ('&HFF', 255),
        ('&hffffffff', 0xFFFF_FFFF),
        ('&B1010', 10),
        ('18446744073709551616', 2**64),
        ('1234567890123456789012345', 1.2345678901234568e24),
    ],
)
def test_numbers_have_their_values(text: str, value: float) -> None:
    (token,) = tokens(text, 'a.prg', 1)
    assert (token.value, type(token.value)) == (value, type(value))


@pytest.mark.parametrize(
    ('line', 'column', 'said'),
    [
        ('Print "open', 7, 'the string has no end'),
        ('a = 3 % 4', 7, "'%' cannot stand here"),
        ('a = 1e999', 5, 'larger than a Double'),
        (f'a = 1{"0" * 500}', 5, 'too many digits'),
        ('x' * 6000, 5000, 'too long'),
        ('a = ö', 5, 'cannot stand here'),
    ],
)
def test_what_cannot_be_read_is_named_with_its_column(line: str, column: int, said: str) -> None:
    with pytest.raises(SyntaxProblem, match=r'a\.prg:7:') as caught:
        tokens(line, 'a.prg', 7)
    assert said in str(caught.value)
    assert caught.value.problem.position.column == column
