# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's process stalls during a motion (SIGSTOP), like in a debugger or while swapping.

test/driver/test_hung_driver.py measures the stopping time, in virtual time.
"""

import asyncio
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from support.cell import LASTS, SPEL, START, Cell
from support.ros_peer import PATIENCE, trajectory

from epson_driver.remote_ethernet.client import execute

FAR = 2.0
TIMEOUT = 2.0
"""The controller's client timeout, s, longer than a stall of a busy machine."""


PROFILE = f"""
like: spel
name: waits
description: the same with a longer timeout
server: {{client_timeout: {TIMEOUT}}}
"""

EQUAL_SAMPLES, BETWEEN_S = 20, 0.02
"""Number of equal samples that prove standstill, and the time between two, s.
Without a pause, all samples could fall into one cycle of a busy controller."""


def wait_until_at_rest(port: int) -> None:
    """Poll joint 1 through the remote port, because the driver is stopped."""
    seen: list[str] = []
    while len(seen) < EQUAL_SAMPLES or len(set(seen[-EQUAL_SAMPLES:])) > 1:
        time.sleep(BETWEEN_S)
        seen += asyncio.run(execute('127.0.0.1', port, ['Sim,print,Agl(1)'], PATIENCE))


@pytest.mark.invariant(3, 4, 5)
def test_stalled_client_finds_the_arm_stopped_and_the_goal_aborted(
    make_cell: Any, tmp_path: Path
) -> None:
    profile = tmp_path / 'waits.yaml'
    profile.write_text(PROFILE, encoding='utf-8')
    cell: Cell = make_cell(SPEL, f'--controller={profile}', patience=False, controller=profile)
    cell.ready()
    peer = cell.peer
    usual = os.sched_getscheduler(cell.client.process_id) == os.SCHED_OTHER
    assert usual == ('keeps its normal priority' in cell.client.log.read_text(encoding='utf-8'))
    peer.enable()
    lasts = LASTS / 3  # a slower plan is rejected
    goal = peer.goal(trajectory((0.0, START), (lasts, [FAR, *START[1:]])))
    peer.wait_for_motion()
    cell.client.send(signal.SIGSTOP)
    try:
        time.sleep(1.5 * TIMEOUT)  # the arm may rest before, if it has reached all its points
        wait_until_at_rest(cell.ports.remote)
    finally:
        cell.client.send(signal.SIGCONT)
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert any(cause in text for cause in ('was silent', 'was stalled for', 'error 8004')), text
    here = peer.assert_still().tolist()
    assert START[0] < here[0] < FAR / 2
    ended, _, text = peer.goal(trajectory((0.0, here), (1.0, START))).result()
    assert ended == 'aborted'
    assert 'not enabled' in text
    peer.enable()
    assert peer.assert_still().tolist() == here
    ended, _, text = peer.goal(trajectory((0.0, here), (1.0, START))).result()
    assert ended == 'succeeded', text
