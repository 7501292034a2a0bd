# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The goals of the panel: none is lost on its way, so that each can be canceled."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from support.ros_peer import PATIENCE

from epson_driver.cli.processes import free_ros_domain
from epson_driver.motion import Trajectory
from epson_driver.node.ros_thread import RosThread
from epson_driver.panel.ros_robot import RosRobot

WAY = Trajectory(('joint_1',), np.array([1.0]), np.array([[0.5]]))


class Driver:
    """It executes goals until they are canceled, or until it is told to stop."""

    def __init__(self, node: Node) -> None:
        self.requests: list[str] = []
        self.begun = threading.Event()
        self.stopped = threading.Event()
        node.create_service(Trigger, 'epson_driver/stop', self._stop)
        self.server = ActionServer(
            node,
            FollowJointTrajectory,
            'epson_driver/follow_joint_trajectory',
            self._execute,
            cancel_callback=self._cancel,
        )

    def _execute(self, handle: Any) -> FollowJointTrajectory.Result:
        self.requests.append('goal')
        self.begun.set()
        assert self.stopped.wait(PATIENCE)
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return FollowJointTrajectory.Result()

    def _cancel(self, _request: Any) -> CancelResponse:
        self.requests.append('cancel')
        self.stopped.set()
        return CancelResponse.ACCEPT

    def _stop(self, _request: Any, answer: Trigger.Response) -> Trigger.Response:
        self.requests.append('stop')
        self.stopped.set()
        answer.success = True
        return answer


class Both:
    """A driver and what the panel has of it, each with a thread, in one context."""

    def __init__(self, context: rclpy.Context) -> None:
        self._nodes = [
            Node(name, context=context) for name in ('epson_driver', 'panel', 'panel_topics')
        ]
        self.driver = Driver(self._nodes[0])
        self._executor = MultiThreadedExecutor(context=context)
        self._executor.add_node(self._nodes[0])
        self._thread = threading.Thread(target=self._executor.spin)
        self.errors: list[BaseException] = []
        self.serving = RosThread(lambda _, error: self.errors.append(error), context)
        self.serving.executor.add_node(self._nodes[1])
        self.robot = RosRobot(
            self._nodes[1], self.serving.executor, self._nodes[2], '/epson_driver'
        )
        self.said: list[str] = []

    def say(self, text: str, _level: int) -> None:
        self.said.append(text)

    def wait_until_there(self) -> None:
        self._thread.start()
        node = self._nodes[1]
        action = ActionClient(node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory')
        assert action.wait_for_server(PATIENCE)
        action.destroy()
        service = node.create_client(Trigger, 'epson_driver/stop')
        assert service.wait_for_service(PATIENCE)
        node.destroy_client(service)

    def close(self) -> None:
        self.driver.stopped.set()
        self.serving.leave()
        self._executor.shutdown()
        self._thread.join()
        self.driver.server.destroy()
        for node in self._nodes:
            node.destroy_node()


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Iterator[Both]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=free_ros_domain())
    found = Both(context)
    try:
        found.wait_until_there()
        yield found
        assert not found.errors
    finally:
        found.close()
        context.try_shutdown()


def started(both: Both) -> None:
    """Have a goal sent."""
    both.robot.execute(WAY, 'the way', both.say)


@pytest.mark.invariant(3)
def test_a_goal_is_sent_and_canceled_where_its_answers_are_taken(
    both: Both, monkeypatch: pytest.MonkeyPatch
) -> None:
    """docs/invariants.md, 3. Otherwise an answer is taken before rclpy has noted the request."""
    threads = []
    for owner, name in (
        (ActionClient, 'send_goal_async'),
        (ClientGoalHandle, 'cancel_goal_async'),
    ):
        method = getattr(owner, name)

        def noted(*args: Any, _method: Any = method, **named: Any) -> Any:
            threads.append(threading.current_thread().name)
            return _method(*args, **named)

        monkeypatch.setattr(owner, name, noted)
    both.serving.start()
    started(both)
    assert both.driver.begun.wait(PATIENCE)
    (goal,) = both.robot.cancel_goals()
    assert goal.ended.wait(PATIENCE)
    assert threads == ['rclpy executor'] * 2
    assert both.driver.requests == ['goal', 'cancel']
    assert both.robot.goals == []


@pytest.mark.invariant(3)
def test_a_goal_that_is_canceled_before_it_is_sent_is_not_sent(both: Both) -> None:
    started(both)
    (goal,) = both.robot.cancel_goals()
    both.serving.start()
    assert goal.ended.wait(PATIENCE)
    assert both.said == ['the way: canceled before it was sent']
    assert both.driver.requests == []


@pytest.mark.invariant(3)
def test_a_stop_does_not_overtake_a_goal(both: Both) -> None:
    started(both)
    (goal,) = both.robot.goals
    both.robot.trigger('stop', both.say)
    both.serving.start()
    assert goal.ended.wait(PATIENCE)
    assert sorted(both.driver.requests) == ['goal', 'stop']
