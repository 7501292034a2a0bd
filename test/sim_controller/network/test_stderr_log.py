# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's log on a manual clock: what its clients cause is bounded and printable."""

import logging

import pytest
from support.controller_harness import Harness, Peer

from epson_driver.sim_controller.network.stderr_log import BURST_LINES, StderrLog

MANY = 20_000


class Log:
    """The lines that a controller writes to stderr, at a time that a test sets."""

    def __init__(self, capfd):
        self.now = 100.0
        self._capfd = capfd
        self.handler = StderrLog(clock=lambda: self.now)

    def lines(self):
        self.handler.finish()
        return self._capfd.readouterr().err.splitlines()


@pytest.fixture
def log(capfd):
    log = Log(capfd)
    logger = logging.getLogger('epson_driver')
    level = logger.level
    logger.addHandler(log.handler)
    logger.setLevel(logging.INFO)
    yield log
    logger.removeHandler(log.handler)
    logger.setLevel(level)


@pytest.fixture
def client():
    harness = Harness(motors=False)
    return harness.controller.connect('remote', Peer())


@pytest.mark.invariant(7)
def test_invariant_7_refused_remote_commands_have_a_pace_and_the_rest_is_counted(log, client):
    client.receive(b'$Nothing\n' * MANY)
    log.now += 1.0
    client.receive(b'$Nothing\n' * MANY)
    lines = log.lines()
    assert len(lines) == BURST_LINES + 1
    assert all('there is no command Nothing' in line for line in lines)
    assert lines[-1].endswith(f'(and {MANY - BURST_LINES} like it before)')


def test_other_lines_pass_while_one_kind_is_held_back(log, client):
    client.receive(b'$Login\n' + b'$Nothing\n' * MANY + b'$Sim,estop,press\n')
    lines = log.lines()
    assert len(lines) == BURST_LINES + 1
    assert 'E-stop press: ' in lines[-1]


def test_what_a_client_sends_does_nothing_to_the_terminal(log, client):
    client.receive(b'$\x1b]0;owned\x07\x9b2J\x08\x00\n\x1b[31mno dollar\n')
    lines = log.lines()
    assert len(lines) == 2
    assert all(line.isprintable() for line in lines)
    assert r'there is no command \x1b]0;owned\x07' in lines[0]


@pytest.mark.invariant(7)
@pytest.mark.parametrize('port', ['motion', 'state', 'io'])
def test_invariant_7_refused_messages_have_a_pace_on_every_port(log, port):
    connection = Harness(motors=False, connect=False).controller.connect(port, Peer())
    for kind in (11, 12, 13, 65_201, 999, 0, -1):  # too short for what they are
        connection.receive(
            b'\x0f\0\0\0' + kind.to_bytes(4, 'little', signed=True) + b'\2' + bytes(10)
        )
    for _ in range(MANY // 10):
        connection.receive(b'\x0f\0\0\0\x0b\0\0\0\2' + bytes(10))
    assert 1 <= len(log.lines()) <= 3 * BURST_LINES
