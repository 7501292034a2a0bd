# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The processes of several_robots.launch.py: two simulated controllers and two drivers."""

import os
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import pytest
import yaml
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.context import Context as RosContext
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support.launch_files import launched
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.processes import processes

PATIENCE = 30.0
ROBOTS = ('left', 'right')


def free_addresses() -> list[str]:
    """Return two unused loopback addresses, because the ports are the default ports."""
    return [f'127.{random.randrange(1, 255)}.{random.randrange(256)}.{host}' for host in (1, 2)]


def arguments_of(process: Any, folder: Path) -> list[str]:
    """Return the command line of a process of this package."""
    if process.executable == 'sim_controller':
        return list(process.arguments)
    path = folder / f'{process.namespace}.yaml'
    name = f'/{process.namespace}/{process.name}'
    path.write_text(yaml.safe_dump({name: {'ros__parameters': process.values}}))
    remaps = ['-r', f'__node:={process.name}', '-r', f'__ns:=/{process.namespace}']
    return ['--ros-args', *remaps, '--params-file', str(path)]


class Observer:
    """A ROS node that observes both robots."""

    def __init__(self, domain: int) -> None:
        self._context = RosContext()
        self._context.init(domain_id=domain)
        self.node = Node('onlooker', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.states: dict[str, JointState] = {}
        for robot in ROBOTS:
            self.node.create_subscription(
                JointState,
                f'/{robot}/joint_states',
                lambda message, robot=robot: self.states.update({robot: message}),
                10,
            )

    def wait(self, condition: Callable[[], object], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'no {what} in {PATIENCE} s'
            self._executor.spin_once(0.1)

    def complete(self, future: Any, what: str) -> Any:
        self.wait(future.done, what)
        return future.result()

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.shutdown()


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Observer]:
    """Two running robots according to the launch file."""
    started = launched(
        'several_robots',
        namespaces=','.join(ROBOTS),
        robot_ips=','.join(free_addresses()),
        use_sim_controller='true',
    )
    domain = processes.free_ros_domain()
    running = [
        processes.Process(
            item.executable,
            arguments_of(item, tmp_path),
            tmp_path / f'{number}.log',
            processes.ros_environment(domain),
        )
        for number, item in enumerate(started)
        if item.package == 'epson_driver'
    ]
    names = ['sim_controller', 'client']
    assert [process.name for process in running] == names * len(ROBOTS)
    with processes.ended_at_exit(*running):
        onlooker = Observer(domain)
        try:
            yield onlooker
        finally:
            onlooker.close()


@pytest.mark.slow
def test_two_launched_robots_move_independently(cell: Observer) -> None:
    cell.wait(lambda: len(cell.states) == len(ROBOTS), 'joint states of both')
    for robot in ROBOTS:
        names = [f'{robot}_joint_{number}' for number in range(1, 7)]
        assert list(cell.states[robot].name) == names
        service = cell.node.create_client(Trigger, f'/{robot}/epson_driver/enable')
        cell.wait(service.service_is_ready, 'enable')
        # the simulated controller's remote port is known: its motors are switched on
        answer = cell.complete(service.call_async(Trigger.Request()), 'answer')
        assert answer.success, answer.message
    before = {robot: list(cell.states[robot].position) for robot in ROBOTS}
    target = [position + 0.1 for position in before['right']]
    action = ActionClient(
        cell.node, FollowJointTrajectory, '/right/epson_driver/follow_joint_trajectory'
    )
    cell.wait(action.server_is_ready, 'action')
    points = [(0, before['right']), (1, target)]
    trajectory = JointTrajectory(
        joint_names=list(cell.states['right'].name),
        points=[
            JointTrajectoryPoint(positions=positions, time_from_start=Duration(sec=second))
            for second, positions in points
        ],
    )
    goal = FollowJointTrajectory.Goal(trajectory=trajectory)
    handle = cell.complete(action.send_goal_async(goal), 'goal handle')
    result = cell.complete(handle.get_result_async(), 'result').result
    assert result.error_code == FollowJointTrajectory.Result.SUCCESSFUL, result.error_string
    assert list(cell.states['right'].position) == pytest.approx(target, abs=0.01)
    assert list(cell.states['left'].position) == pytest.approx(before['left'], abs=1e-6)
