# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ports 201 to 216 as a program sees them."""

import pytest
from support.spel_harness import ScriptedHost, machine

from epson_driver.spel import ErrorNumber, Machine

SERVER = """
Function main
  Integer b(9), i
  Byte c(9)
  Long l
  String s$
  Real r
  OnErr GoTo failed
  SetNet #201, "10.0.0.2", 2001, {terminator}, NONE, {timeout}
  OpenNet #201 As Server
  Print ChkNet(201)
  WaitNet #201
  Print ChkNet(201)
  {body}
  Print "end"
  Exit Function
failed:
  Print "error", Err
Fend
"""


def waiting_server(
    body: str, terminator: str = 'CRLF', timeout: str = '0'
) -> tuple[Machine, ScriptedHost]:
    """Return a machine that waits for its peer, and its host."""
    host = ScriptedHost()
    source = SERVER.format(body=body, terminator=terminator, timeout=timeout)
    made = machine(source, host)
    made.start()
    made.advance(1.0)
    assert host.text == '-1\n'
    host.printed.clear()
    peer = host.peers[201]
    assert peer.server
    assert (peer.settings.host, peer.settings.tcp_port) == ('10.0.0.2', 2001)
    return made, host


def talk(
    body: str, *incoming: bytes, terminator: str = 'CRLF', timeout: str = '0'
) -> ScriptedHost:
    """Connect a peer that sends the pieces one after another. Return the host."""
    made, host = waiting_server(body, terminator, '0')
    peer = host.peers[201]
    peer.there = True
    for piece in (b'', *incoming):
        peer.incoming += piece
        made.advance(made.time + 0.1)
    return host


def test_arrays_hold_one_byte_per_element() -> None:
    body = """
    ReadBin #201, b(), 4
    ReadBin #201, c(), 2
    ReadBin #201, l
    Print b(0), b(3), b(4), c(0), c(1), l
    b(0) = 256 + 65; b(1) = -1
    WriteBin #201, b(), 3
    WriteBin #201, 7
    WriteBin #201, c(), 1
    """
    host = talk(body, b'\x01\x02', b'\x03\xff\xfe', b'\x7f\x80')
    assert host.text.splitlines() == ['0', '1 255 0 -2 127 128', 'end']
    assert host.peers[201].sent == b'A\xff\x03\x07\xfe'


def test_lines_and_values_are_read_and_written() -> None:
    body = """
    Input #201, i, r
    Print i, r
    Line Input #201, s$
    Print s$
    Input #201, s$
    Print s$, Lof(201)
    Print #201, "a", i, r
    Print #201, "no end",
    Write #201, "w"
    Read #201, s$, 3
    Print s$, Len(s$)
    """
    host = talk(body, b'5, 2.', b'5\r\n a, "b" \r\nword\r\n', b'x\0y')
    assert host.text.splitlines()[1:] == ['5 2.5', ' a, "b" ', 'word 0', 'x 1', 'end']
    assert host.peers[201].sent == b'a 5 2.5\r\nno endw'


@pytest.mark.parametrize(('name', 'end'), [('CR', b'\r'), ('LF', b'\n'), ('CRLF', b'\r\n')])
def test_setnet_sets_the_line_end(name: str, end: bytes) -> None:
    host = talk('Line Input #201, s$\nPrint #201, s$', b'abc' + end, terminator=name)
    assert host.peers[201].sent == b'abc' + end


def test_wrong_number_of_values_is_error_2505() -> None:
    assert talk('Input #201, i, r', b'1,2,3\r\n').text.splitlines()[-1] == 'error 2505'


def test_read_times_out_after_the_setnet_timeout() -> None:
    made, host = waiting_server('ReadBin #201, b(), 4', 'CRLF', '2')
    host.peers[201].there = True
    made.advance(2.9)
    assert host.text == '0\n'
    made.advance(3.1)
    assert host.text == f'0\nerror {ErrorNumber.READ_TIMEOUT:d}\n'


def test_lost_peer_is_an_error_for_reads_and_writes() -> None:
    for body in ('ReadBin #201, b(), 4', 'Wait 1; WriteBin #201, b(), 4'):
        made, host = waiting_server(body, 'CRLF', '0')
        host.peers[201].there = True
        made.advance(made.time + 0.1)
        host.peers[201].there = False
        made.advance(made.time + 2.0)
        assert host.text.splitlines()[-1] == 'error 2902'


def test_port_belongs_to_the_task_that_opened_it() -> None:
    source = """
    Function main
      Xqt 2, owner
      Wait 0.1
      Print ChkNet(201), OpenNet(201)
      OnErr GoTo failed
      OpenNet #201 As Client
      CloseNet #201
      WriteBin #201, 1
      CloseNet All
      Print ChkNet(201)
      Quit 2
      OpenNet #201 As Client
      Print ChkNet(201), OpenNet(201)
      Exit Function
    failed:
      Print "error", Err
      EResume Next
    Fend
    Function owner
      OpenNet #201 As Server
      Wait 100
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(1.0)
    lines = host.text.splitlines()
    assert lines == ['-2 2', 'error 2907', 'error 2907', 'error 2907', '-2', '-1 1']
    assert not host.peers[201].server
