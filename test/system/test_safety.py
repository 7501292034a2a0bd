# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Stops and the conditions for the next motion, end to end."""

import random
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from control_msgs.action import FollowJointTrajectory
from support import in_terminal
from support.cell import LASTS, PROGRAMS, START, Cell, cell_with
from support.ros_peer import RosPeer, trajectory

from epson_driver.share import share_path

FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


def long_motion() -> Any:
    """Return a trajectory that lasts longer than any delay of a test."""
    return trajectory((0.0, START), (LASTS, FAR))


@pytest.fixture(scope='module', params=PROGRAMS)
def cell(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """Yield a cell, one per program. Every test leaves its driver and controller working."""
    with closing(cell_with(tmp_path_factory.mktemp('cell'), request.param)) as one:
        yield one.ready()


def enabled_at_start(cell: Cell) -> RosPeer:
    peer = cell.peer
    peer.enable()
    here = peer.position()
    if not np.allclose(here, START, atol=1e-3):
        ended, _, text = peer.goal(trajectory((0.0, here.tolist()), (1.0, START))).result()
        assert ended == 'succeeded', text
    return peer


def assert_disabled(cell: Cell, *words: str) -> None:
    """Assert that a goal is rejected with the reason, and that nothing moves."""
    here = cell.peer.assert_still().tolist()
    there = [here[0] + 0.1, *here[1:]]
    ended, code, text = cell.peer.goal(trajectory((0.0, here), (1.0, there))).result()
    assert (ended, code) == ('aborted', -1), text
    assert 'not enabled' in text
    for word in words:
        assert word in text
    assert np.array_equal(cell.peer.assert_still(), here)


def assert_works_after_enable(cell: Cell) -> None:
    cell.peer.enable()
    here = cell.peer.position().tolist()
    there = [here[0] + 0.05, *here[1:]]
    ended, _, text = cell.peer.goal(trajectory((0.0, here), (0.5, there))).result()
    assert ended == 'succeeded', text


@pytest.mark.invariant(4)
def test_inv4_nothing_moves_before_the_first_enable(cell: Cell) -> None:
    """This must be the first test of the file, with a new cell."""
    assert_disabled(cell, 'since the driver started')
    status = cell.peer.robot_status[-1]
    assert status.drives_powered.val == 0
    assert_works_after_enable(cell)


def test_estop_stops_the_arm_until_reset_and_enable(cell: Cell) -> None:
    peer = enabled_at_start(cell)
    goal = peer.goal(long_motion())
    peer.wait_for_motion()
    cell.pendant('estop', 'press')
    ended, code, text = goal.result()
    assert (ended, code) == ('aborted', -4)
    assert 'E-stop' in text
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 1, 'e_stopped in robot_status')
    status = peer.robot_status[-1]
    assert status.mode.val == 2
    assert status.drives_powered.val == 0
    assert list(status.error_codes) == [2261]
    peer.wait_until_still()
    assert_disabled(cell, 'E-stop')
    success, message = peer.call('enable')
    assert not success
    assert 'release' in message
    cell.pendant('estop', 'release')
    assert_disabled(cell, 'E-stop')
    assert peer.call('reset_error')[0]
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 0, 'E-stop reset')
    assert_disabled(cell, 'E-stop')
    assert_works_after_enable(cell)


@pytest.mark.invariant(6)
def test_killed_controller_ends_the_goal_and_is_reconnected(cell: Cell) -> None:
    peer = enabled_at_start(cell)
    goal = peer.goal(long_motion())
    peer.wait_for_motion()
    cell.controller.kill()
    ended, code, text = goal.result()
    assert (ended, code) == ('aborted', -4)
    assert 'link was lost' in text
    peer.wait_for(lambda: peer.link_states[-1] != 'connected', 'link_state')
    # invariant 6: joint_states stop, robot_status is unknown
    silent = len(peer.joint_states)
    peer.wait_for(lambda: peer.robot_status[-1].mode.val == -1, 'robot_status while down')
    assert len(peer.joint_states) == silent
    assert peer.robot_status[-1].e_stopped.val == -1
    assert peer.robot_status[-1].drives_powered.val == -1
    seen = len(peer.diagnostics)
    peer.wait_for(lambda: len(peer.diagnostics) > seen, 'diagnostics')
    arms = [s for s in peer.diagnostics[-1].status if s.name.endswith(': arm')]
    assert arms[0].level == b'\x03'
    cell.restart_controller()
    peer.wait_for(lambda: len(peer.joint_states) > silent, 'joint states after the restart')
    peer.wait_for(lambda: peer.link_states[-1] == 'connected', 'connected again')
    assert_disabled(cell, 'link was lost')
    assert_works_after_enable(cell)


def test_killed_client_leaves_the_arm_at_rest_and_disabled(cell: Cell) -> None:
    peer = enabled_at_start(cell)
    peer.goal(long_motion())
    peer.wait_for_motion()
    cell.client.kill()
    cell.restart_client()
    peer = cell.peer
    position = peer.assert_still()
    assert 0.0 < position[0] < 1.4
    peer.wait_for(
        lambda: peer.robot_status and peer.robot_status[-1].drives_powered.val == 0,
        'motors off after a lost client',
    )
    assert_disabled(cell, 'since the driver started')
    assert_works_after_enable(cell)


@pytest.mark.parametrize('program', PROGRAMS)
def test_silent_controller_ends_the_goal(make_cell: Any, program: str) -> None:
    """A stopped process keeps its connections open, like a pulled cable.

    The time-out is longer than a stall of a busy machine, so the controller is not silent before.
    """
    cell = make_cell(program=program, state_timeout=3.0).ready()
    peer = enabled_at_start(cell)
    goal = peer.goal(long_motion())
    peer.wait_for_motion()
    cell.controller.send(signal.SIGSTOP)
    ended, code, text = goal.result()
    assert (ended, code) == ('aborted', -4)
    assert 'silent for 3 s' in text
    cell.controller.send(signal.SIGCONT)
    peer.wait_for(lambda: peer.link_states[-1] == 'connected', 'connected again')
    peer.wait_until_still()  # by the driver's STOP over the motion link
    assert_disabled(cell, 'silent')
    assert_works_after_enable(cell)


@pytest.mark.invariant(3)
@pytest.mark.parametrize(
    ('number', 'run'),
    [
        (signal.SIGTERM, ()),
        (signal.SIGUSR1, (sys.executable, in_terminal.__file__)),
    ],
    ids=['SIGTERM', 'terminal closed'],
)
def test_inv3_interrupted_client_stops_the_arm_and_ends_cleanly(
    make_cell: Any, number: int, run: tuple[str, ...]
) -> None:
    cell = make_cell(run=run).ready()
    peer = enabled_at_start(cell)
    start = peer.position()
    goal = peer.goal(long_motion())
    peer.wait_for_motion(start)
    assert cell.client.end(number) == 0
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert 'shut down' in text
    cell.restart_client()
    assert cell.peer.assert_still()[0] < 1.4


STALLS, WAITING = 6, 4
"""Number of stalls, and of goals sent in each by action and by topic."""


@pytest.mark.invariant(4)
def test_inv4_goals_queued_in_a_stalled_driver_do_not_start_after_stop(
    cell: Cell,
) -> None:
    """rclpy delivers these goals after the stop, although the stop was sent last."""
    peer = enabled_at_start(cell)
    message = trajectory((LASTS, FAR))
    goal = FollowJointTrajectory.Goal(trajectory=message)
    for _ in range(STALLS):
        cell.client.send(signal.SIGSTOP)
        try:
            for _ in range(WAITING):
                peer.in_executor(lambda: peer.action.send_goal_async(goal))
                peer.trajectory_topic.publish(message)
            time.sleep(0.1)  # the goals are sent first
            stop = peer.begin_call('stop')
        finally:
            cell.client.send(signal.SIGCONT)
        assert peer.complete(stop).success
        peer.assert_still()


RACES = 20


@pytest.mark.invariant(4)
def test_inv4_pending_enable_does_not_enable_after_disable(make_cell: Any) -> None:
    peer = make_cell(program='spel').ready().peer
    chance = random.Random(4)
    here = peer.position().tolist()
    there = [here[0] + 0.1, *here[1:]]
    for _ in range(RACES):
        enabling = peer.begin_call('enable')
        time.sleep(chance.uniform(0.0, 0.08))  # a random moment, not a wait
        success, message = peer.call('disable')
        assert success, message
        assert 'the motors are off' in message
        peer.complete(enabling)
        ended, _, text = peer.goal(trajectory((0.0, here), (1.0, there))).result()
        assert ended == 'aborted', text
        assert 'disabled on request' in text or 'not enabled' in text
    assert peer.assert_still().tolist() == here
    peer.enable()
    ended, _, text = peer.goal(trajectory((0.0, here), (1.0, there))).result()
    assert ended == 'succeeded', text


@pytest.mark.invariant(3)
def test_inv3_controller_that_ignores_stop_loses_its_motors(
    make_cell: Any, tmp_path: Path
) -> None:
    project = tmp_path / 'deaf'
    shutil.copytree(share_path('controller_program', 'motion.prg').parent, project)
    program = (project / 'motion.prg').read_text(encoding='utf-8')
    stops = 'If sequence = SEQ_STOP_TRAJECTORY Then\n    DropPoints\n'
    assert program.count(stops) == 1
    deaf = program.replace(stops, stops.replace('DropPoints', 'Exit Function'))
    (project / 'motion.prg').write_text(deaf, encoding='utf-8')
    profile = tmp_path / 'deaf.yaml'
    profile.write_text(
        f'like: spel\nname: deaf\ndescription: does not stop\nspel:\n  project: {project}\n',
        encoding='utf-8',
    )
    options = {'patience': False, 'controller': 'spel', 'smoothing': 'none'}
    cell: Cell = make_cell(f'--controller={profile}', **options).ready()
    peer = cell.peer
    peer.enable()
    goal = peer.goal(trajectory((0.0, START), (LASTS, [1.5, *START[1:]])))
    peer.wait_for_motion()
    success, message = peer.call('stop')
    assert not success, message
    assert 'STOP' in message
    peer.wait_for(lambda: peer.robot_status[-1].drives_powered.val == 0, 'drives off')
    assert peer.wait_until_still()[0] < 1.4
    assert goal.result()[0] == 'aborted'

    def alarm() -> bool:
        arms = [status for status in peer.diagnostics[-1].status if status.name.endswith(': arm')]
        return any(arm.level == b'\x02' and 'STOP failed' in arm.message for arm in arms)

    peer.wait_for(alarm, 'diagnostics')
    ended, _, text = peer.goal(trajectory((0.0, START), (1.0, START))).result()
    assert ended == 'aborted'
    assert 'not enabled' in text
