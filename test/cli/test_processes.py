# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Processes on free ports and in a free ROS domain, which leave nothing behind."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections import deque

import pytest

from epson_driver.cli import processes
from epson_driver.cli.processes import (
    SAFE_DOMAINS,
    Ports,
    Process,
    RunError,
    ended_at_exit,
    free_ros_domain,
    ros_environment,
    sim_controller,
)


def domain_port(domain):
    """Return the port that the first participant of a domain takes (DDSI-RTPS 9.6.1)."""
    return 7400 + 250 * domain + 10


def bound(domain):
    """Return a socket that keeps a domain busy."""
    held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    held.bind(('', domain_port(domain)))
    return held


@pytest.fixture
def unclaimed(monkeypatch):
    """Let this process have claimed nothing yet; what it claims ends with the test."""
    claims = deque()
    monkeypatch.setattr(processes, 'claims', claims)
    yield claims
    while claims:
        claims.pop().close()


def two_domains(claims):
    """Return two domains that are free, and not claimed."""
    domains = [free_ros_domain(), free_ros_domain()]
    while claims:
        claims.pop().close()
    return domains


def test_a_domain_whose_port_is_bound_is_avoided(monkeypatch, unclaimed):
    taken, other = two_domains(unclaimed)
    monkeypatch.setattr(processes, 'SAFE_DOMAINS', [taken, other])
    with bound(taken):
        for _ in range(20):
            assert free_ros_domain() == other
            unclaimed.pop().close()


def test_no_free_domain_is_an_error(monkeypatch, unclaimed):
    domain, _ = two_domains(unclaimed)
    monkeypatch.setattr(processes, 'SAFE_DOMAINS', [domain])
    with bound(domain), pytest.raises(RunError, match='in use'):
        free_ros_domain()
    assert not unclaimed
    assert free_ros_domain() == domain


def test_a_domain_that_was_chosen_is_not_free_for_others(monkeypatch, unclaimed):
    monkeypatch.setattr(processes, 'SAFE_DOMAINS', domains := two_domains(unclaimed))
    assert {free_ros_domain(), free_ros_domain()} == set(domains)
    with pytest.raises(RunError, match='in use'):
        free_ros_domain()
    other = (
        'from epson_driver.cli import processes\n'
        f'processes.SAFE_DOMAINS = {domains}\n'
        'print(processes.free_ros_domain())'
    )
    run = subprocess.run([sys.executable, '-c', other], capture_output=True, text=True)
    assert 'in use' in run.stderr
    unclaimed.popleft().close()
    run = subprocess.run([sys.executable, '-c', other], capture_output=True, text=True)
    assert int(run.stdout) in domains


def test_only_the_newest_domains_stay_claimed(monkeypatch, unclaimed):
    monkeypatch.setattr(processes, 'MAX_CLAIMS', 3)
    for _ in range(10):
        free_ros_domain()
    assert len(unclaimed) == 3


def test_two_runs_of_these_tests_find_domains_side_by_side():
    workers = 4  # of `make test`, see Makefile
    assert 2 * workers * processes.MAX_CLAIMS <= len(SAFE_DOMAINS) // 2


def test_domains_lie_below_the_ephemeral_ports():
    highest = max(SAFE_DOMAINS)
    assert min(SAFE_DOMAINS) >= 1  # 0 is everybody's
    assert domain_port(highest) + 240 < 32768 + 250
    assert free_ros_domain() in SAFE_DOMAINS


def test_the_environment_keeps_to_this_machine_and_domain(monkeypatch):
    monkeypatch.setenv('SOMETHING_ELSE', 'kept')
    environment = ros_environment(42)
    assert environment['ROS_DOMAIN_ID'] == '42'
    assert environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert environment['SOMETHING_ELSE'] == 'kept'
    assert os.environ.get('ROS_DOMAIN_ID') != '42'


def test_a_simulated_controller_starts_on_free_ports_and_ends_cleanly(tmp_path):
    process = sim_controller(tmp_path / 'log.txt')
    with ended_at_exit(process):
        ports = process.ports()
        assert len({ports.motion, ports.state, ports.io, ports.remote}) == 4
        for port in (ports.motion, ports.state, ports.io, ports.remote):
            socket.create_connection(('127.0.0.1', port), timeout=5.0).close()
        assert process.returncode is None
        assert process.end() == 0
    assert process.returncode == 0


def test_a_simulated_controller_that_cannot_start_says_why(tmp_path):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        process = sim_controller(tmp_path / 'log.txt', ports=Ports(port, 0, 0, 0))
        with ended_at_exit(process), pytest.raises(RunError) as caught:
            process.ports()
    text = str(caught.value)
    assert 'sim_controller did not start' in text
    assert f'motion port 127.0.0.1:{port}' in text


def test_wrong_arguments_are_in_the_error(tmp_path):
    process = sim_controller(tmp_path / 'log.txt', '--robot', 'no_such_robot')
    with ended_at_exit(process), pytest.raises(RunError, match='no_such_robot'):
        process.ports()


def test_a_process_is_ended_whatever_happens_in_the_block(tmp_path):
    process = sim_controller(tmp_path / 'log.txt')

    def work():
        with ended_at_exit(process):
            process.ports()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert process.returncode == 0


def test_kill_is_a_crash(tmp_path):
    process = sim_controller(tmp_path / 'log.txt')
    with ended_at_exit(process):
        process.ports()
        process.kill()
        assert process.returncode == -signal.SIGKILL


@pytest.fixture
def shell(tmp_path):
    """Return a function that starts a shell script as an executable of this package."""
    made = []

    def start(script):
        run = ['/bin/sh', '-c', script]
        made.append(Process('client', [], tmp_path / 'log.txt', dict(os.environ), run))
        return made[-1]

    yield start
    for process in made:
        if process.returncode is None:
            process.kill()


def test_one_that_does_not_end_is_killed(shell, monkeypatch):
    monkeypatch.setattr(processes, 'END_TIMEOUT_S', 0.1)
    process = shell('trap "" INT; echo ready >&2; exec sleep 1000')
    until = time.monotonic() + 60.0
    while process.log_text() != 'ready\n':
        assert time.monotonic() < until
        time.sleep(0.01)
    assert process.end() == -signal.SIGKILL
    assert process.returncode == -signal.SIGKILL


def test_one_that_has_ended_is_told_with_its_log(shell):
    process = shell('echo it broke >&2; exit 3')
    process.wait()
    with pytest.raises(RunError, match='client ended with 3:\nit broke'):
        process.check_alive()
