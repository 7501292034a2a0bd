# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""smooth_goals in front of this driver (of a joint_trajectory_controller: test_genuine_ros.py)."""

import os
import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from resource import RUSAGE_CHILDREN

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from support import patient
from support.cell import LASTS, START, Cell
from support.ros_peer import JOINTS, RosPeer, trajectory

from epson_driver.processes import processes

FAR = [1.5, 0.5, -0.3, 0.4, -1.1, 0.6]
ACTION = '/epson_driver/follow_joint_trajectory'


class Front:
    """smooth_goals in front of a cell, and a peer that sends goals to it."""

    def __init__(self, folder: Path) -> None:
        self.cell = Cell(folder, '--motion=smooth').ready()
        self.cell.peer.enable()
        values = {'action': ACTION, 'limits_file': 'c3_a601s'} | dict.fromkeys(
            ('state_timeout', 'reply_timeout'), 45.0
        )
        words = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
        self.process = processes.Process(
            'smooth_goals',
            ['--ros-args', *words],
            folder / 'smooth_goals.log',
            processes.ros_environment(self.cell.domain),
            run=patient.COMMAND,
        )
        self.peer = RosPeer(self.cell.domain, node='smooth_goals')
        assert self.peer.action.wait_for_server(120.0)
        self.peer.wait_for(lambda: self.peer.joint_states, 'joint_states')

    def close(self) -> None:
        self.peer.close()
        self.process.end()
        self.cell.close()


@pytest.fixture
def front(tmp_path: Path) -> Iterator[Front]:
    one = Front(tmp_path)
    yield one
    one.close()


@pytest.mark.invariant(3, 5, 10)
def test_newest_goal_succeeds_and_a_canceled_one_ends_at_rest(front: Front) -> None:
    """Another publisher of joint_states changes no start, because the driver has its own topic."""
    publisher = front.peer.node.create_publisher(JointState, 'joint_states', 10)
    message = JointState(name=JOINTS[::-1], position=[1.0] * 6)
    stranger = front.peer.node.create_timer(0.02, lambda: publisher.publish(message))
    middle = [0.5, 0.2, 0.0, 0.1, -0.7, 0.2]
    goal = front.peer.goal(trajectory((0.0, START), (0.7, middle), (1.2, FAR)))
    result = goal.result()
    assert result[:2] == ('succeeded', 0), result
    assert goal.feedback[-1].joint_names == JOINTS
    assert np.abs(front.cell.peer.position() - FAR).max() < 1e-6
    stranger.cancel()
    goals = [
        front.peer.goal(trajectory((1.0, [FAR[0] + offset, *FAR[1:]])))
        for offset in (-0.3, 0.2, -0.1, -0.2)
    ]
    results = [goal.result() for goal in goals]
    assert [ended for ended, _, _ in results] == ['aborted'] * 3 + ['succeeded'], results
    goal = front.peer.goal(trajectory((LASTS, START)))
    front.cell.peer.wait_for_motion()
    goal.cancel()
    assert goal.result()[2] == f'canceled, {ACTION} stopped it, the arm is at rest'
    front.cell.peer.assert_still()


@pytest.mark.invariant(3, 9)
def test_end_of_the_process_stops_the_arm(front: Front) -> None:
    goal = front.peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    front.cell.peer.wait_for_motion()
    assert front.process.end(signal.SIGTERM) == 0
    assert goal.result()[2] == f'smooth_goals ends, {ACTION} stopped it, the arm is at rest'
    assert np.abs(front.cell.peer.assert_still() - FAR).max() > 0.1


def cpu_time(process_id: int) -> float:
    """Return the CPU time of a process, s."""
    fields = (
        Path(f'/proc/{process_id}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    )
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@pytest.mark.invariant(7, 9)
def test_inv7_inv9_planning_is_bounded_and_ends_with_the_process(front: Front) -> None:
    for seconds, limit in ((1e9, '86400 s'), (3600.0, '600 s')):
        text = front.peer.goal(trajectory((0.0, START), (seconds, FAR))).result()[2]
        assert 'point 1: time_from_start' in text
        assert limit in text
    angles = np.linspace(0.0, 500.0, 4000)
    waves = START + 0.3 * np.sin(np.outer(angles, np.arange(1, 7)) / 5)
    points = zip((angles * 1.19).tolist(), waves.tolist(), strict=True)
    goal, before = front.peer.goal(trajectory(*points)), cpu_time(front.process.process_id)
    front.peer.wait_for(
        lambda: cpu_time(front.process.process_id) > before + 2.0, 'the longest planning'
    )
    used, children = cpu_time(front.process.process_id), resource.getrusage(RUSAGE_CHILDREN)
    assert front.process.end(signal.SIGTERM) == 0
    ended = resource.getrusage(RUSAGE_CHILDREN)
    total = ended.ru_utime + ended.ru_stime - children.ru_utime - children.ru_stime
    assert total - used < 2.0
    assert goal.result()[2] == 'smooth_goals ends'
    front.cell.peer.assert_still()
