# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""spel/formatting.py: indentation and case as in RC+'s editor."""

from pathlib import Path

import pytest

from epson_driver.spel.formatting import formatted
from epson_driver.spel.project_data import decoded

UGLY = """\
#IFDEF FAST
#include "If.inc"
#EndIf
function MAIN
integer i, Else_1  ' else
if i = 1 then print "print Then"; else Print 2
If i = 2 THEN
wait 0.1
elseif i = 3 then ;
ON 5
else
'print 1
  ' about
!  d50; off 1 !; do
vget Find.Time.print, i
loop
endif
select i
case 1
for i = 1 to 3; print i
next
default
P1:Z(0)
again:
end: goto again
send
FEND
"""

PRETTY = """\
#ifdef FAST
#include "If.inc"
#endif
Function MAIN
  Integer i, Else_1  ' else
  If i = 1 Then Print "print Then"; Else Print 2
  If i = 2 Then
    Wait 0.1
  ElseIf i = 3 Then ;
    On 5
  Else
'print 1
    ' about
    !  d50; Off 1 !; Do
      VGet Find.Time.print, i
    Loop
  EndIf
  Select i
    Case 1
      For i = 1 To 3; Print i
      Next
    Default
      P1:Z(0)
again:
end: GoTo again
  Send
Fend
"""


def test_blocks_are_indented_and_words_have_the_manuals_case() -> None:
    assert formatted(UGLY) == PRETTY
    assert formatted(PRETTY) == PRETTY


@pytest.mark.parametrize(
    'path', sorted(Path(__file__).parents[2].glob('controller_program/*.[pi][rn][gc]'))
)
def test_our_controller_program_is_formatted(path) -> None:
    text = path.read_bytes().decode()
    assert formatted(text) == text


def test_formatter_keeps_tabs_and_indentation_width() -> None:
    assert formatted('Function f\n\tDo\n Loop\nFend') == 'Function f\n\tDo\n\tLoop\nFend'
    assert formatted('Function f\n    Do\n a = 1\nLoop\nFend').split('\n')[2] == ' ' * 8 + 'a = 1'


def test_both_branches_of_an_ifdef_open_one_block() -> None:
    text = (
        'Function f\n#ifdef A\n  If a Then\n#else\n  If b Then\n#endif\n    c = 1\n  EndIf\nFend'
    )
    assert formatted(text) == text


def test_formatter_removes_trailing_blanks_but_no_carriage_returns() -> None:
    assert formatted('Function f  \r\n \t\r\nFend\r\n') == 'Function f\r\n\r\nFend\r\n'


@pytest.mark.parametrize(
    'text', ['', 'Fend\nLoop\nSend\nElse\nNext', '"print', 'If Then If :', '!']
)
def test_broken_programs_are_formatted_without_an_error(text) -> None:
    assert formatted(text).lower() == text.lower()


def test_formatter_preserves_shift_jis_bytes() -> None:
    content = 'print "ソフト print" \' 表示 print'.encode('shift_jis')
    result = formatted(content.decode('latin-1')).encode('latin-1')
    assert decoded(result) == 'Print "ソフト print" \' 表示 print'
