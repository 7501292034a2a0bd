# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver fleet`: its table, and its end without remaining processes."""

import io
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from rich.console import Console
from support.interrupts import obey_interrupts

from epson_driver.cli.fleet import Row, table
from epson_driver.processes import processes

PATIENCE_S = 300.0
WELL = Row('robot_1', 'connected', 182.0, 0.15, 150_000_000)


@pytest.mark.parametrize(
    ('row', 'cells'),
    [
        (WELL, 'robot_1 | yes | 182 Hz | 15 % | 150 MB'),
        (
            WELL._replace(state='client ended: 1'),
            'robot_1 | client ended: 1 | 182 Hz | 15 % | 150 MB',
        ),
        (WELL._replace(state='backing_off'), 'robot_1 | backing off | 182 Hz | 15 % | 150 MB'),
        (WELL._replace(rate=0.0), 'robot_1 | connected | 0 Hz | 15 % | 150 MB'),
    ],
)
def test_table_has_a_row_per_robot_and_a_summary(row: Row, cells: str) -> None:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table([row, WELL]))
    lines = [re.split('  +', line.strip()) for line in console.export_text().splitlines()]
    assert lines[1] == cells.split(' | ')
    slowest, up = f'{row.rate:.0f} Hz', 2 if row is WELL else 1
    assert lines[3] == ['all', f'{up} of 2', slowest, '30 %', '300 MB']


def left_running() -> list[str]:
    """Return the ids of all processes with the environment variable of this test."""
    mark = f'OF_THIS_FLEET={os.getpid()}'.encode()
    result = []
    for path in Path('/proc').glob('[0-9]*'):
        try:
            if (
                mark in (path / 'environ').read_bytes().split(b'\0')
                and (path / 'cmdline').read_bytes()
            ):
                result.append(path.name)
        except (FileNotFoundError, ProcessLookupError, PermissionError):
            continue
    return result


@pytest.mark.slow
@pytest.mark.parametrize('interrupted', [False, True], ids=['after a time', 'by Ctrl-C'])
def test_two_robots_run_and_leave_no_process(interrupted: bool) -> None:
    words = ['fleet', '--robots=2'] if interrupted else ['fleet', '--robots=2', '--seconds=1']
    environment = os.environ | {'OF_THIS_FLEET': str(os.getpid()), 'COLUMNS': '140'}
    fleet = subprocess.Popen(
        [*processes.EXECUTABLE, *words],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
        preexec_fn=obey_interrupts,
    )
    assert fleet.stdout is not None
    with fleet:
        output = ''.join(
            iter(fleet.stdout.readline, 'export ROS_SUPER_CLIENT=TRUE  # for ros2 topic list\n')
        )
        if interrupted:
            assert len(left_running()) >= 6  # two drivers, two controllers, server, itself
            fleet.send_signal(signal.SIGINT)
        output += fleet.communicate(timeout=PATIENCE_S)[0]
    assert fleet.returncode == 0, output
    assert 'all up' in output
    assert 'export ROS_DISCOVERY_SERVER=127.0.0.1:' in output
    assert re.search(r'all +2 of 2 ', output)
    assert left_running() == []
