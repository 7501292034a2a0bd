# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's goals, each of which can be canceled, and its discovery of drivers."""

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from epson_msgs.srv import SetSpeedScaling
from industrial_msgs.msg import RobotStatus
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from support.ros_peer import PATIENCE
from support.spin_thread import SpinThread

from epson_driver.motion import Trajectory
from epson_driver.node.ros_process import RosThread
from epson_driver.panel.robot_state import RobotState
from epson_driver.processes.processes import free_ros_domain, ros_environment
from epson_driver.ros_panel import PARAMETERS, Goal, NoDriverError, RosDiscovery, RosRobot

TRAJECTORY = Trajectory(('joint_1',), np.array([1.0]), np.array([[0.5]]))


class Driver:
    """A node that executes goals until a cancel or stop request."""

    def __init__(self, node: Node) -> None:
        self.requests: list[str] = []
        self.started = threading.Event()
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
        self.started.set()
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


class DriverAndPanel:
    """A driver and the panel's RosRobot, each with a thread, in one context."""

    def __init__(self, context: rclpy.Context) -> None:
        self._nodes = [
            Node(name, context=context) for name in ('epson_driver', 'panel', 'panel_topics')
        ]
        self.driver = Driver(self._nodes[0])
        self._executor = MultiThreadedExecutor(context=context)
        self._executor.add_node(self._nodes[0])
        self._thread = SpinThread(self._executor)
        self.errors: list[BaseException] = []
        self.serving = RosThread(lambda _, error: self.errors.append(error), context)
        self.serving.executor.add_node(self._nodes[1])
        self.robot = RosRobot(
            self._nodes[1], self.serving.executor, self._nodes[2], '/epson_driver'
        )
        self.said: list[str] = []

    def say(self, text: str, _level: int) -> None:
        self.said.append(text)

    def start(self) -> None:
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
        self._thread.end()
        self.driver.server.destroy()
        for node in self._nodes:
            node.destroy_node()


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[DriverAndPanel]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=free_ros_domain())
    result = DriverAndPanel(context)
    try:
        result.start()
        yield result
        assert not result.errors
    finally:
        result.close()
        context.try_shutdown()


def send_goal(pair: DriverAndPanel) -> None:
    """Send a goal from the panel."""
    pair.robot.execute(TRAJECTORY, 'goal 1', pair.say)


@pytest.mark.invariant(3)
def test_goals_are_sent_and_canceled_in_the_executor_thread(
    pair: DriverAndPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise rclpy can process a response before it has registered the request."""
    threads = []
    for owner, name in (
        (ActionClient, 'send_goal_async'),
        (ClientGoalHandle, 'cancel_goal_async'),
    ):
        method = getattr(owner, name)

        def record_thread(*args: Any, _method: Any = method, **named: Any) -> Any:
            threads.append(threading.current_thread().name)
            return _method(*args, **named)

        monkeypatch.setattr(owner, name, record_thread)
    pair.serving.start()
    send_goal(pair)
    assert pair.driver.started.wait(PATIENCE)
    (goal,) = pair.robot.cancel_goals()
    assert goal.ended.wait(PATIENCE)
    assert threads == ['rclpy executor'] * 2
    assert pair.driver.requests == ['goal', 'cancel']
    assert pair.robot.goals == []


@pytest.mark.invariant(3, 5)
def test_goal_canceled_before_sending_and_rejected_goal_have_ended(pair: DriverAndPanel) -> None:
    send_goal(pair)
    goals = pair.robot.cancel_goals()
    pair.serving.start()
    assert goals[0].ended.wait(PATIENCE)
    pair.driver.server.register_goal_callback(lambda _goal: GoalResponse.REJECT)
    send_goal(pair)
    goals += pair.robot.goals
    assert goals[-1].ended.wait(PATIENCE)
    assert pair.said == ['goal 1: canceled before it was sent', 'goal 1: rejected']
    assert pair.driver.requests == pair.robot.goals == []


@pytest.mark.invariant(3)
def test_stop_does_not_overtake_a_goal(pair: DriverAndPanel) -> None:
    send_goal(pair)
    (goal,) = pair.robot.goals
    pair.robot.trigger('stop', pair.say)
    pair.serving.start()
    assert goal.ended.wait(PATIENCE)
    assert sorted(pair.driver.requests) == ['goal', 'stop']


@pytest.mark.invariant(5)
def test_goals_of_a_lost_driver_end_with_an_event(pair: DriverAndPanel) -> None:
    send_goal(pair)
    (goal,) = pair.robot.goals
    pair.robot.parameters = {'robot_model': 'c3_a601s'}
    pair.robot.state.times['diagnostics'] = 100.0
    pair.robot.look_for_driver(200.0)
    assert goal.ended.is_set()
    assert (pair.robot.goals, pair.robot.parameters) == ([], {})
    (event,) = pair.robot.state.events
    assert event.text == 'goal 1: the driver has disappeared, the result is unknown'


class Handle:
    """A goal that the driver has accepted."""

    def __init__(self) -> None:
        self.canceled = 0

    def cancel_goal_async(self) -> None:
        self.canceled += 1


class ImmediateExecutor:
    """An executor that runs a task immediately."""

    def create_task(self, work: Any) -> None:
        work()


@pytest.mark.invariant(3)
def test_goal_canceled_before_acceptance_is_canceled_later() -> None:
    early, late, ended = Handle(), Handle(), Handle()
    goal = Goal('early', ImmediateExecutor())  # type: ignore[arg-type]
    goal.cancel()
    goal.accepted(early)
    other = Goal('late', ImmediateExecutor())  # type: ignore[arg-type]
    other.accepted(late)
    assert late.canceled == 0
    other.cancel()
    over = Goal('ended', ImmediateExecutor())  # type: ignore[arg-type]
    over.accepted(ended)
    over.ended.set()
    over.cancel()
    assert (early.canceled, late.canceled, ended.canceled) == (1, 1, 0)


@pytest.fixture(scope='module')
def no_driver() -> Iterator[RosRobot]:
    """The panel's RosRobot of a missing driver."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=free_ros_domain())
    nodes = [Node(name, context=context) for name in ('panel', 'panel_topics')]
    yield RosRobot(nodes[0], ImmediateExecutor(), nodes[1], '/epson_driver')  # type: ignore[arg-type]
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def test_goal_without_a_driver_is_refused(no_driver: RosRobot) -> None:
    with pytest.raises(NoDriverError, match='no server for /epson_driver/follow_joint_trajectory'):
        no_driver.execute(TRAJECTORY, 'goal 1', no_driver.log)
    assert no_driver.goals == []


def controller_state(
    names: list[str], positions: list[float], stamp: float = 0.0
) -> JointTrajectoryControllerState:
    message = JointTrajectoryControllerState(joint_names=names)
    message.header.stamp.nanosec = round(stamp * 1e9)
    message.feedback.positions = positions
    return message


@pytest.mark.invariant(6)
def test_non_finite_joint_states_are_ignored(no_driver: RosRobot) -> None:
    names = ['joint_1', 'joint_2']
    no_driver.parameters = {'joint_names': names}
    no_driver._on_controller_state(controller_state(names, [0.1, 0.2]), 10.0)
    for wrong in (float('nan'), float('-inf'), 1e308):
        no_driver._on_controller_state(controller_state(names, [0.1, wrong]), 20.0)
        no_driver._on_speed(Float64(data=wrong), 20.0)
    no_driver._on_controller_state(controller_state(names, [0.3]), 20.0)
    assert no_driver.state.positions.tolist() == [0.1, 0.2]
    assert no_driver.state.times['joints'] == 10.0
    message = controller_state(names, [0.1, 0.2])
    message.reference.positions = message.error.positions = [0.1, float('nan')]
    no_driver._on_controller_state(message, 20.0)
    assert (
        no_driver.state.reference
        is no_driver.state.tracking_error
        is no_driver.state.speed
        is None
    )


@pytest.mark.parametrize(
    ('refused', 'in_motion', 'possible', 'withheld'),
    [(True, 1, 1, True), (True, 0, 0, True), (True, 0, 1, False), (False, 1, 1, False)],
)
def test_joints_are_withheld_by_a_busy_controller_without_plans(
    refused: bool,
    in_motion: int,
    possible: int,
    withheld: bool,
    no_driver: RosRobot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(no_driver, 'state', RobotState())
    values = [KeyValue(key='plans refused', value='no points')] if refused else []
    no_driver.on_diagnostics(DiagnosticStatus(values=values), 10.0)
    assert no_driver.state.no_plans == ('no points' if refused else '')
    message = RobotStatus()
    message.in_motion.val, message.motion_possible.val = in_motion, possible
    no_driver._on_status(message, 10.0)
    assert no_driver.state.joints_missing(10.5) != withheld
    names = ['joint_1', 'joint_2']
    no_driver.parameters = {'joint_names': names}
    no_driver._on_controller_state(controller_state(names, [0.1, 0.2]), 10.5)
    assert no_driver.state.times['first joints'] == 10.5


class Answer:
    """A completed future."""

    def __init__(self, values: list[ParameterValue] | None) -> None:
        self._values = values

    def result(self) -> GetParameters.Response | None:
        return None if self._values is None else GetParameters.Response(values=self._values)


@pytest.mark.invariant(1)
def test_late_or_incomplete_parameters_are_ignored(
    no_driver: RosRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    service, before = no_driver._parameters, no_driver.parameters
    whole = [ParameterValue(type=4, string_value='c3_a601s') for _ in PARAMETERS]
    unset = [*whole[:-1], ParameterValue()]
    monkeypatch.setattr(service, '_requested_at', 2.0)
    for answer in (Answer(None), Answer(whole[1:]), Answer(unset)):
        service._pending = answer
        service._take(answer)
    service._take(Answer(whole))  # the answer to an abandoned request
    assert no_driver.parameters == before
    service._pending = asked = Answer(whole)
    service._take(asked)
    assert no_driver.parameters == dict.fromkeys(PARAMETERS, 'c3_a601s')
    assert no_driver.state.times['parameters'] == 2.0


def test_parameters_are_requested_again_after_a_timeout(
    no_driver: RosRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The driver may have ended and been replaced."""
    service = no_driver._parameters
    monkeypatch.setattr(service.client, 'service_is_ready', lambda: True)
    no_driver.state.times.pop('diagnostics', None)
    no_driver.look_for_driver(10.0)
    first = service._pending
    no_driver.look_for_driver(12.0)
    assert service._pending is first
    no_driver.look_for_driver(13.5)
    assert service._pending is not first
    service.drop()


def test_lost_driver_is_forgotten_and_discovered_again(
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
        time.sleep(0.1)  # rclpy has destroyed it already: serving it now would fail
        remove(node, waitable)

    monkeypatch.setattr(Node, 'remove_waitable', remove_late)

    def look(now: float, there: bool) -> None:
        until = time.monotonic() + PATIENCE
        while True:
            discovery.discover(now)
            robot = discovery.robots.get('/left/epson_driver')
            if (robot is not None and robot._parameters.client.service_is_ready()) == there:
                return
            assert time.monotonic() < until
            time.sleep(0.05)

    try:
        for now in (100.0, 500.0):
            node = Node('epson_driver', namespace='left', context=context)
            node.create_service(SetSpeedScaling, '~/set_speed_scaling', lambda _, answer: answer)
            look(now, True)
            look(now + 200.0, True)  # silent, but there
            node.destroy_node()
            look(now + 210.0, False)
            discovery.discover(now + 250.0)
            assert [*discovery.robots] == ['/left/epson_driver']
            discovery.discover(now + 271.0)
            assert discovery.robots == {}
    finally:
        discovery.close()
        rclpy.shutdown(context=context)
    assert failed == []
