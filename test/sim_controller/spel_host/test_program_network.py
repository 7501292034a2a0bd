# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Port objects of a SPEL+ program: what they refuse, and what becomes of bytes nobody reads."""

import errno
import logging
import os

import pytest
from support.spel_program_harness import SpelProgramHarness

from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.spel import NetSettings, SpelError

SETTINGS = NetSettings('', 2001)


@pytest.fixture(autouse=True)
def _all_is_logged(caplog):
    caplog.set_level(logging.INFO)


def opened():
    """Return a network with the motion port open as #201."""
    network = ProgramNetwork({2001: 'motion'})
    network.open_net(201, SETTINGS, True)
    return network


def test_what_comes_after_the_program_has_closed_its_port_is_nobodys():
    network, sent, closed = opened(), [], []
    session = network.session('motion', sent.append, lambda: closed.append(True))
    session.receive(b'abc')
    assert network.received(201) == b'abc'
    network.send(201, b'answer')
    network.close_net(201)
    assert closed == [True]
    session.receive(b'late')
    assert network.received(201) == b''
    network.open_net(201, SETTINGS, True)
    assert network.received(201) == b''
    assert sent == [b'answer']


@pytest.mark.parametrize(('port', 'said'), [(201, 'TCP port 2001'), (202, 'port 202')])
def test_nothing_is_sent_to_a_peer_that_is_not_there(port, said):
    network = opened()
    with pytest.raises(SpelError, match=f'{said} has no peer') as refused:
        network.send(port, b'x')
    assert refused.value.number == 2902


def test_a_client_of_a_port_that_is_not_open_is_not_served():
    network = opened()
    assert network.rejection('motion') is None
    with pytest.raises(ConnectionRefusedError, match='has not opened the state port'):
        network.session('state', lambda _: None, lambda: None)
    network.close_net(201)
    with pytest.raises(ConnectionRefusedError, match='has not opened the motion port'):
        network.session('motion', lambda _: None, lambda: None)


@pytest.mark.parametrize(
    ('statements', 'said'),
    [
        ('OpenNet #203 As Server', 'port 203 has no TCP port: SetNet gives it one, or --net'),
        (
            'SetNet #203, "", 11002\nSetNet #204, "", 11002\n'
            'OpenNet #203 As Server\nOpenNet #204 As Server',
            'OpenNet #204: another port object serves TCP port 11002',
        ),
    ],
)
def test_a_port_that_cannot_be_opened_is_error_2900(caplog, statements, said):
    harness = SpelProgramHarness(f'Function main\n{statements}\nFend\n', caplog)
    harness.step(0.1)
    assert harness.controller.error_number == 2900
    line = len(statements.split('\n')) + 1
    assert f'main.prg:{line}: error 2900 in main (task 1): {said}' in caplog.text


def test_a_tcp_port_that_another_program_has_is_error_2900_and_may_be_tried_again():
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


def test_lines_of_print_are_put_together_and_cut_where_they_are_too_long(caplog):
    harness = SpelProgramHarness(LONG, caplog)
    harness.step(0.1)
    first, second, third = harness.printed
    assert first.endswith('end of a line')
    assert len(first) == 9 * 101 + len('end of a line')
    assert len(second) == 1000
    assert third.strip() == 'behind'


def test_input_waits_for_ever_where_nobody_types(caplog):
    source = 'Function main\n  Integer i\n  Input i\n  Print "typed"\nFend\n'
    harness = SpelProgramHarness(source, caplog)
    harness.step(30.0)
    assert harness.printed == []
    assert harness.tasks == ['main waits main.prg:3']
