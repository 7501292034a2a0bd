# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ROS domains of processes, starting and ending processes, and values passed to workers."""

import asyncio
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
import zlib
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from support.examples import examples

from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import PASSED_TYPES, Smoother, plan
from epson_driver.processes import processes, worker
from epson_driver.processes.processes import (
    Ports,
    Process,
    RunError,
    ended_at_exit,
    free_ros_domain,
    ros_environment,
    sim_controller,
)
from epson_driver.processes.worker import MAX_BYTES, PREFIX, body_length, packed, unpacked
from epson_driver.robots import load_robot_model


def domain_port(domain):
    """Return the port of the first participant of a domain (DDSI-RTPS 9.6.1)."""
    return 7400 + 250 * domain + 10


def bound(domain):
    """Return a socket that keeps a domain busy."""
    held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    held.bind(('', domain_port(domain)))
    return held


@pytest.fixture
def unclaimed(monkeypatch):
    """Start without claimed domains. The claims end with the test."""
    claims = deque()
    monkeypatch.setattr(processes, 'claims', claims)
    yield claims
    while claims:
        claims.pop().close()


def two_domains(claims):
    """Return two domains that are free and not claimed."""
    domains = [free_ros_domain(), free_ros_domain()]
    while claims:
        claims.pop().close()
    return domains


def test_domain_with_a_bound_port_is_avoided(monkeypatch, unclaimed):
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


def test_chosen_domain_is_claimed(monkeypatch, unclaimed):
    monkeypatch.setattr(processes, 'SAFE_DOMAINS', domains := two_domains(unclaimed))
    assert {free_ros_domain(), free_ros_domain()} == set(domains)
    with pytest.raises(RunError, match='in use'):
        free_ros_domain()
    other = (
        'from epson_driver.processes import processes\n'
        f'processes.SAFE_DOMAINS = {domains}\n'
        'print(processes.free_ros_domain())'
    )
    run = subprocess.run([sys.executable, '-c', other], capture_output=True, text=True)
    assert 'in use' in run.stderr
    unclaimed.popleft().close()
    run = subprocess.run([sys.executable, '-c', other], capture_output=True, text=True)
    assert int(run.stdout) in domains


def test_environment_limits_ros_to_this_machine_and_domain(monkeypatch):
    monkeypatch.setenv('SOMETHING_ELSE', 'kept')
    environment = ros_environment(42)
    assert environment['ROS_DOMAIN_ID'] == '42'
    assert environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert environment['SOMETHING_ELSE'] == 'kept'
    assert os.environ.get('ROS_DOMAIN_ID') != '42'


def test_sim_controller_starts_on_free_ports_and_ends_cleanly(tmp_path):
    process = sim_controller(tmp_path / 'log.txt')
    with ended_at_exit(process):
        ports = process.ports()
        assert len({ports.motion, ports.state, ports.io, ports.remote}) == 4
        for port in (ports.motion, ports.state, ports.io, ports.remote):
            socket.create_connection(('127.0.0.1', port), timeout=5.0).close()
        assert process.returncode is None
        assert process.end() == 0
    assert process.returncode == 0


def test_failed_start_of_sim_controller_has_a_reason(tmp_path):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        process = sim_controller(tmp_path / 'log.txt', ports=Ports(port, 0, 0, 0))
        with ended_at_exit(process), pytest.raises(RunError) as caught:
            process.ports()
    text = str(caught.value)
    assert 'sim_controller did not start' in text
    assert f'motion port 127.0.0.1:{port}' in text


def test_process_is_ended_after_an_exception(tmp_path):
    process = sim_controller(tmp_path / 'log.txt')

    def work():
        with ended_at_exit(process):
            process.ports()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert process.returncode == 0


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


def test_process_that_ignores_signals_is_killed(shell, monkeypatch):
    monkeypatch.setattr(processes, 'END_TIMEOUT_S', 0.1)
    process = shell('trap "" INT; echo ready >&2; exec sleep 1000')
    until = time.monotonic() + 60.0
    while process.log_text() != 'ready\n':
        assert time.monotonic() < until
        time.sleep(0.01)
    assert process.end() == -signal.SIGKILL
    assert process.returncode == -signal.SIGKILL


def test_ended_process_is_reported_with_its_log(shell):
    process = shell('echo it broke >&2; exit 3')
    process.wait()
    with pytest.raises(RunError, match='client ended with 3:\nit broke'):
        process.check_alive()


LIMITS = load_robot_model('c3_a601s').limits


@dataclass(frozen=True, eq=False)
class Thing:
    """A class that cannot be passed to another process."""

    name: str
    values: np.ndarray
    inner: 'Thing | None' = None
    more: tuple = field(default=())


THINGS = (Thing,)

NUMBERS = arrays.arrays(
    st.sampled_from([np.float64, np.int64, np.bool_]), arrays.array_shapes(min_side=0, max_side=5)
)

PLAIN = (
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=5)
)

VALUES = st.recursive(
    PLAIN | NUMBERS,
    lambda inner: (
        st.lists(inner, max_size=3).map(tuple)
        | st.builds(Thing, st.text(max_size=3), NUMBERS, st.none(), st.tuples(inner))
    ),
    max_leaves=6,
)


def same(one, other):
    """Return whether two values are equal, to the last bit."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, Thing):
        fields = Thing.__match_args__
        return all(same(getattr(one, name), getattr(other, name)) for name in fields)
    return one == other or (one != one and other != other)


@settings(max_examples=examples(300))
@given(VALUES)
def test_value_survives_a_round_trip_through_the_pipe_exactly(value):
    assert same(unpacked(packed(value), THINGS), value)


def test_planning_requests_and_replies_survive_the_round_trip():
    smoother = Smoother(LIMITS, np.zeros(6), planner=None)
    smoother.append(np.full(6, 0.2), 0.5)
    smoother.finish()
    request = smoother.request()
    again, limits = unpacked(packed((request, LIMITS)), PASSED_TYPES)
    assert isinstance(limits, JointLimits)
    assert limits.names == LIMITS.names
    expected, result = plan(request, LIMITS), plan(again, limits)
    assert expected is not None
    assert result is not None
    assert result.timing.times.tobytes() == expected.timing.times.tobytes()
    answer = unpacked(packed(expected), PASSED_TYPES)
    assert answer.knots.position.tobytes() == expected.knots.position.tobytes()


@pytest.mark.parametrize(
    'value', [object(), {1, 2}, np.array([None]), np.array(['x']), b'bytes', np.zeros(2, 'c16')]
)
def test_value_that_the_pipe_does_not_support_is_refused(value):
    with pytest.raises(TypeError, match='cannot be passed'):
        packed((value,))


GOOD = packed(Thing('x', np.arange(4.0), Thing('y', np.array([True, False])), (1, 2.5)))


@pytest.mark.invariant(7)
@settings(max_examples=examples(500))
@given(st.integers(0, len(GOOD) - 1), st.integers(1, 255), st.integers(0, len(GOOD)))
def test_inv7_corrupted_bytes_are_an_error(index, change, kept):
    changed = bytearray(GOOD)
    changed[index] ^= change
    for bad in (bytes(changed), GOOD[:kept] if kept < len(GOOD) else b'', GOOD + b'\0'):
        with pytest.raises(ValueError, match='bytes without a value'):
            unpacked(bad, THINGS)


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'text',
    [
        b'{"Thing": []}',
        b'{"Other": [1]}',
        b'{"Thing": 3}',
        b'{}',
        b'{"a": 1, "b": 2}',
        b'{"array": ["|O", [1], 0]}',
        b'{"array": ["<f8", [9], 0]}',
        b'{"array": ["<f8", [1], -8]}',
        b'{"array": ["<f8", [99999999999999999999], 0]}',
        b'{"array": ["<f8", "x", 0]}',
        b'{"array": ["<f8"]}',
        b'[' * 100_000,
        b'9' * 5_000,
        b'"\xff"',
        b'',
    ],
)
def test_inv7_invalid_text_with_a_valid_checksum_is_an_error(text):
    with pytest.raises(ValueError, match='bytes without a value'):
        unpacked(PREFIX.pack(zlib.crc32(text), len(text), 0) + text, THINGS)


@pytest.mark.invariant(7)
def test_inv7_pickle_is_not_executed(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / 'PWNED'), 'w'))

    data = pickle.dumps(Trap())
    with pytest.raises(ValueError, match='without a value'):
        unpacked(data, THINGS)
    assert not list(tmp_path.iterdir())


@pytest.mark.invariant(7)
def test_inv7_excessive_length_is_an_error():
    assert body_length(GOOD[: PREFIX.size]) == len(GOOD) - PREFIX.size
    with pytest.raises(ValueError, match=f' bytes, but the limit is {MAX_BYTES}'):
        body_length(PREFIX.pack(0, 1, MAX_BYTES))


@pytest.mark.invariant(9)
def test_inv9_worker_ends_although_the_waiter_was_canceled():
    async def check():
        process = await asyncio.create_subprocess_exec('sleep', '60')
        ending = asyncio.create_task(worker.end_worker(process))
        await asyncio.sleep(0)
        ending.cancel()
        with pytest.raises(asyncio.CancelledError):
            await ending
        assert process.returncode == -signal.SIGKILL
        await worker.end_worker(process)  # a second call has no effect

    asyncio.run(check())


def test_processes_are_signalled_before_waiting():
    calls = []

    class Ending:
        returncode = None

        def __init__(self, name):
            self.name = name

        def send(self, number):
            calls.append((self.name, number))

        def ended(self):
            calls.append(self.name)

    processes.end_together([Ending('a'), Ending('b')])
    assert calls == [('a', signal.SIGINT), ('b', signal.SIGINT), 'a', 'b']


INTERRUPTED_START = """
import signal, subprocess, sys
from pathlib import Path
from epson_driver.processes import processes

class InterruptedStart(subprocess.Popen):
    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        print(self.pid, flush=True)
        signal.raise_signal(signal.SIGINT)

subprocess.Popen = InterruptedStart
signal.signal(signal.SIGINT, signal.default_int_handler)  # also where the shell ignores SIGINT
processes.Process('600', [], Path(sys.argv[1]), {}, ['/bin/sleep'])
"""


def test_process_that_is_interrupted_while_it_starts_another_ends_that(tmp_path):
    command = [sys.executable, '-c', INTERRUPTED_START, str(tmp_path / 'log')]
    run = subprocess.run(command, capture_output=True, check=False, text=True)
    assert run.stderr.endswith('KeyboardInterrupt\n')
    with pytest.raises(ProcessLookupError):
        os.kill(int(run.stdout), 0)


INTERRUPTED_FINALIZER = """
import signal, sys, time
from epson_driver.processes.interrupt import raise_at_first_signal

class Finalized:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)

raise_at_first_signal()
try:
    Finalized()
    time.sleep(30)
except KeyboardInterrupt:
    sys.exit(130)
"""


def test_signal_that_arrives_in_a_finalizer_is_not_lost():
    run = subprocess.run(
        [sys.executable, '-c', INTERRUPTED_FINALIZER], capture_output=True, check=False, text=True
    )
    assert (run.returncode, run.stderr) == (130, '')
