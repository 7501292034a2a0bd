# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robots of the panel in ROS: drivers, accessed through topics, services and the action.

An executor spins one node, which receives answers. The other node has subscriptions only. They
have no callbacks, because 180 callbacks per second would take rclpy more time than the rest of the
panel. They store the last message, and `sample` reads it at the page's refresh rate.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointJog, JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from epson_msgs.msg import IoPoint, IoStates
from epson_msgs.srv import SetSpeedScaling, TaughtPoints, WriteIo
from industrial_msgs.msg import RobotMode, RobotStatus
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from epson_driver.driver.inhibit import Cause, Inhibit
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.driver.remedy import Remedy
from epson_driver.motion import Array, Trajectory
from epson_driver.node.joint_reader import MAX_POSITION, JointReader
from epson_driver.node.ros_process import (
    RosThread,
    level,
    polled_subscription,
    take,
    take_all,
    udp_by_default,
)
from epson_driver.node.trajectory_messages import duration_in_s, trajectory_message
from epson_driver.panel.robot_state import (
    ERROR,
    INFO,
    MAX_AGES_S,
    MAX_EVENTS,
    MAX_TAUGHT_POINTS,
    TRIGGERS,
    WARN,
    Event,
    IoRange,
    RequestError,
    RobotState,
    Say,
    Status,
    Tri,
)

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""QoS for states: best effort, because an outdated message need not be repeated."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ANSWER_TIMEOUT_S = 15.0  # the driver needs less to switch the motors on
PARAMETERS_TIMEOUT_S, POINTS_TIMEOUT_S = 3.0, 5.0
POINTS_PERIOD_S = 2.0  # minimum interval between requests for taught points, s

PARAMETERS = ('robot_model', 'joint_names', 'robot_ip', 'remote_port', 'controller')


class NoDriverError(RequestError):
    """The driver offers no server for a request. The text names the server."""


class PolledService:
    """Requests to a service, one at a time, at least `period` s apart.

    A request is dropped after `timeout` s, because a driver that has died never answers.
    `on_answer` is called with an answer and the time of its request, in the executor's thread.
    """

    def __init__(
        self,
        client: Any,
        request: Any,
        on_answer: Callable[[Any, float], object],
        timeout: float,
        period: float = 0.0,
    ) -> None:
        self.client = client
        self._request = request
        self._on_answer = on_answer
        self._timeout = timeout
        self._period = period
        self._pending: Any = None
        self._requested_at = -math.inf

    def poll(self, now: float) -> None:
        """Send a request if one is due. `now`: the panel's clock, s."""
        elapsed = now - self._requested_at
        if elapsed > self._timeout:
            self.drop()
        if self._pending is None and elapsed > self._period and self.client.service_is_ready():
            self._requested_at = now
            self._pending = self.client.call_async(self._request)
            self._pending.add_done_callback(self._take)

    def drop(self) -> None:
        if self._pending is not None:
            self.client.remove_pending_request(self._pending)
            self._pending = None

    def _take(self, future: Any) -> None:
        answer = future.result()
        if future is self._pending:
            self._pending = None
            if answer is not None:
                self._on_answer(answer, self._requested_at)


class Goal:
    """A motion that the panel requested. It can be cancelled even before it is sent or accepted.

    `cancel` may be called in any thread, `accepted` only in the executor's thread.
    """

    def __init__(self, text: str, executor: Executor) -> None:
        self.text = text
        self.ended = threading.Event()
        self.canceled = False
        self._executor = executor
        self._handle: Any = None
        self._canceled_early = False

    def cancel(self) -> None:
        self.canceled = True
        self._executor.create_task(self._cancel)

    def accepted(self, handle: Any) -> None:
        self._handle = handle
        if self._canceled_early:
            handle.cancel_goal_async()

    def _cancel(self) -> None:
        if self._handle is None:
            self._canceled_early = True
        elif not self.ended.is_set():
            self._handle.cancel_goal_async()


class RosRobot:
    """A driver, as the panel uses it through ROS. Only one thread may call `sample`.

    Requests are thread-safe and do not block. They raise NoDriverError if the driver does not
    offer the service or action, and call `say` with the outcome.

    * node: receives the answers. `executor` spins it in one thread.
    * sampled: the node of the subscriptions, which no executor spins.
    * name: the driver's node, such as /left/epson_driver.
    """

    def __init__(self, node: Node, executor: Executor, sampled: Node, name: str) -> None:
        self._executor = executor
        self.name = name
        self.namespace = name.rpartition('/')[0]
        self.label = self.namespace.strip('/') or name.strip('/')
        self._node, self._sampled = node, sampled
        self._last_present: float | None = None
        self.state = RobotState()
        self.parameters: dict[str, Any] = {}
        """Values of PARAMETERS, or empty before the first answer. They are requested periodically,
        because another driver may have replaced the first one under the same name."""
        self._triggers = {
            trigger: node.create_client(Trigger, f'{name}/{trigger}') for trigger in TRIGGERS
        }
        self._set_speed = node.create_client(SetSpeedScaling, f'{name}/set_speed_scaling')
        self._write_io = node.create_client(WriteIo, f'{name}/write_io')
        self._parameters = PolledService(
            node.create_client(GetParameters, f'{name}/get_parameters'),
            GetParameters.Request(names=list(PARAMETERS)),
            self._on_parameters,
            PARAMETERS_TIMEOUT_S,
        )
        self._points = PolledService(
            node.create_client(TaughtPoints, f'{name}/taught_points'),
            TaughtPoints.Request(),
            self._on_points,
            POINTS_TIMEOUT_S,
            POINTS_PERIOD_S,
        )
        self._jog = node.create_publisher(JointJog, f'{name}/joint_jog', LATEST)
        self._action = ActionClient(node, FollowJointTrajectory, f'{name}/follow_joint_trajectory')
        self._goals: list[Goal] = []  # those that have not ended
        self._goals_lock = threading.Lock()
        self._joints = JointReader(f'{name}/controller_state')
        report = JointTrajectoryControllerState
        topics: tuple[tuple[Any, str, Callable[[Any, float], None], QoSProfile], ...] = (
            (RobotStatus, f'{self.namespace}/robot_status', self._on_status, LATEST),
            (report, self._joints.topic, self._on_controller_state, LATEST),
            (String, f'{name}/link_state', self._on_link_state, LATCHED),
            (Float64, f'{name}/speed_scaling', self._on_speed, LATCHED),
            (IoStates, f'{name}/io_states', self._on_io, LATCHED),
        )
        self._topics = [
            (polled_subscription(sampled, kind, topic, qos), handle)
            for kind, topic, handle, qos in topics
        ]

    def last_seen(self, now: float) -> float:
        """Return when the driver was last present or sent a report, s on the panel's clock."""
        if self._last_present is None or self._parameters.client.service_is_ready():
            self._last_present = now
        news = (self.state.times.get(item) for item in ('diagnostics', 'joints', 'status'))
        return max([self._last_present, *(new for new in news if new is not None)])

    def close(self) -> None:
        for subscription, _ in self._topics:
            self._sampled.destroy_subscription(subscription)
        # in the executor's thread, which must not wait for a destroyed entity
        self._executor.create_task(self._destroy)

    def _destroy(self) -> None:
        self._action.destroy()
        clients = [*self._triggers.values(), self._set_speed, self._write_io]
        for service in (self._parameters, self._points):
            service.drop()
            clients.append(service.client)
        for client in clients:
            self._node.destroy_client(client)
        self._node.destroy_publisher(self._jog)

    # --- the driver's reports ----------------------------------------------------------------

    def sample(self, now: float) -> None:
        for subscription, handle in self._topics:
            message = take(subscription)
            if message is not None:
                handle(message, now)

    def look_for_driver(self, now: float) -> None:
        """Request the driver's parameters, or forget them if the driver is missing.

        A driver counts as missing if its diagnostics end, because ROS may list a killed node for
        another 20 s. `now`: the panel's clock, s.
        """
        silent = 'diagnostics' in self.state.times and not self.state.fresh('diagnostics', now)
        if silent or not self._parameters.client.service_is_ready():
            self.parameters = {}
            self._parameters.drop()
            self._points.drop()
            self.state.taught = {}
            for goal in self.goals:
                self._forget(goal)
                self.log(f'{goal.text}: the driver has disappeared, the result is unknown', WARN)
            return
        self._points.poll(now)
        self._parameters.poll(now)

    def on_diagnostics(self, status: DiagnosticStatus, now: float) -> None:
        values = {item.key: item.value for item in status.values}
        state = self.state
        state.gate_open = values.get('arm gate') == 'open'
        state.goal_running = values.get('goal running') == 'True'
        state.no_plans = values.get('plans refused', '')
        state.no_streams = values.get('streams refused', '')
        state.inhibit = None
        if (cause := values.get('cause', '')) != 'NONE':
            state.inhibit = Inhibit(
                Cause.__members__.get(cause, Cause.NOT_ENABLED),
                Remedy.__members__.get(values.get('remedy', ''), Remedy.NONE),
                status.message,
                values.get('advice', ''),
            )
        state.times['diagnostics'] = now

    def _on_points(self, answer: Any, _requested_at: float) -> None:
        points = {}
        for name, pose in zip(answer.names[:MAX_TAUGHT_POINTS], answer.poses, strict=False):
            p, q = pose.position, pose.orientation
            values = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
            if np.isfinite(values).all() and abs(np.linalg.norm(values[3:]) - 1.0) < 1e-3:
                points[name] = values
        self.state.taught = points

    def _on_parameters(self, answer: Any, requested_at: float) -> None:
        kinds = {2: 'integer_value', 4: 'string_value', 9: 'string_array_value'}
        values = answer.values
        if len(values) != len(PARAMETERS) or any(value.type not in kinds for value in values):
            return
        self.parameters = {
            name: getattr(value, kinds[value.type])
            for name, value in zip(PARAMETERS, values, strict=True)
        }
        self.state.times['parameters'] = requested_at

    def _on_status(self, message: Any, now: float) -> None:
        modes = {RobotMode.AUTO: 'AUTO', RobotMode.MANUAL: 'MANUAL'}
        self.state.status = Status(
            _tri(message.e_stopped),
            _tri(message.drives_powered),
            _tri(message.motion_possible),
            _tri(message.in_motion),
            _tri(message.in_error),
            modes.get(message.mode.val, ''),
            tuple(message.error_codes),
        )
        self.state.times['status'] = now
        status = self.state.status
        busy = status.in_motion is not Tri.NO or status.motion_possible is Tri.NO
        if self.state.no_plans and busy:  # such a controller reports joints only when it is ready
            self.state.times['joints withheld'] = now

    def _on_controller_state(self, message: Any, now: float) -> None:
        """Read the joints from ~/controller_state, because any node may publish `joint_states`."""
        state, stamp, joints = self.state, message.header.stamp, message.feedback
        sent, names = list(message.joint_names), tuple(self.parameters.get('joint_names', ()))
        if not names or not self._joints.take(
            sent, joints.positions, joints.velocities, stamp, now
        ):
            return
        limits = state.fastest if len(state.fastest) == len(names) else [math.inf] * len(names)
        try:
            positions, _ = self._joints.of(names, limits, MAX_AGES_S['joints'], now)
        except GoalRejectedError as unknown:
            state.no_joints = str(unknown)
            state.times.pop('joints', None)
            return
        state.joint_names, state.positions, state.no_joints = names, positions, ''
        state.measured = duration_in_s(stamp)
        if state.joints_missing(now) or 'first joints' not in state.times:
            state.times['first joints'] = now
        state.times['joints'] = now
        plan, error = message.reference.positions, message.error.positions
        right = len(plan) == len(error) == len(sent) and {*names} <= {*sent}
        if right and _possible([*plan, *error]):
            order = [sent.index(name) for name in names]
            state.reference, state.tracking_error = np.array(plan)[order], np.array(error)[order]
            state.times['reference'] = now

    def _on_link_state(self, message: Any, _now: float) -> None:
        self.state.link = message.data

    def _on_speed(self, message: Any, _now: float) -> None:
        self.state.speed = message.data if _possible(message.data) else None

    def _on_io(self, message: Any, _now: float) -> None:
        self.state.io = tuple(
            IoRange(item.type, item.start, tuple(item.values)) for item in message.ranges
        )
        self.state.io_reason = '' if message.valid else message.message

    # --- requests to the driver ------------------------------------------------------------------

    def trigger(self, name: str, say: Say) -> None:
        self._call(self._triggers[name], Trigger.Request(), f'~/{name}', say)

    def set_speed(self, factor: float, say: Say) -> None:
        request = SetSpeedScaling.Request(factor=factor)
        self._call(self._set_speed, request, '~/set_speed_scaling', say)

    def write_output(self, index: int, value: int, say: Say) -> None:
        point = IoPoint(type=IoPoint.DIGITAL_OUTPUT, index=index, value=value)
        self._call(self._write_io, WriteIo.Request(points=[point]), '~/write_io', say)

    def jog(self, names: Sequence[str], velocities: Array) -> None:
        """Send joint velocities, rad/s or m/s. The driver applies them for `servo.timeout`."""
        self._jog.publish(JointJog(joint_names=list(names), velocities=velocities.tolist()))

    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None:
        """Send a trajectory as a goal. `text`: its name in the log."""
        if not self._action.server_is_ready():
            raise NoDriverError(f'no server for {self.name}/follow_joint_trajectory')
        goal = Goal(text, self._executor)
        with self._goals_lock:
            self._goals.append(goal)
        message = FollowJointTrajectory.Goal(trajectory=trajectory_message(trajectory))

        def ended(outcome: str, level: int) -> None:
            self._forget(goal)
            say(f'{text}: {outcome}', level)

        def on_result(future: Any) -> None:
            answer = future.result()
            succeeded = answer.status == GoalStatus.STATUS_SUCCEEDED
            ended(answer.result.error_string or 'ended', INFO if succeeded else WARN)

        def on_handle(future: Any) -> None:
            handle = future.result()
            if not handle.accepted:
                ended('rejected', ERROR)
                return
            handle.get_result_async().add_done_callback(on_result)
            goal.accepted(handle)

        def send() -> None:
            if goal.canceled:
                ended('canceled before it was sent', WARN)
            else:
                self._action.send_goal_async(message).add_done_callback(on_handle)

        # rclpy's action client registers a request only after sending it. If another thread
        # processed the answer before, it would be lost, and the goal could not be canceled.
        self._executor.create_task(send)

    @property
    def goals(self) -> list[Goal]:
        with self._goals_lock:
            return list(self._goals)

    def cancel_goals(self) -> list[Goal]:
        goals = self.goals
        for goal in goals:
            goal.cancel()
        return goals

    def _forget(self, goal: Goal) -> None:
        goal.ended.set()
        with self._goals_lock:
            if goal in self._goals:
                self._goals.remove(goal)

    def _call(self, client: Any, request: Any, name: str, say: Say) -> None:
        if not client.service_is_ready():
            raise NoDriverError(f'no server for {client.srv_name}')
        late = threading.Timer(
            ANSWER_TIMEOUT_S, say, (f'{name}: no reply within {ANSWER_TIMEOUT_S:g} s', ERROR)
        )
        late.daemon = True
        late.start()

        def on_answer(done: Any) -> None:
            late.cancel()
            answer = done.result()
            say(f'{name}: {answer.message}', INFO if answer.success else ERROR)

        # in the executor's thread, so that a stop is sent after the goals queued before it
        self._executor.create_task(lambda: client.call_async(request).add_done_callback(on_answer))

    def log(self, text: str, level: int) -> None:
        self.state.add_event(Event(time.time(), level, text))


def _possible(values: Sequence[float] | float) -> bool:
    return bool(np.all(np.abs(values) < MAX_POSITION))


def _tri(value: Any) -> Tri:
    return Tri(value.val) if value.val in (0, 1) else Tri.UNKNOWN


NAME = 'epson_driver_panel'
SPEED_SERVICE = ('epson_msgs/srv/SetSpeedScaling', '/set_speed_scaling')
REPORTS_PERIOD_S = 0.2  # period for reading diagnostics and log, s
GONE_AFTER_S = 60.0  # silence of a driver after which its robot is removed from the page, s
MAX_AT_ONCE = 50  # maximum number of messages of a topic that are read at a time

MANY = QoSProfile(depth=MAX_AT_ONCE, reliability=ReliabilityPolicy.BEST_EFFORT)

LOG = QoSProfile(
    depth=MAX_AT_ONCE,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""QoS for the log: transient local, to receive lines that were logged before the panel started."""


class RosDiscovery:
    """The panel's connection to ROS, and the drivers that it finds.

    `names`: nodes of the drivers, or None for all drivers. Raises the exceptions of rclpy.init.
    """

    def __init__(
        self,
        arguments: list[str],
        names: list[str] | None,
        on_error: Callable[[str, BaseException], None],
    ) -> None:
        self._context = Context()
        # rclpy's own SIGTERM handler would shut down ROS only, and the page would stay open
        with udp_by_default():
            rclpy.init(
                args=arguments,
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self._node = self._new_node(NAME)
        self._sampled = self._new_node(f'{NAME}_topics')
        self._diagnostics = polled_subscription(
            self._sampled, DiagnosticArray, '/diagnostics', MANY
        )
        self._log = polled_subscription(self._sampled, Log, '/rosout', LOG)
        self._thread = RosThread(on_error, self._context)
        self._thread.executor.add_node(self._node)
        self._thread.start()
        self.robots: dict[str, RosRobot] = {}  # by node, in the order of discovery
        self._early: deque[tuple[str, Event]] = deque(maxlen=MAX_EVENTS)  # of unknown nodes
        self._find = names is None
        self._reports_read = -math.inf
        for name in names or ():
            self._add(name)

    def _new_node(self, name: str) -> Node:
        return Node(
            name, context=self._context, enable_rosout=False, start_parameter_services=False
        )

    def _add(self, name: str) -> None:
        robot = self.robots[name] = RosRobot(
            self._node, self._thread.executor, self._sampled, name
        )
        for node, event in self._early:
            if node == name:
                robot.state.add_event(event)

    def sample(self, now: float) -> None:
        for robot in self.robots.values():
            robot.sample(now)
        if now - self._reports_read >= REPORTS_PERIOD_S:
            self._reports_read = now
            self._sample_reports(now)

    def _sample_reports(self, now: float) -> None:
        for message in take_all(self._diagnostics, MAX_AT_ONCE):
            for status in message.status:
                node, separator, part = status.name.partition(': ')
                robot = self.robots.get(f'/{node}')
                if robot is not None and separator and part == 'arm':
                    robot.on_diagnostics(status, now)
        for line in take_all(self._log, MAX_AT_ONCE):
            stamp = line.stamp.sec + line.stamp.nanosec * 1e-9
            event = Event(stamp, level(line), line.msg)
            name = '/' + line.name.replace('.', '/')
            robot = self.robots.get(name)
            if robot is not None:
                robot.state.add_event(event)
            else:
                self._early.append((name, event))

    def discover(self, now: float) -> None:
        if self._find:
            kind, ending = SPEED_SERVICE
            for service, types in self._node.get_service_names_and_types():
                name = service.removesuffix(ending)
                if kind in types and name != service and name not in self.robots:
                    self._add(name)
        for robot in self.robots.values():
            robot.look_for_driver(now)
        for name, robot in list(self.robots.items()):
            if self._find and now - robot.last_seen(now) > GONE_AFTER_S:
                self.robots.pop(name).close()

    def close(self) -> None:
        self._thread.leave()
        self._thread.executor.shutdown()
        self._node.destroy_node()
        self._sampled.destroy_node()
        rclpy.shutdown(context=self._context)
