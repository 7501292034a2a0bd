# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in start-up, and again while an executable ends: no traceback, exit code 130 or 0."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.interrupts import obey_interrupts

from epson_driver.cli import processes
from epson_driver.cli.executables import EXECUTABLES

PATIENCE = 300.0
PAUSE = 0.01
"""Between one signal and the next, s."""

AT_IMPORT = """
import os, signal, sys
class AtImport:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, AtImport())
from epson_driver.cli.__main__ import main
sys.exit(main())
"""
"""Sends itself SIGINT where a module begins to be imported."""


LOADED = [
    *((name, f'epson_driver.cli.{name}') for name in EXECUTABLES),
    ('client', 'rclpy'),
    ('client', 'epson_driver.node.node'),
    ('demo', 'rclpy'),
    ('sim_controller', 'numpy'),
    ('smooth', 'ruckig'),
]


@pytest.mark.parametrize(('name', 'module'), LOADED)
def test_ctrl_c_while_an_executable_is_loaded_ends_it_without_a_traceback(
    name: str, module: str
) -> None:
    run = subprocess.run(
        [sys.executable, '-c', AT_IMPORT.format(module=module), name, '--help'],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        preexec_fn=obey_interrupts,
    )
    assert (run.returncode, run.stdout, run.stderr) == (130, '', '')


def test_ctrl_c_before_an_executable_handles_it_itself() -> None:
    code = (
        'import os, signal, sys\n'
        'from epson_driver.cli import robots\n'
        'from epson_driver.cli.__main__ import main\n'
        'robots.main = lambda: os.kill(os.getpid(), signal.SIGINT)\n'
        'sys.exit(main())'
    )
    command = [sys.executable, '-c', code, 'robots']
    run = subprocess.run(
        command, capture_output=True, text=True, check=False, preexec_fn=obey_interrupts
    )
    assert (run.returncode, run.stdout, run.stderr) == (130, '', '')


def test_ctrl_c_ends_a_loop_and_does_nothing_from_then_on() -> None:
    """Not even in the moment in which the loop closes, wherever the process is then."""
    code = (
        'import asyncio, os, signal\n'
        'from epson_driver.cli.interrupt import ended_by_signals\n'
        'def interrupt(): os.kill(os.getpid(), signal.SIGINT)\n'
        'async def main():\n'
        '    loop, end = asyncio.get_running_loop(), asyncio.Event()\n'
        '    with ended_by_signals(loop, end.set):\n'
        '        loop.call_soon(interrupt)\n'
        '        await end.wait()\n'
        '        interrupt()\n'
        '    close = loop.close\n'
        '    def interrupted_close(): interrupt(); close(); interrupt()\n'
        '    loop.close = interrupted_close\n'
        '    interrupt()\n'
        'asyncio.run(main())\n'
        'interrupt()\n'
        "print('ended', signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)"
    )
    run = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=obey_interrupts,
    )
    assert (run.returncode, run.stdout, run.stderr) == (0, 'ended True\n', '')


def interrupted(process: subprocess.Popen[str]) -> str:
    """Send SIGINT until the process has ended; return what it said after that began."""
    until = time.monotonic() + PATIENCE
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        time.sleep(PAUSE)
        assert time.monotonic() < until, 'it does not end'
    assert process.stdout is not None
    with process.stdout:
        return process.stdout.read()


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start executables in a ROS domain of their own; they end with the test."""
    all_started: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*processes.EXECUTABLE, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=processes.ros_environment(processes.free_ros_domain()),
        )
        all_started.append(process)
        return process

    yield start
    for process in all_started:
        process.kill()
        process.wait()


def line_with(process: subprocess.Popen[str], text: str) -> str:
    """Wait until the process has said something; return the line."""
    assert process.stdout is not None
    said = ''
    for line in process.stdout:
        said += line
        if text in line:
            return line
    raise AssertionError(said)


@pytest.mark.invariant(9)
def test_more_of_ctrl_c_while_controller_and_client_end(
    started: Callable[..., subprocess.Popen[str]],
) -> None:
    free = [f'--{name}-port=0' for name in ('motion', 'state', 'io', 'remote')]
    controller = started('sim_controller', *free)
    ports = dict(re.findall(r'(\w+)=(\d+)', line_with(controller, 'listening ')))
    settings = [f'{name}_port:={ports[name]}' for name in ('motion', 'state')]
    client = started('client', '--ros-args', *(w for each in settings for w in ('-p', each)))
    line_with(client, 'state link connected')
    for process in (client, controller):
        said = interrupted(process)
        assert process.returncode in (0, 130), said
        assert 'Traceback' not in said
        assert 'KeyboardInterrupt' not in said


@pytest.mark.invariant(9)
def test_more_of_ctrl_c_while_the_demo_ends_leaves_nothing_running(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    demo = started('demo', f'--picture={tmp_path / "report.png"}')
    line_with(demo, 'sim_controller: rc620 (simulated), c3_a601s, 127.0.0.1:')
    children = Path(f'/proc/{demo.pid}/task/{demo.pid}/children').read_text().split()
    assert children
    said = interrupted(demo)
    assert demo.returncode == 130, said
    assert 'Traceback' not in said
    assert [child for child in children if Path('/proc', child).exists()] == []
