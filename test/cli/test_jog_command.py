# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver jog` at a terminal: what it says, and that nothing goes on without a key."""

import io
import os
import sys

import pytest

from epson_driver.cli import jog, processes


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def called(monkeypatch, capsys):
    """Return a function that calls the command at a terminal, in a domain of its own."""
    domain = processes.free_ros_domain()
    for name, value in processes.ros_environment(domain).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, 'stdin', Terminal())

    def call(*words):
        monkeypatch.setattr(sys, 'argv', ['epson_driver jog', *words])
        return jog.main(), capsys.readouterr().err

    return call


def test_without_a_driver_it_says_what_to_start(called, monkeypatch):
    monkeypatch.setattr(jog, 'WAIT_S', 0.2)
    code, said = called('--node', 'mine')
    assert code == 1
    assert said == (
        'epson_driver jog: no joint_states and mine/joint_jog within 0.2 s: start the client, '
        'and give its name with --node\n'
    )


@pytest.mark.invariant(3)
def test_a_key_that_is_released_stops_and_a_new_speed_is_shown(monkeypatch):
    read, write = os.pipe()
    said, published = [], []

    def then(text):
        said.append(text)
        os.write(write, b'1' if len(said) == 1 else b'x')

    def publish(message):
        published.append((list(message.joint_names), list(message.velocities)))
        if not any(message.velocities):
            os.write(write, b'-')

    monkeypatch.setattr('builtins.print', then)
    with os.fdopen(read) as keys:
        monkeypatch.setattr(sys, 'stdin', keys)
        os.write(write, b'+')
        jog._jog(['a', 'b'], 0.1, publish)
    os.close(write)
    assert [text.split()[0] for text in said] == ['0.15', '0.1']
    assert published[0] == (['a'], [pytest.approx(0.15)])
    assert published[-1] == (['a', 'b'], [0.0, 0.0])
