# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two drivers with the same name in one ROS domain do not move their arms."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support import patient
from support.cell import LASTS, TIMEOUTS
from support.fleet import Fleet
from support.ros_peer import PATIENCE, RosPeer, trajectory

from epson_driver.processes import processes

Answers = set[tuple[bool, str]]

PACE_S = 0.3


def enable_until(peer: RosPeer, good: Callable[[Answers], bool]) -> Answers:
    """Call `~/enable` until the replies satisfy `good`, and return them.

    Late replies of a slow driver would displace the awaited reply if calls followed immediately.
    """
    answers: Answers = set()
    until = time.monotonic() + PATIENCE
    while not good(answers):
        assert time.monotonic() < until, answers
        answers.add(peer.call('enable'))
        time.sleep(PACE_S)
    return answers


def is_enabled(answers: Answers) -> bool:
    return any(success for success, _ in answers)


@pytest.mark.invariant(10)
def test_inv10_second_driver_of_a_name_stops_both_and_no_other(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path, together=False).enabled()
    left, right = fleet.peers.values()
    other = processes.sim_controller(tmp_path / 'other.log', '--motion=ptp')
    ports = {'left': other.ports()}
    aborted = left.goal(trajectory((2.5 * LASTS, [2.6, *[0.0] * 5])))
    undisturbed = right.goal(trajectory((10.0, [1.0, *[0.0] * 5])))
    left.wait_for_motion()

    def start_second() -> processes.Process:
        log = tmp_path / 'second.log'
        return processes.clients(log, ports, fleet.domain, run=patient.COMMAND, **TIMEOUTS)

    both = (fleet.clients[0], start_second())
    fleet.clients.append(both[1])
    try:
        ended, _, text = aborted.result()
        assert ended == 'aborted'
        assert 'a second driver uses the same names: ' in text
        pids = [f'process {process.process_id % 2**16} ' for process in both]
        answers = enable_until(
            left, lambda replies: all(any(pid in text for _, text in replies) for pid in pids)
        )
        assert not is_enabled(answers)
        for process in both:
            assert 'a second driver uses the same names: ' in process.log_text()
        left.wait_for(
            lambda: any(
                value.value == 'SECOND_DRIVER'
                for message in left.diagnostics
                for status in message.status
                for value in status.values
            ),
            'the cause in /diagnostics',
        )
        both[1].end()
        assert left.assert_still()[0] < 2.5
        enable_until(left, is_enabled)
        assert undisturbed.result()[0] == 'succeeded'
    finally:
        fleet.close()
        other.end()


def test_killed_driver_blocks_its_successor_only_for_its_lease(
    make_cell: Any,
) -> None:
    cell = make_cell().ready()
    cell.client.kill()
    cell.restart_client()
    enable_until(cell.peer, is_enabled)
