# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Port objects of a SPEL+ program: rejections and unread bytes, and its terminal."""

import errno
import os

import pytest
from support.spel_program_harness import SpelProgramHarness

from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.sim_controller.spel_run import Console
from epson_driver.spel import Caller, NetSettings, SpelError

SETTINGS = NetSettings('', 2001)


@pytest.mark.parametrize(
    ('statements', 'text'),
    [
        (
            'OpenNet #203 As Server',
            'port 203 has no TCP port: use SetNet, or add `203: ADDRESS:PORT` under `ports:`',
        ),
        (
            'SetNet #203, "", 11002\nSetNet #204, "", 11002\n'
            'OpenNet #203 As Server\nOpenNet #204 As Server',
            'OpenNet #204: another port object serves TCP port 11002',
        ),
    ],
)
def test_port_that_cannot_be_opened_is_error_2900(caplog, statements, text):
    harness = SpelProgramHarness(f'Function main\n{statements}\nFend\n', caplog)
    harness.step(0.1)
    assert harness.controller.error_number == 2900
    line = len(statements.split('\n')) + 1
    assert f'main.prg:{line}: error 2900 in main (task 1): {text}' in caplog.text


def test_used_tcp_port_is_error_2900_and_may_be_retried():
    taken = [4321]

    def listen(tcp_port):
        if tcp_port in taken:
            raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))

    network = ProgramNetwork({})
    network.listen = listen
    settings = NetSettings('', 4321)
    with pytest.raises(SpelError, match=r'OpenNet #205: .*Address already in use') as refused:
        network.open_net(205, settings, True)
    assert refused.value.number == 2900
    assert network.rejection('4321') == 'the program has not opened the 4321 port'
    taken.clear()
    network.open_net(205, settings, True)
    assert network.rejection('4321') is None


LONG = """
Function main
  String s$
  Integer i
  s$ = Space$(100)
  For i = 1 To 9
    Print s$,
  Next
  Print "end of a line"
  For i = 1 To 11
    Print s$,
  Next
  Print "behind"
Fend
"""


def test_printed_lines_are_joined_and_split_at_the_maximum(caplog):
    harness = SpelProgramHarness(LONG, caplog)
    harness.step(0.1)
    first, second, third = harness.printed
    assert first.endswith('end of a line')
    assert len(first) == 9 * 101 + len('end of a line')
    assert len(second) == 1000
    assert third.strip() == 'behind'


def test_input_waits_for_typed_text(caplog):
    source = 'Function main\n  Integer i\n  Input i\n  Print "typed"\nFend\n'
    harness = SpelProgramHarness(source, caplog)
    harness.step(30.0)
    assert harness.printed == []
    assert harness.tasks == ['main waits main.prg:3']


MAIN = Caller(1, 'main', 'main.prg', 3)


def test_message_box_is_printed_and_cancelled(
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = Console().message_box(MAIN, 'Is the cell empty?', 4, 'Cell 4')
    assert capsys.readouterr().out == 'MsgBox Cell 4: Is the cell empty? (answered with Cancel)\n'
    assert answer == 2


def test_typed_lines_are_read_in_order() -> None:
    console = Console()
    assert console.read_line() is None
    console.typed('1')
    console.typed('2')
    assert [console.read_line() for _ in range(3)] == ['1', '2', None]
