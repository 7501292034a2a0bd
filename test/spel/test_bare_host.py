# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A host without robot, network, DLLs or people: what a program gets from it."""

import pytest
from support.spel_harness import files

from epson_driver.spel import ErrorNumber, Machine, SpelError, build
from epson_driver.spel.bare_host import BareHost


def on_bare_host(body: str, before: str = '') -> BareHost:
    """Run the statements of a main for ten seconds."""
    host = BareHost()
    made = Machine(build(files(f'{before}\nFunction main\n{body}\nFend\n')), host)
    made.start()
    made.advance(10.0)
    return host


def test_what_is_printed_is_shown_as_it_comes_and_kept() -> None:
    shown: list[str] = []
    host = BareHost(shown.append)
    made = Machine(build(files('Function main\n  Print 1,\n  Print "a"\nFend\n')), host)
    made.start()
    made.advance(1.0)
    assert shown == host.printed
    assert ''.join(shown) == '1 a\n'


def test_a_message_box_is_shown_and_answered_with_cancel_unless_said_otherwise() -> None:
    body = '  Integer i\n  MsgBox "go on?", MB_YESNO, "cell 4", i\n  Print i'
    host = on_bare_host(body)
    assert host.printed == ['cell 4: go on?\n', '2\n']


def test_points_stay_as_they_are_set() -> None:
    host = on_bare_host('  P1 = JA(1, 2, 3, 4)\n  Print P1')
    assert host.printed == ['angles(1.000, 2.000, 3.000, 4.000)\n']


def test_nobody_is_at_any_port() -> None:
    body = """
    Integer i
    OnErr GoTo failed
    OpenNet #201 As Server
    Print ChkNet(201), Lof(201)
    WaitNet #201, 0.1
    Print TW
    ReadBin #201, i
    Print "read"
    WriteBin #201, 1
    Print "written"
    Exit Function
    failed:
    Print Err
    EResume Next
    """
    host = on_bare_host(body)
    assert ''.join(host.printed).splitlines() == ['-1 0', '-1', '2902', 'read', '2902', 'written']
    assert host.received(201) == host.take(201, 4) == b''
    with pytest.raises(SpelError, match='port 201 has no peer') as refused:
        host.send(201, b'x')
    assert refused.value.number == ErrorNumber.NETWORK


def test_there_is_no_dll() -> None:
    host = on_bare_host('  Print conv(3)', 'Declare conv, "numbers.dll"(a As Long) As Long')
    (failure,) = host.failures
    assert failure.number == ErrorNumber.NO_LIBRARY
    assert failure.text == 'conv of numbers.dll'
