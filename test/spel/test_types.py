# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Values: ranges, conversions, operators, strings, arrays."""

import pytest
from support.spel_harness import ScriptedHost, files, printed, run, value

from epson_driver.spel import ErrorNumber, Machine, ProgramError, SpelError, build


@pytest.mark.parametrize(
    ('expression', 'expected'),
    [
        ('1 + 2 * 3 ** 2', '19'),
        ('(1 + 2) * 3', '9'),
        ('-2 ** 2', '4'),
        ('2 ** -1', '0.5'),
        ('7 / 2', '3.5'),
        ('7 Mod 4 * 2', '7'),
        ('-7 Mod 4', '-3'),
        ('1 + 2 = 3', '-1'),
        ('3 <> 3', '0'),
        ('2 =< 2', '-1'),
        ('1 => 2', '0'),
        ('Not 1', '-2'),
        ('Not 1 = 2', '-1'),
        ('6 And 3', '2'),
        ('6 Or 3', '7'),
        ('6 Xor 3', '5'),
        ('1 Or 2 And 4', '1'),
        ('1 = 1 And 2 = 2 Xor True', '0'),
        ('True', '-1'),
        ('On + High', '2'),
        ('&HFF And &B101', '5'),
        ('"a" + "b" = "ab"', '-1'),
        ('"a" <> "A"', '-1'),
        ('1 / 3', '0.333333333333333'),
        ('1e14', '1.000000E+014'),
        ('1.5e-7', '1.500000E-007'),
        ('100000 * 100000', '10000000000'),
    ],
)
def test_operators_have_their_precedence(expression: str, expected: str) -> None:
    assert value(expression) == expected


RANGES = {
    'Byte': (-128, 127),
    'UByte': (0, 255),
    'Integer': (-32_768, 32_767),
    'Short': (-32_768, 32_767),
    'UShort': (0, 65_535),
    'Long': (-(2**31), 2**31 - 1),
    'Int32': (-(2**31), 2**31 - 1),
    'UInt32': (0, 2**32 - 1),
    'Int64': (-(2**63), 2**63 - 1),
    'UInt64': (0, 2**64 - 1),
}


@pytest.mark.parametrize('name', RANGES)
def test_integer_type_has_its_range(name: str) -> None:
    least, most = RANGES[name]
    body = f"""
    {name} x
    Int64 one
    one = 1
    x = {least}; Print x
    x = {most}; Print x
    OnErr GoTo failed
    x = x + one
    Print "no error"
    Exit Function
    failed:
    Print Err, x
    """
    assert printed(body) == [str(least), str(most), f'{ErrorNumber.OVERFLOW:d} {most}']


@pytest.mark.parametrize('name', RANGES)
def test_constant_out_of_range_is_a_build_error(name: str) -> None:
    most = RANGES[name][1]
    with pytest.raises(ProgramError, match=f'main.prg:3:7: error: {most + 1} does not fit {name}'):
        build(files(f'Function main\n  {name} x\n  x = {most + 1}\nFend\n'))


def test_real_is_binary32_and_double_is_binary64() -> None:
    body = """
    Real r; Double d
    r = 0.1; d = 0.1
    Print r = d, r, d
    OnErr GoTo failed
    r = 1e39
    failed:
    Print Err, Erl
    """
    assert printed(body) == ['0 0.1 0.1', f'{ErrorNumber.OVERFLOW:d} 6']


def test_reals_are_rounded_to_integers_with_halves_away_from_zero() -> None:
    assert printed('Integer a, b\na = 2.5; b = -2.5\nPrint a, b') == ['3 -3']


def test_strings_have_at_most_255_characters() -> None:
    body = """
    String s$
    Integer i
    OnErr GoTo failed
    For i = 1 To 300
      s$ = s$ + "x"
    Next
    failed:
    Print Err, Len(s$), i
    """
    assert printed(body) == [f'{ErrorNumber.STRING_LENGTH:d} 255 256']
    with pytest.raises(ProgramError, match='a string has at most 255 characters'):
        build(files(f'Function main\n  Print "{"x" * 256}"\nFend\n'))


def test_array_indices_range_from_0_to_the_upper_bound() -> None:
    body = """
    Integer a(3), b(1, 2), c(1, 1, 1), i
    a(0) = 5; a(3) = 6; b(1, 2) = 7; c(1, 1, 1) = 8; c(0, 1, 0) = 9
    Print a(0), a(1), a(3), b(1, 2), b(0, 2), c(1, 1, 1), c(0, 1, 0), UBound(b(), 2)
    Redim Preserve a(5)
    Print a(0), a(3), a(5), UBound(a)
    Redim a(1)
    Print a(0), UBound(a)
    Redim Preserve b(2, 3)
    Print b(1, 2)
    """
    assert printed(body) == ['5 0 6 7 0 8 9 2', '5 6 0 5', '0 1', '7']


@pytest.mark.parametrize('index', ['i', '-1 * i', 'i, 0', '0, i'])
def test_index_out_of_range_is_an_error_with_its_line(index: str) -> None:
    dimensions = '3, 3' if ',' in index else '3'
    source = f"""
    Function main
      Integer a({dimensions}), i
      i = 4
      a({index}) = 1
    Fend
    """
    (failure,) = run(source).failures
    assert (failure.number, failure.position.line) == (ErrorNumber.INDEX, 4)
    assert str(failure).startswith('main.prg:4: error 9992 in main (task 1): ')


@pytest.mark.parametrize(
    ('declaration', 'allowed'),
    [
        ('Function main\n Integer a(1999)\nFend', True),
        ('Function main\n Integer a(2000)\nFend', False),
        ('Function main\n Integer a(49, 39)\nFend', True),
        ('Function main\n String a$(199)\nFend', True),
        ('Function main\n String a$(200)\nFend', False),
        ('Integer a(99999)', True),
        ('Integer a(100000)', False),
        ('Global String a$(10000)', False),
        ('Global Preserve Long a(3999)', True),
        ('Global Preserve Long a(4000)', False),
        ('Global Preserve String a$(400)', False),
    ],
)
def test_array_size_is_limited_by_scope(declaration: str, allowed: bool) -> None:
    if allowed:
        build(files(declaration + '\n'))
        return
    with pytest.raises(ProgramError, match='elements; '):
        build(files(declaration + '\n'))


@pytest.mark.parametrize(
    ('statement', 'text'),
    [
        ('i = "a"', 'Integer cannot take a string'),
        ('s$ = 1', 'String cannot take a whole number'),
        ('s$ = i', 'String cannot take a whole number'),
        ('i = s$ + 1', 'has a string on one side and a whole number on the other'),
        ('r = r And 1', 'And needs whole numbers'),
        ('i = r Mod 2', 'Mod needs whole numbers'),
        ('i = Not r', 'Not needs a whole number'),
        ('i = s$ < s$', 'strings can be compared by = and <> only'),
        ('s$ = s$ - s$', '- does not take strings'),
        ('i = a', 'a is an array: it needs an index'),
        ('i(1) = 2', 'i is not an array'),
        ('i = i(1)', 'i is not an array'),
        ('a(1, 2) = 3', 'a has 1 dimensions, not 2'),
        ('a(-1) = 3', 'index -1 is below 0'),
        ('i = XY(1, 2, 3, 4)', 'Integer cannot take a point'),
        ('i = P1 + P2', 'cannot take a point'),
        ('i = nothing', 'unknown variable, constant or function nothing'),
        (
            'Go P1 +X50',
            'unknown variable, constant or function X50: the offset of a point is X(50)',
        ),  # p592
        ('i = nothing(1)', 'unknown function or array nothing'),
        ('nothing = 1', 'nothing is not a declared variable'),
        ('i = Sin(1, 2)', 'Sin takes 1 arguments, not 2'),
        ('i = Mid$("a")', 'Mid$ takes 2 to 3 arguments, not 1'),
        ('If s$ Then Print 1', 'must be a number, is a string'),
        ('For s$ = 1 To 2', 'For needs a variable that is a number'),
        ('byRefI(i)', 'byRefI takes 2 arguments, not 1'),
        ('byRefI(ByRef r, a())', 'n is Integer, not Real'),
        ('byRefI(ByRef i, i)', 'must be an array'),
        ('byRefI(ByRef 3, ByRef a())', 'ByRef needs a variable'),
        ('Redim i(3)', 'must be an array'),
        ('Redim a(1, 1)', 'cannot change the number of dimensions'),
    ],
)
def test_wrong_type_is_a_build_error(statement: str, text: str) -> None:
    source = f"""
    Function main
      Integer i, a(5)
      Real r
      String s$
      {statement}
    {'  Next' if statement.startswith('For') else ''}
    Fend
    Function byRefI(ByRef n As Integer, ByRef m() As Integer)
    Fend
    """
    with pytest.raises(ProgramError) as caught:
        build(files(source))
    assert str(caught.value).startswith('main.prg:5:')
    assert text in str(caught.value)


def test_only_preserved_globals_survive_a_restart() -> None:
    source = """
    Global Preserve Long g_kept, g_many(2)
    Global Long g_lost
    Function main
      g_kept = g_kept + 1
      g_many(1) = g_kept * 2
      g_lost = g_lost + 1
      Print g_kept, g_many(1), g_lost
    Fend
    """
    program, host = build(files(source)), ScriptedHost()
    first = Machine(program, host)
    for _ in range(2):
        first.start()
        first.advance(first.time + 1.0)
    second = Machine(program, host)
    second.restore(first.preserved())
    second.start()
    second.advance(1.0)
    assert host.printed == ['1 2 1\n', '2 4 1\n', '3 6 1\n']


@pytest.mark.parametrize(
    ('statement', 'typed', 'number', 'text'),
    [
        ('Input i', '40000', ErrorNumber.OVERFLOW, '40000 does not fit Integer'),
        ('Line Input s$', 'x' * 256, ErrorNumber.STRING_LENGTH, 'a string of 256 characters'),
        ('Input i', '1e999', ErrorNumber.OVERFLOW, 'inf does not fit Double'),
    ],
)
def test_input_must_match_the_variable_type(
    statement: str, typed: str, number: int, text: str
) -> None:
    source = f'Function main\n  Integer i\n  String s$\n  {statement}\n  Print "never"\nFend\n'
    host = ScriptedHost()
    host.typed = [typed]
    machine = Machine(build(files(source)), host)
    machine.start()
    machine.advance(1.0)
    (failure,) = host.failures
    assert (failure.number, failure.position.line, failure.text) == (number, 4, text)
    assert host.printed == []


def test_preserved_value_of_another_type_is_refused() -> None:
    source = 'Global Preserve Long g_kept\nFunction main\nFend\n'
    machine = Machine(build(files(source)), ScriptedHost())
    with pytest.raises(SpelError, match="'many' is not a number"):
        machine.restore({'g_kept': ['many']})
    assert machine.preserved() == {'g_kept': [0]}
