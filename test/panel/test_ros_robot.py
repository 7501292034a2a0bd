# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The goals of the panel: none is lost on its way, so that each can be canceled."""

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from epson_msgs.srv import SetSpeedScaling
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from support.ros_peer import PATIENCE

from epson_driver.motion import Trajectory
from epson_driver.node.ros_thread import RosThread
from epson_driver.panel.ros_discovery import RosDiscovery
from epson_driver.panel.ros_robot import PARAMETERS, Goal, NoDriverError, RosRobot
from epson_driver.processes.processes import free_ros_domain, ros_environment

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


@pytest.mark.invariant(5)
def test_a_goal_that_the_driver_rejects_has_ended(both: Both) -> None:
    both.driver.server.register_goal_callback(lambda _goal: GoalResponse.REJECT)
    both.serving.start()
    started(both)
    (goal,) = both.robot.goals
    assert goal.ended.wait(PATIENCE)
    assert both.said == ['the way: rejected']
    assert both.robot.goals == []


@pytest.mark.invariant(5)
def test_of_a_driver_that_is_silent_no_goal_is_left_and_that_is_said(both: Both) -> None:
    started(both)
    (goal,) = both.robot.goals
    both.robot.parameters = {'robot_model': 'c3_a601s'}
    both.robot.state.times['diagnostics'] = 100.0
    both.robot.look_for_driver(200.0)
    assert goal.ended.is_set()
    assert (both.robot.goals, both.robot.parameters) == ([], {})
    (event,) = both.robot.state.events
    assert event.text == 'the way: the driver is gone, and what became of it is not known'


class Handle:
    """A goal that the driver has accepted."""

    def __init__(self) -> None:
        self.canceled = 0

    def cancel_goal_async(self) -> None:
        self.canceled += 1


class AtOnce:
    """An executor that does what it is given at once."""

    def create_task(self, work: Any) -> None:
        work()


@pytest.mark.invariant(3)
def test_a_goal_that_is_canceled_before_it_is_accepted_is_canceled_then() -> None:
    early, late, ended = Handle(), Handle(), Handle()
    goal = Goal('the way', AtOnce())  # type: ignore[arg-type]
    goal.cancel()
    goal.accepted(early)
    other = Goal('the way', AtOnce())  # type: ignore[arg-type]
    other.accepted(late)
    assert late.canceled == 0
    other.cancel()
    over = Goal('the way', AtOnce())  # type: ignore[arg-type]
    over.accepted(ended)
    over.ended.set()
    over.cancel()
    assert (early.canceled, late.canceled, ended.canceled) == (1, 1, 0)


@pytest.fixture(scope='module')
def lonely() -> Iterator[RosRobot]:
    """Return what the panel has of a driver that is not there."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=free_ros_domain())
    nodes = [Node(name, context=context) for name in ('panel', 'panel_topics')]
    yield RosRobot(nodes[0], AtOnce(), nodes[1], '/epson_driver')  # type: ignore[arg-type]
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def test_a_goal_for_nobody_is_refused_with_the_name_of_the_action(lonely: RosRobot) -> None:
    with pytest.raises(NoDriverError, match='nobody serves /epson_driver/follow_joint_trajectory'):
        lonely.execute(WAY, 'the way', lonely.log)
    assert lonely.goals == []


def controller_state(
    names: list[str], positions: list[float], stamp: float = 0.0
) -> JointTrajectoryControllerState:
    message = JointTrajectoryControllerState(joint_names=names)
    message.header.stamp.nanosec = round(stamp * 1e9)
    message.feedback.positions = positions
    return message


@pytest.mark.invariant(6)
def test_joint_states_that_are_no_numbers_are_not_shown(lonely: RosRobot) -> None:
    names = ['joint_1', 'joint_2']
    lonely.parameters = {'joint_names': names}
    lonely._on_controller_state(controller_state(names, [0.1, 0.2]), 10.0)
    for wrong in (float('nan'), float('-inf'), 1e308):
        lonely._on_controller_state(controller_state(names, [0.1, wrong]), 20.0)
        lonely._on_speed(Float64(data=wrong), 20.0)
    lonely._on_controller_state(controller_state(names, [0.3]), 20.0)
    assert lonely.state.positions.tolist() == [0.1, 0.2]
    assert lonely.state.times['joints'] == 10.0
    message = controller_state(names, [0.1, 0.2])
    message.reference.positions = message.error.positions = [0.1, float('nan')]
    lonely._on_controller_state(message, 20.0)
    assert lonely.state.reference is lonely.state.tracking_error is lonely.state.speed is None


class Answer:
    """A future that is done."""

    def __init__(self, values: list[ParameterValue] | None) -> None:
        self._values = values

    def result(self) -> GetParameters.Response | None:
        return None if self._values is None else GetParameters.Response(values=self._values)


@pytest.mark.invariant(1)
def test_what_a_driver_answers_too_late_or_in_part_says_nothing_of_the_robot(
    lonely: RosRobot,
) -> None:
    before = lonely.parameters
    whole = [ParameterValue(type=4, string_value='c3_a601s') for _ in PARAMETERS]
    unset = [*whole[:-1], ParameterValue()]
    for answer in (Answer(None), Answer(whole[1:]), Answer(unset)):
        lonely._asking = answer
        lonely._on_parameters(1.0, answer)
    lonely._on_parameters(1.0, Answer(whole))  # of a question that was given up
    assert lonely.parameters == before
    lonely._asking = asked = Answer(whole)
    lonely._on_parameters(2.0, asked)
    assert lonely.parameters == dict.fromkeys(PARAMETERS, 'c3_a601s')
    assert lonely.state.times['parameters'] == 2.0
    lonely._asking = None


def test_a_driver_that_does_not_answer_is_asked_again(
    lonely: RosRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have died in between, and another one come in its place."""
    monkeypatch.setattr(lonely._get_parameters, 'service_is_ready', lambda: True)
    lonely.state.times.pop('diagnostics', None)
    lonely.look_for_driver(10.0)
    first = lonely._asking
    lonely.look_for_driver(12.0)
    assert lonely._asking is first
    lonely.look_for_driver(13.5)
    assert lonely._asking is not first
    lonely._give_up_asking()


def test_a_driver_that_is_gone_is_let_go_of_after_a_while_and_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    domain = free_ros_domain()
    for name, value in ros_environment(domain).items():
        monkeypatch.setenv(name, value)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    failed: list[BaseException] = []
    discovery = RosDiscovery([], None, lambda _what, error: failed.append(error))
    remove = Node.remove_waitable

    def remove_late(node: Node, waitable: Any) -> None:
        time.sleep(0.1)  # rclpy has destroyed it already: a thread that served it now would fail
        remove(node, waitable)

    monkeypatch.setattr(Node, 'remove_waitable', remove_late)

    def look(now: float, there: bool) -> None:
        until = time.monotonic() + PATIENCE
        while True:
            discovery.look_around(now)
            robot = discovery.robots.get('/left/epson_driver')
            if (robot is not None and robot._get_parameters.service_is_ready()) == there:
                return
            assert time.monotonic() < until
            time.sleep(0.05)

    try:
        for now in (100.0, 500.0):
            node = Node('epson_driver', namespace='left', context=context)
            node.create_service(SetSpeedScaling, '~/set_speed_scaling', lambda _, answer: answer)
            look(now, True)
            assert discovery.forget_silent(now + 200.0, 60.0) == []  # silent, but there
            node.destroy_node()
            look(now + 210.0, False)
            assert discovery.forget_silent(now + 250.0, 60.0) == []
            assert discovery.forget_silent(now + 261.0, 60.0) == ['/left/epson_driver']
            assert discovery.robots == {}
    finally:
        discovery.close()
        rclpy.shutdown(context=context)
    assert failed == []
