# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Genuine ros2 launch, ros2_control, MoveIt and its Servo move an arm. Skipped without them."""

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from control_msgs.msg import JointJog
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Header
from support.ros_peer import JOINTS, Goal, RosPeer, trajectory

from epson_driver.processes import processes
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / 'examples' / 'moveit_goal.py'

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


def test_joint_trajectory_controller_moves_the_arm(launched: Any, tmp_path: Path) -> None:
    pytest.importorskip('controller_manager_msgs')
    cell = launched('robot_interface.launch.py', ros2_control='true')
    with closing(RosPeer(cell.domain, node='joint_trajectory_controller')) as controller:
        assert controller.action.wait_for_server(60.0)
        goal = Goal(controller, trajectory((GOAL_TIME_S, TARGET)))
        status, code, text = goal.result()
        assert (status, code) == ('succeeded', 0), text
        cell.reaches_target()
        smooth_goal_is_braked(cell, tmp_path)


def smooth_goal_is_braked(cell: Launched, folder: Path) -> None:
    """Check that smooth_goals brakes a canceled goal without a cancel to the controller."""
    action = 'action:=/joint_trajectory_controller/follow_joint_trajectory'
    words = ['--ros-args', '-p', action, '-p', 'limits_file:=c3_a601s']
    environment = processes.ros_environment(cell.domain)
    process = processes.Process('smooth_goals', words, folder / 'smooth_goals.log', environment)
    front = RosPeer(cell.domain, node='smooth_goals')
    try:
        assert front.action.wait_for_server(60.0)
        goal = Goal(front, trajectory((20.0, [1.0, *TARGET[1:]])))
        cell.peer.wait_for_motion()
        goal.cancel()
        assert goal.result()[2] == 'canceled, it braked, the arm is at rest'
    finally:
        front.close()
        process.end()


def test_two_launched_robots_move_independently(tmp_path: Path) -> None:
    names, domain = ('left', 'right'), processes.free_ros_domain()
    network = f'127.{random.randrange(1, 255)}.{random.randrange(256)}'
    words = [f'namespaces:={",".join(names)}', f'robot_ips:={network}.1,{network}.2']
    process = processes.Process(
        'several_robots.launch.py',
        [*words, 'use_sim_controller:=true'],
        tmp_path / 'launch.log',
        processes.ros_environment(domain),
        LAUNCH,
    )
    peers = left, right = [RosPeer(domain, prefix=f'/{name}') for name in names]
    try:
        for peer in peers:
            peer.wait_until_ready()
            peer.enable()
        before, target = left.position(), right.position() + 0.1
        joints = [f'right_{joint}' for joint in JOINTS]
        assert list(right.joint_states[-1].name) == joints
        goal = right.goal(trajectory((1.0, target.tolist()), names=joints))
        assert goal.result()[0] == 'succeeded'
        assert right.position() == pytest.approx(target, abs=1e-3)
        assert left.position() == pytest.approx(before, abs=1e-6)
    finally:
        for peer in peers:
            peer.close()
        process.end()


def test_move_group_moves_the_arm_and_its_death_fails_the_launch(launched: Any) -> None:
    pytest.importorskip('moveit_msgs')
    cell = launched('moveit_planning_execution.launch.py', launch_rviz='false')
    run = subprocess.run(
        [sys.executable, EXAMPLE],
        env=os.environ | {'ROS_DOMAIN_ID': str(cell.domain)},
        capture_output=True,
        text=True,
        timeout=120.0,
        check=True,
    )
    assert run.stdout == 'MoveIt error code 1\n'
    cell.reaches_target()
    children = ['--parent', str(cell.process.process_id), '--exact', 'move_group']
    subprocess.run(['pkill', '--signal', 'KILL', *children], check=True)
    assert cell.process.wait(30.0) == 1


SERVO = """
from launch import LaunchDescription
from launch_ros.actions import Node
{}
def generate_launch_description():
    return LaunchDescription([servo])
"""
"""A launch file, to be completed by the code of docs/servo.md."""


def switch_commands(peer: RosPeer, kind: Any, command_type: int) -> None:
    with peer.client(kind, '/servo_node/switch_command_type') as client:
        request = kind.Request(command_type=command_type)
        assert peer.complete(client.call_async(request)).success


def distance_from_line(peer: RosPeer) -> float:
    """Jog the tool 50 mm along z, and return its largest distance from the line, m."""
    tool, first = Kinematics(load_robot_model('c3_a601s')), len(peer.joint_states)
    publisher = peer.node.create_publisher(TwistStamped, '/servo_node/delta_twist_cmds', 10)

    def at(message: Any) -> np.ndarray:
        position = dict(zip(message.name, message.position, strict=True))
        return tool.forward(np.array([position[name] for name in JOINTS]))[:3, 3]

    start = at(peer.joint_states[-1])

    def moved() -> bool:
        twist = TwistStamped()
        twist.header.stamp = peer.node.get_clock().now().to_msg()
        twist.header.frame_id = 'base_link'
        twist.twist.linear.z = 1.0
        publisher.publish(twist)
        return at(peer.joint_states[-1])[2] - start[2] > 0.05

    peer.wait_for(moved, 'a line by Servo')
    peer.wait_until_still()
    return max(float(np.hypot(*(at(state) - start)[:2])) for state in peer.joint_states[first:])


def test_moveit_servo_jogs_the_arm_and_no_setpoint_is_clipped(
    launched: Any, tmp_path: Path
) -> None:
    kind = pytest.importorskip('moveit_msgs.srv').ServoCommandType
    page = (ROOT / 'docs' / 'servo.md').read_text(encoding='utf-8')
    code = page.partition('```python\n')[2].partition('```')[0]
    file = tmp_path / 'servo.launch.py'
    file.write_text(SERVO.format(code), encoding='utf-8')
    cell = launched('moveit_planning_execution.launch.py', launch_rviz='false')
    peer, environment = cell.peer, processes.ros_environment(cell.domain)
    servo = processes.Process(str(file), [], tmp_path / 'servo.log', environment, LAUNCH[:2])
    try:
        switch_commands(peer, kind, kind.Request.JOINT_JOG)
        assert peer.goal(trajectory((GOAL_TIME_S, TARGET))).result()[0] == 'succeeded'
        jog = peer.node.create_publisher(JointJog, '/servo_node/delta_joint_cmds', 10)

        def moved() -> bool:
            header = Header(stamp=peer.node.get_clock().now().to_msg())
            jog.publish(JointJog(header=header, joint_names=JOINTS[:1], velocities=[1.0]))
            latest = peer.joint_states[-1]
            return latest.position[list(latest.name).index(JOINTS[0])] > TARGET[0] + 0.1

        peer.wait_for(moved, 'motion by Servo')
        peer.wait_until_still()
        switch_commands(peer, kind, kind.Request.TWIST)
        assert distance_from_line(peer) < 5e-4
        reported = len(peer.diagnostics)
        peer.wait_for(lambda: len(peer.diagnostics) > reported + 1, 'diagnostics')
        parts = peer.diagnostics[-1].status
        values = {item.key: item.value for part in parts for item in part.values}
        assert int(values['setpoints received']) > 0
        assert values['setpoints clipped'] == '0'
    finally:
        servo.end()
