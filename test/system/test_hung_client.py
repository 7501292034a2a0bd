# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's process is stopped in mid-motion (SIGSTOP), as a debugger or a full memory does it.

How soon the arm stands is measured in virtual time: test/driver/test_hung_driver.py.
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
"""Of the controller, s: a machine that is busy holds nobody up for so long."""


PROFILE = """
like: {name}
name: waits
description: the same, with more patience
server: {{client_timeout: {seconds}}}
spel: {{config: {{FULL_POWER: 1, CLIENT_TIMEOUT: {seconds}}}}}
"""

LOOKS, BETWEEN_S = 20, 0.02
"""So many looks in a row at an arm that is not elsewhere show that it stands; and s between two:
at once, they may all fall into one cycle of a busy controller."""


def wait_until_it_stands(port: int) -> None:
    """Look at joint 1 by the remote port, as the driver hears and says nothing."""
    seen: list[str] = []
    while len(seen) < LOOKS or len(set(seen[-LOOKS:])) > 1:
        time.sleep(BETWEEN_S)
        seen += asyncio.run(execute('127.0.0.1', port, ['Sim,print,Agl(1)'], PATIENCE))


@pytest.mark.invariant(3, 4, 5)
@pytest.mark.parametrize(
    'name', ['simulated', 'rc700a', pytest.param('spel', marks=pytest.mark.slow)]
)
def test_a_stopped_client_finds_the_arm_stopped_and_its_goal_aborted(
    make_cell: Any, tmp_path: Path, name: str
) -> None:
    profile = tmp_path / 'waits.yaml'
    profile.write_text(PROFILE.format(name=name, seconds=TIMEOUT), encoding='utf-8')
    how = SPEL if name == 'spel' else '--motion=smooth'
    cell: Cell = make_cell(
        how, f'--controller={profile}', patience=False, controller=profile
    ).ready()
    peer = cell.peer
    usual = os.sched_getscheduler(cell.client.process_id) == os.SCHED_OTHER
    assert usual == ('keeps its normal priority' in cell.client.log.read_text(encoding='utf-8'))
    peer.enable()
    lasts = LASTS / 3 if name == 'spel' else LASTS  # a slower plan is refused
    goal = peer.goal(trajectory((0.0, START), (lasts, [FAR, *START[1:]])))
    peer.wait_for_motion()
    cell.client.send(signal.SIGSTOP)
    try:
        wait_until_it_stands(cell.ports.remote)
    finally:
        cell.client.send(signal.SIGCONT)
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert any(each in text for each in ('heard nothing', 'hung for', 'error 8004')), text
    here = peer.assert_still().tolist()
    assert START[0] < here[0] < FAR / 2
    ended, _, text = peer.goal(trajectory((0.0, here), (1.0, START))).result()
    assert ended == 'aborted'
    assert 'not enabled' in text
    peer.enable()
    assert peer.assert_still().tolist() == here
    ended, _, text = peer.goal(trajectory((0.0, here), (1.0, START))).result()
    assert ended == 'succeeded', text
