# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tokens, small programs with their output, and syntax errors with their messages."""

import pytest
from support.spel_harness import ScriptedHost, files, printed, run

from epson_driver.spel import Machine, ProgramError, build
from epson_driver.spel.errors import SyntaxProblem
from epson_driver.spel.lexer import tokens

DECLARED = 'Global Integer g_n\n'

PROGRAMS = {
    'if of several lines': (
        '''
        Integer i
        For i = 0 To 3
          If i = 0 Then
            Print "zero"
          ElseIf i = 1 Then
            Print "one"
          ElseIf i = 2 Then
          Else
            Print "more"
          EndIf
        Next i
        ''',
        ['zero', 'one', 'more'],
    ),
    'if of one line takes all statements of it': (
        '''
        Integer i
        For i = 0 To 1
          If i = 0 Then Print "a"; Print "b" Else Print "c"; Print "d"
          If i = 1 Then If i = 2 Then Print "e" Else Print "f"
        Next
        ''',
        ['a', 'b', 'c', 'd', 'f'],
    ),
    'if of one line may have its statements behind a semicolon': (
        '''
        Integer i
        For i = 0 To 1
          If i = 0 Then; Print "a"; Print "b" Else; Print "c"
        Next
        ''',
        ['a', 'b', 'c'],
    ),
    'if of several lines with statements behind its words': (
        '''
        Integer i
        For i = 0 To 3
          If i = 0 Then
            Print "zero"
          ElseIf i = 1 Then Print "one"; Print "uno"
            Print "eins"
          ElseIf i = 2 Then Print "two"
          Else Print "more"; Print "many"
          EndIf
        Next
        ''',
        ['zero', 'one', 'uno', 'eins', 'two', 'more', 'many'],
    ),
    'select with a statement behind Default': (
        '''
        Integer i
        For i = 1 To 2
          Select i
            Case 1
              Print "one"
            Default Print "default"
          Send
        Next
        ''',
        ['one', 'default'],
    ),
    'select': (
        '''
        Integer i
        String s$
        For i = 0 To 5
          Select i
            Case 0, 1
              Print i, "low"
            Case < 3
              Print i, "two"
            Case i - 1 + 1 ; Print i, "always"
          Send
        Next
        s$ = "b"
        Select s$
          Case "a"
            Print 1
          Default
            Print 2
        Send
        Select True
          Case 1 > 2
            Print 3
          Case 2 > 1
            Print 4
        Send
        ''',
        ['0 low', '1 low', '2 two', '3 always', '4 always', '5 always', '2', '4'],
    ),
    'do with a test before, after, and none': (
        '''
        Integer i
        Do While i < 2
          i = i + 1
        Loop
        Print i
        Do Until i = 5
          i = i + 1
        Loop
        Print i
        Do
          i = i + 1
        Loop While i < 3
        Print i
        Do
          i = i + 1
        Loop Until i >= 9
        Print i
        Do
          i = i - 1
          If i = 4 Then Exit Do
        Loop
        Print i
        ''',
        ['2', '5', '6', '9', '4'],
    ),
    'for counts up and down, not at all, and is one beyond': (
        '''
        Integer i, n
        Real r
        For i = 3 To 1 Step -1
          Print i
        Next i
        Print i
        For i = 5 To 4
          Print "never"
        Next
        Print i
        For r = 0 To 1 Step 0.5
          Print r
        Next
        For i = 1 To 10
          For n = 1 To 10
            If n = 3 Then Exit For
          Next n
          If i = 2 Then Exit For
        Next i
        Print i, n
        ''',
        ['3', '2', '1', '0', '5', '0', '0.5', '1', '2 3'],
    ),
    'goto, gosub and labels, also into blocks': (
        '''
        Integer i
        GoTo inside
        Do
          i = i + 10
        inside: i = i + 1; GoSub show
          If i > 10 Then GoTo done
        Loop
        show:
          Print i
          Return
        done:
        Print "done"
        ''',
        ['1', '12', 'done'],
    ),
    'separators at odd places': ('Print 1;; Print 2;\n; Print 3', ['1', '2', '3']),
    'print without line end': ('Print 1,\nPrint "x",\nPrint', ['1 x ']),
    'names in any case': ('integer Abc\naBC = 4\npRINT abC, TRUE', ['4 -1']),
}  # fmt: skip


@pytest.mark.parametrize('name', PROGRAMS)
def test_small_program_prints_the_expected_text(name: str) -> None:
    body, expected = PROGRAMS[name]
    assert printed(body, DECLARED) == expected


def test_functions_have_value_reference_and_array_parameters() -> None:
    source = """
    Function twice(n As Integer) As Long
      twice = n * 2
    Fend
    Function join$(ByVal a$ As String, b$ As String) As String
      join$ = a$ + b$
    Fend
    Function twin$(a$ As String)  ' As is missing in programs in production
      twin$ = a$ + a$
    Fend
    Function change(ByRef n As Integer, ByRef a() As Long, m As Integer)
      n = n + m
      m = 100
      a(1) = n
      deeper(ByRef n)
    Fend
    Function deeper(ByRef n As Integer)
      n = n + 1000
    Fend
    Function factorial(n As Integer) As Long
      If n < 2 Then
        factorial = 1
        Exit Function
      EndIf
      factorial = n * factorial(n - 1)
    Fend
    Function main
      Integer n, m, x(2)
      Long a(2)
      n = 1; m = 10
      Call change(ByRef n, ByRef a(), m)
      Print n, m, a(1)
      change ByRef x(2), ByRef a(), m
      Print x(2), a(1)
      Print twice(3) + twice(twice(2)), join$("a", join$("b", "c")), twin$("d") + "e"
      Print factorial(6)
      If twice(2) = 4 And twice(3) = 6 Then Print "both"
      Do While twice(n) > 2100
        n = n - 100
      Loop
      Print n
    Fend
    """
    host = run(source)
    assert not host.failures
    expected = ['1011 10 11', '1010 10', '14 abc dde', '720', 'both', '1011']
    assert host.text.splitlines() == expected


def test_function_of_another_file_is_called_without_brackets() -> None:
    head = 'Function show(n As Integer, s$ As String)'
    others = {'b_prg': f'Integer m\n{head}\n  m = m + n\n  Print m, s$\nFend'}
    calls = 'show 1, "a"\n  show (2), "b"\n  show(3, "c")'
    host = ScriptedHost()
    given = files(f'Integer m\nFunction main\n  m = 40\n  {calls}\nFend', **others)
    machine = Machine(build(given), host)
    machine.start()
    machine.advance(1.0)
    assert host.text.splitlines() == ['1 a', '3 b', '6 c']


FAULTS = [
    ('Function main\n  Prin 1\nFend', 'main.prg:2:3: error: unknown statement or function Prin'),
    ('Function main\n  x = 1\nFend', 'main.prg:2:3: error: x is not a declared variable'),
    ('Function main\n  If 1 = 1 Then\n  Print 1\nFend', 'If of line 2 has no EndIf'),
    ('Function main\n  Do\n  Print 1\nFend', 'Do of line 2 has no Loop'),
    ('Function main\n Integer i\n  For i = 1 To 2\nFend', 'For of line 3 has no Next'),
    ('Function main\n  Select 1\n Case 1\nFend', 'Select of line 2 has no Send'),
    ('Function main\n  Loop\nFend', 'main.prg:2:3: error: Loop without Do'),
    ('Function main\n  EndIf\nFend', 'EndIf without If'),
    ('Function main\n  Print 1\n', 'main.prg:1:1: error: function main (line 1) has no Fend'),
    ('Function main\n  Print 1\nFunction two\nFend', 'function main (line 1) has no Fend'),
    ('Print 1\nFunction main\nFend', 'Print outside a function'),
    ('Function main\n  Pass P(1:1000)\nFend', 'numbers of two points, 0 to 999'),
    ('Function main\n  Integer i\n  Pass P(i:3)\nFend', 'numbers of two points, 0 to 999'),
    ('Function main\n  Go P1 !D50; Go P2!\nFend', 'Go is not allowed in !…!'),
    ('Function main\n  Exit Do\nFend', 'Exit Do outside a Do'),
    ('Function main\n  GoTo no\nFend', 'unknown label no in function main'),
    ('Function main\na:\na:\nFend', 'label a occurs twice'),
    ('Function main\n  Integer i, I\nFend', 'I is declared twice in the function'),
    ('Integer a\nInteger A\nFunction main\nFend', 'A is declared in main.prg:1 already'),
    ('Global Long a\nGlobal Integer a\nFunction main\nFend', 'already, differently'),
    ('Function main\nFend\nFunction Main\nFend', 'function Main is also defined in main.prg:1'),
    ('Function main\n  Integer a(n)\nFend', 'bounds of an array must be whole numbers'),
    ('Function main\n  Integer a(1,1,1,1)\nFend', 'at most three dimensions'),
    ('Function main\n  Integer a$\nFend', 'names of strings end in $'),
    ('Function main\n  String a\nFend', 'names of strings end in $'),
    ('Function main\n  Global Integer a\nFend', 'Global inside a function'),
    ('Function main\n  Static Integer a\nFend', 'Static inside a function'),
    ('Function main\n  Integer then\nFend', 'then is a reserved word of SPEL+'),
    ('Function main(a() As Long)\nFend', 'arrays are passed ByRef only'),
    ('Function main\n  Call missing\nFend', 'there is no function missing'),
    ('Function main\n  Xqt missing\nFend', 'there is no function missing'),
    ('Function main\n  Select 1\n  Print 1\n  Case 1\n  Send\nFend', 'are never executed'),
    ('Function main\n Integer i, j\n  For i = 1 To 2\n  Next j\nFend', 'Next j ends For i'),
    ('Function main\n  Select P1\n  Case 1\n  Send\nFend', 'Select does not take points'),
    ('Function main\n  Select 1\n  Case "a"\n  Send\nFend', 'have different types'),
    ('Function main\n  Select "a"\n  Case < "b"\n  Send\nFend', 'compared by = and <> only'),
    ('Function main\n  Exit Now\nFend', 'expected Do, For or Function, found Now'),
    ('Function main\n  5 = 3\nFend', 'a statement cannot start with 5'),
    ('Function main\na: 5\nFend', 'invalid start of a statement'),
    ('Function main\n  Integer i\n  Line Input i\nFend', 'Line Input needs a string'),
    ('Function main\n  Double d(3)\n  ReadBin #201, d(), 2\nFend', 'cannot use this array'),
    ('Function main\n  Integer d(3)\n  ReadBin #201, d()\nFend', 'its number of elements'),
    ('Function main\n  Real r\n  ReadBin #201, r\nFend', 'needs a whole number'),
    ('Function main\n  ReadBin #201, 5\nFend', 'must be a variable'),
    ('Function main\n  MsgBox "a", 1, "b", 5\nFend', 'must be a variable'),
    ('Function f(ByRef i As Long)\n  Long n\n  Xqt f(ByRef n)\nFend', 'no ByRef'),
    ('Function f(i As Long) As Long\n  i = f(i, i)\nFend', 'takes 1 arguments'),
    ('Function main\n  Wait 1, 2\nFend', 'Wait needs a time, or a condition with a time'),
    ('Function main\n  Wait Sw(1) = 1, \nFend', 'expected a value'),
    ('Declare f, "a.dll"\nFunction main\n  Print f(1)\nFend', 'f takes 0 arguments, not 1'),
    ('Declare f\nFunction main\nFend', 'expected a comma'),
    ('Declare f, "a.dll", "f", As String\nFunction main\nFend', 'cannot return a String'),
    ('Declare f, a\nFunction main\nFend', 'needs the name of a DLL in quotes'),
    ('Function f(n As Long)\n  Trap 1, Sw(1) = On Call f\nFend', 'Trap takes no parameters'),
    ('Function main\n  Xqt missing, NoPause\nFend', 'there is no function missing'),
    ('Function main\n  Xqt 2 main\nFend', 'expected a comma, found main'),
    ('Function main\n  Xqt !2, main\nFend', 'Xqt takes no ! before a task (p912): remove it'),
    ('Function main\n  OnErr bad\nbad:\nFend', 'GoTo is missing (p569): write OnErr GoTo bad'),
    ('Function main\n  OnErr\nFend', 'write OnErr GoTo label'),
    ('Function main\n  Print Js(0)\nFend', 'JS takes no arguments: write JS'),
    ('Function main\n  Print Sw($1)\nFend', 'for memory bits, write MemSw, MemOn and MemOff'),
    ('Function main\n  Integer i\n  Wait i = 1\nFend', 'i is a local variable: a condition takes'),
    ('Real r\nFunction main\n  Wait r > 1\nFend', 'r is Real: a condition takes'),
    ('Integer a(3)\nFunction main\n  Wait a(1) = 1\nFend', 'a is an array: a condition takes'),
    ('Function main\n  Wait Sqr(4) = 2\nFend', 'a condition takes inputs, outputs'),
    ('Function main\n  Print (1 + \nFend', 'expected a value, found end of the line'),
    ('Function main\n  Print (1\nFend', 'expected ), found end of the line'),
    ('Function main\n  Speed ,\nFend', 'expected a value'),
    ('Function main\n  Motor Up\nFend', 'unknown variable, constant or function Up'),
    ('Function main\n  SetNet #201, "a", 1, CR, NONE, 0, UDP\nFend', 'SetNet with UDP'),
    ('Function main\n  SetNet #201, "a", 1, CR, NONE, 0, 5\nFend', 'expected TCP, found 5'),
    ('Function main\n  If 1 Then Loop\nFend', 'main.prg:2:13: error: Loop is not allowed in this'),
    ('Function main\n  Integer a(1)\n  Redim a()\nFend', 'Redim needs one to three bounds'),
    ('Function main\n  Integer a(1)\n  Redim a(1,1,1,1)\nFend', 'Redim needs one to three'),
    ('Function f(ByRef a() As Long)\n  Redim a(3)\nFend', 'a is ByRef: Redim cannot change it'),
    ('Function main\n  Trap 1, Sw(1) = On Print\nFend', 'expected GoTo, Call or Xqt, found Print'),
    ('Function main\n  Trap 1, Sw(1) = On GoTo b\na:\nFend', 'unknown label b'),
    ('Function main\n  Trap 1, Sw(1) = On Call no\nFend', 'there is no function no'),
    ('Function main\n  Trap Error Xqt no\nFend', 'main.prg:2:18: error: there is no function no'),
    ('Function main\n  Trap Error Xqt f\nFend\nFunction f(5)\nFend', 'there is no function f'),
    ('Function main\n  Integer a(1), i\n  a(ByRef i) = 1\nFend', 'an index must be a number'),
    ('Function main\n  Integer a(1)\n  a(a()) = 1\nFend', 'an index must be a number'),
    ('Function f(n As Long)\n  f(ByRef n)\nFend', 'f: n is not ByRef'),
    ('Function f(a As Long, A As Real)\nFend', 'A is declared twice in the function'),
    ('Function f(f As Long) As Long\nFend', 'f is declared twice in the function'),
    (f'Function main\n  Print {"(" * 60}1{")" * 60}\nFend', 'the expression is nested'),
    (f'Function main\n  Print 1{" + 1" * 200}\nFend', 'the expression is too long'),
    ('Function main\n' + '  Do\n' * 40 + '  Loop\n' * 40 + 'Fend', 'nested too deeply'),
]  # fmt: skip


@pytest.mark.parametrize(('source', 'message'), FAULTS)
def test_syntax_error_has_file_and_line(source: str, message: str) -> None:
    with pytest.raises(ProgramError, match=r'\Amain\.prg:\d+:\d+: error: ') as caught:
        build(files(source))
    assert message in str(caught.value)


def test_dll_functions_are_called_in_the_host() -> None:
    source = """
    Declare conv, "numbers.dll", "Convert"(a As Byte, ByRef b() As Long, ByRef c As Real) As Byte
    Declare quiet, "numbers.dll"
    Function main
      Long many(2)
      Real r
      r = 1.5
      Print conv(3, ByRef many(), ByRef r) + 1, many(0), r
      Call quiet
    Fend
    """
    host = run(source)
    assert host.failures == []
    assert host.text.splitlines() == ['6 77 77']
    (first, second) = host.library
    assert first[:2] == ('numbers.dll', 'Convert')
    assert first[2][0] == 3
    assert second == ('numbers.dll', 'quiet', [])


def test_declare_has_the_forms_of_the_manual() -> None:
    """With and without a comma before the arguments and the type (p278-280)."""
    source = """
    #define MYSTUFF "mystuff.dll"
    Declare ReturnLong, "mystuff.dll", "ReturnLong", As Long
    Declare MyDLLTest, "mystuff.dll", "#1" As Long
    Declare MyDLLCall, MYSTUFF, "MyTestFunc", (var1 As Integer, ByRef a() As Long) As Integer
    Function main
      Long a(2)
      Print ReturnLong, MyDLLTest, MyDLLCall(1, ByRef a())
    Fend
    """
    host = run(source)
    assert host.failures == []
    assert [call[1] for call in host.library] == ['ReturnLong', '#1', 'MyTestFunc']


def test_all_errors_are_reported_together_without_duplicates() -> None:
    source = """
    Function broken(
      Integer i
    Fend
    Function main
      Prin 1
      If 1 Then
        Foo 2
      EndIf
      Print "a" + 1
    Fend
    """
    with pytest.raises(ProgramError) as caught:
        build(files(source))
    lines = [problem.position.line for problem in caught.value.problems]
    assert lines == [1, 5, 7, 9]


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
def test_line_is_split_into_tokens(line: str, expected: list[str]) -> None:
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
def test_number_token_has_its_value(text: str, value: float) -> None:
    (token,) = tokens(text, 'a.prg', 1)
    assert (token.value, type(token.value)) == (value, type(value))


@pytest.mark.parametrize(
    ('line', 'column', 'message'),
    [
        ('Print "open', 7, 'the string has no end'),
        ('a = 3 % 4', 7, "unexpected '%'"),
        ('a = 1e999', 5, 'larger than a Double'),
        (f'a = 1{"0" * 500}', 5, 'too many digits'),
        ('x' * 6000, 5000, 'too long'),
        ('a = €', 5, 'unexpected'),
    ],
)
def test_invalid_token_is_reported_with_its_column(line: str, column: int, message: str) -> None:
    with pytest.raises(SyntaxProblem, match=r'a\.prg:7:') as caught:
        tokens(line, 'a.prg', 7)
    assert message in str(caught.value)
    assert caught.value.problem.position.column == column
