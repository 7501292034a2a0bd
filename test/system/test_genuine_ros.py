# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Genuine ros2 launch, ros2_control and MoveIt move a simulated arm. Skipped without them."""

import random
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import ActionClient
from support.ros_peer import JOINTS, Goal, RosPeer, trajectory

from epson_driver.processes import processes

TARGET = [0.3, 0.1, 0.2, 0.0, -0.5, 0.0]
GOAL_TIME_S = 3.0
LAUNCH = ('ros2', 'launch', 'epson_driver')

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which('ros2') is None, reason='no ros2: a ROS machine has it'),
]


class Launched:
    """A launch file with a simulated controller, and a peer of its driver."""

    def __init__(self, folder: Path, file: str, **arguments: str) -> None:
        self.domain = processes.free_ros_domain()
        address = f'127.{random.randrange(1, 255)}.{random.randrange(256)}.1'
        values = {'use_sim_controller': 'true', 'robot_ip': address} | arguments
        self.process = processes.Process(
            file,
            [f'{name}:={value}' for name, value in values.items()],
            folder / 'launch.log',
            processes.ros_environment(self.domain),
            LAUNCH,
        )
        self.peer = RosPeer(self.domain)
        self.peer.wait_for(lambda: self.peer.joint_states, 'joint_states')
        self.peer.enable()

    def close(self) -> None:
        self.peer.close()
        self.process.end()

    def reaches_target(self) -> None:
        """Wait until the arm is at TARGET."""

        def there() -> bool:
            latest = self.peer.joint_states[-1]
            at = dict(zip(latest.name, latest.position, strict=True))
            return [at[name] for name in JOINTS] == pytest.approx(TARGET, abs=1e-3)

        self.peer.wait_for(there, 'arrival')


@pytest.fixture
def launched(tmp_path: Path) -> Iterator[Any]:
    cells: list[Launched] = []

    def start(file: str, **arguments: str) -> Launched:
        cells.append(Launched(tmp_path, file, **arguments))
        return cells[-1]

    yield start
    for cell in cells:
        cell.close()


def test_joint_trajectory_controller_moves_the_arm(launched: Any) -> None:
    pytest.importorskip('controller_manager_msgs')
    cell = launched('robot_interface.launch.py', ros2_control='true')
    controller = RosPeer(cell.domain, node='joint_trajectory_controller')
    try:
        assert controller.action.wait_for_server(60.0)
        goal = Goal(controller, trajectory((GOAL_TIME_S, TARGET)))
        status, code, text = goal.result()
        assert (status, code) == ('succeeded', 0), text
        cell.reaches_target()
    finally:
        controller.close()


def test_move_group_moves_the_arm_and_its_death_fails_the_launch(launched: Any) -> None:
    messages = pytest.importorskip('moveit_msgs.msg')
    actions = pytest.importorskip('moveit_msgs.action')
    cell = launched('moveit_planning_execution.launch.py', launch_rviz='false')
    client = ActionClient(cell.peer.node, actions.MoveGroup, 'move_action')
    assert client.wait_for_server(60.0)
    tolerances = {'tolerance_above': 1e-4, 'tolerance_below': 1e-4}
    joints = [
        messages.JointConstraint(joint_name=name, position=position, weight=1.0, **tolerances)
        for name, position in zip(JOINTS, TARGET, strict=True)
    ]
    goal = actions.MoveGroup.Goal()
    goal.request.group_name = 'manipulator'
    goal.request.allowed_planning_time = 10.0
    goal.request.max_velocity_scaling_factor = goal.request.max_acceleration_scaling_factor = 0.3
    goal.request.goal_constraints = [messages.Constraints(joint_constraints=joints)]
    handle = cell.peer.complete(cell.peer.in_executor(lambda: client.send_goal_async(goal)))
    answer = cell.peer.complete(cell.peer.in_executor(handle.get_result_async))
    assert answer.result.error_code.val == messages.MoveItErrorCodes.SUCCESS
    cell.reaches_target()
    children = ['--parent', str(cell.process.process_id), '--exact', 'move_group']
    subprocess.run(['pkill', '--signal', 'KILL', *children], check=True)
    assert cell.process.wait(30.0) == 1
