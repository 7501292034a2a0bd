# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node: topics, services and the action on one side, the `Driver` on the other.

Two threads: rclpy's executor serves ROS in one; the driver's event loop runs in the other, and
publishes from there. What crosses is handed over with `call_soon_threadsafe` one way, and an rclpy
future the other way.
"""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticArray
from industrial_msgs.msg import RobotStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import (
    Goal,
    check_limits,
    duration_in_s,
    trajectory_from_message,
    untimed,
)
from epson_driver.driver.goal.goal_execution import GoalExecution, GoalSettings, cause_timeout
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.goal.tolerances import tolerances
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.smoothing.smoothing import Smoothing
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.driver.state.plausibility import Margins
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks.task_group import report_task_error, run_task_group
from epson_driver.error_texts import load_error_texts
from epson_driver.node import messages, parameters
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.node.io_interface import IoInterface
from epson_driver.node.loop_bridge import REQUEST_QOS, DriverEndedError, LoopBridge
from epson_driver.node.point_streams import PointStreams
from epson_driver.node.ros_log import context_of
from epson_driver.node.ros_time import RosTimeStamps
from epson_driver.node.speed_scaling import SpeedScalingInterface
from epson_driver.node.throttle import Throttle
from epson_driver.node.tracing import Tracing
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import ByteOrder, Status
from epson_driver.trace import TraceError

RESULTS_TIMEOUT_S = 0.3
"""How long the end of the process waits for results to be sent, s."""

RESULTS_LINGER_S = 0.2
"""How long it then stays for them to be received, s: shared memory goes with its process, and rmw
has no acknowledgement for the responses of services, which results are."""

MAX_START_AHEAD_S = 1.0
"""A trajectory stamped further ahead is refused: it would move when nobody expects it, s."""

RESULT_TIMEOUT_S = 60
"""How long a goal and its result are kept for whoever asks late, s: rclpy's own 15 minutes would
keep all points of all goals of that time."""

BYTE_ORDERS = {'auto': None, 'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}


class ClientNode:
    """Connects an rclpy node with a driver. Make it in the driver's event loop.

    Raises ValueError or FileNotFoundError for parameters that cannot be used.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._loop = asyncio.get_running_loop()
        self._context = context_of(node.get_logger())
        self._parameters = parameters.declare(node)
        self._profile = load_controller_profile(self._parameters['controller'])
        self.driver = Driver(self._configuration(), self, self._settings())
        self._apply_settings()
        self._tracing = self._context.run(Tracing, self.driver.trace, self._parameters)
        self._serving = LoopBridge(node, self._context, self.driver.fault)
        self._commands = ArmCommands(self.driver)
        self._handles: dict[bytes, GoalHandle] = {}
        self._feedback_pace = Throttle()
        self._point_streams = PointStreams()
        self._limits = self.driver.configuration.limits
        self._joint_state = messages.JointStateWriter(self._limits.names)
        self._clock = node.get_clock()
        self._stamps = RosTimeStamps(self._clock, self._loop.time)
        self._diagnostics = Diagnostics(self.driver, node.get_fully_qualified_name().lstrip('/'))
        self._make_publishers()
        self._make_entry_points()
        self.on_link_state(self.driver.state_link.state.value, 'starting')

    async def run(self) -> None:
        """Drive the controller until cancelled. Raises what a part of it raised."""
        parts = {'the driver': self.driver.run, 'diagnostics': self._publish_diagnostics}
        together = run_task_group(parts, self.driver.shut_down)
        await self._loop.create_task(together, context=self._context)

    async def shut_down(self) -> None:
        """Stop the arm, and let every goal's result leave before ROS is shut down.

        Raises TimeoutError if that takes longer than RESULTS_TIMEOUT_S.
        """
        busy = bool(self._handles)
        await self._loop.create_task(self.driver.shut_down(), context=self._context)
        executor = self._node.executor
        async with asyncio.timeout(RESULTS_TIMEOUT_S):
            waiting = busy
            while waiting:  # and once more: the last result leaves right after its handle
                waiting = bool(self._handles)
                passed = asyncio.Event()
                executor.create_task(self._loop.call_soon_threadsafe, passed.set)
                await passed.wait()
        if busy:
            await asyncio.sleep(RESULTS_LINGER_S)

    def end(self) -> None:
        """Have every request answered that still waits: the loop has ended. In any thread."""
        self._serving.end()

    # --- setting up -------------------------------------------------------------------------

    def _configuration(self) -> Configuration:
        values = self._parameters
        model = load_robot_model(values['robot_model'])
        names = tuple(values['joint_names'])
        if len(names) != len(model.joint_names):
            raise ValueError(
                f'parameter joint_names has {len(names)} names, but {model.name} has '
                f'{len(model.joint_names)} joints'
            )
        return Configuration(
            host=values['robot_ip'],
            motion_port=values['motion_port'],
            state_port=values['state_port'],
            remote_port=values['remote_port'],
            io_port=values['io_port'],
            io_timeout=values['io_timeout'],
            byte_order=BYTE_ORDERS[values['byte_order']],
            state_timeout=values['state_timeout'],
            limits=replace(model.limits, names=names),
            errors=load_error_texts(values['error_texts']),
            delivery=delivery_rules(self._profile, values['interface'], values['point_message']),
            mapping=joint_mapping(
                len(names), values['joint_signs'], values['joint_offsets'], values['j23_factor']
            ),
            usual_byte_order=self._profile.byte_order,
            motors=self._profile.program.motors,
            state_period=self._profile.state.period,
            margins=Margins(values['state_position_margin'], values['state_velocity_margin']),
            smoothing=Smoothing(
                values['resample_period'] if values['smoothing'] == 'resample' else None,
                values['timing'] == 'time_optimal',
            ),
        )

    def _settings(self) -> GoalSettings:
        return GoalSettings(
            stopped_velocity=self._parameters['constraints.stopped_velocity_tolerance'],
            reply_timeout=self._parameters['reply_timeout'],
            cause_timeout=cause_timeout(self._profile.state),
        )

    def _apply_settings(self) -> None:
        self.driver.goal_queue.settings = self._settings()
        self.driver.goal_queue.start_tolerance = self._parameters['start_tolerance']
        self.driver.io.timeout = self._parameters['io_timeout']

    def _make_publishers(self) -> None:
        node = self._node
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._joint_states = node.create_publisher(JointState, 'joint_states', 10)
        self._robot_status = node.create_publisher(RobotStatus, 'robot_status', 10)
        self._controller_state = node.create_publisher(
            JointTrajectoryControllerState, '~/controller_state', 10
        )
        self._link_state = node.create_publisher(String, '~/link_state', latched)
        self._diagnostic_array = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def _make_entry_points(self) -> None:
        node = self._node
        group = ReentrantCallbackGroup()
        for name in ('stop', 'enable', 'disable', 'reset_error'):
            method = getattr(self._commands, name)
            self._serving.create_service(Trigger, f'~/{name}', self._trigger(name, method), group)
        for topic in ('~/joint_trajectory', 'joint_path_command'):
            node.create_subscription(
                JointTrajectory, topic, self._on_trajectory, 10, callback_group=group
            )
        self._io = IoInterface(node, self.driver.io, self._serving, group)
        self._speed = SpeedScalingInterface(
            node, self.driver.goal_queue.scaling, self._serving, group
        )
        self._action = ActionServer(
            node,
            FollowJointTrajectory,
            '~/follow_joint_trajectory',
            self._execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT,  # rejections need a result to say why
            cancel_callback=self._cancel,
            callback_group=group,
            goal_service_qos_profile=REQUEST_QOS,
            result_service_qos_profile=REQUEST_QOS,
            cancel_service_qos_profile=REQUEST_QOS,
            result_timeout=RESULT_TIMEOUT_S,
        )
        node.add_on_set_parameters_callback(self._on_set_parameters)

    # --- from ROS: these run in the executor's thread ---------------------------------------

    def _trigger(
        self, name: str, method: Callable[[], Coroutine[Any, Any, str]]
    ) -> Callable[[Any, Any], Coroutine[Any, Any, Any]]:
        async def serve(_request: Any, response: Any) -> Any:
            try:
                response.message = await self._serving.in_loop(method)
                response.success = True
            except CommandError as error:
                response.message = str(error)
                response.success = False
            self._node.get_logger().info(f'~/{name}: {response.message}')
            return response

        return serve

    async def _execute(self, goal_handle: Any) -> FollowJointTrajectory.Result:
        """Hand a goal to the driver and wait for its outcome."""
        key = bytes(goal_handle.goal_id.uuid)
        try:
            outcome = await self._outcome(key, goal_handle)
        except GoalRejectedError as rejection:
            outcome = rejection.outcome
        except DriverEndedError as error:
            outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, str(error))
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            text = self._serving.failed('~/follow_joint_trajectory', error)
            outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, text)
        self._log_outcome(outcome)
        if outcome.end is End.SUCCEEDED:
            goal_handle.succeed()
        elif outcome.end is End.CANCELED and goal_handle.status == GoalStatus.STATUS_CANCELING:
            goal_handle.canceled()
        else:
            goal_handle.abort()
        self._handles.pop(key, None)
        return messages.result(outcome)

    async def _outcome(self, key: bytes, goal_handle: Any) -> Outcome:
        """Return how a goal ended. Raises GoalRejectedError, DriverEndedError."""
        goal = self._checked(goal_handle.request)
        done = self._serving.promise()
        handle = GoalHandle(
            goal, partial(self._serving.keep, done), partial(self._on_feedback, goal_handle)
        )
        self._handles[key] = handle
        self._serving.to_loop(self.driver.goal_queue.submit, handle)
        if goal_handle.is_cancel_requested:
            self._serving.to_loop(self.driver.goal_queue.cancel, handle)
        outcome: Outcome = await self._serving.kept(done)
        return outcome

    def _cancel(self, goal_handle: Any) -> CancelResponse:
        try:
            handle = self._handles.get(bytes(goal_handle.goal_id.uuid))
            if handle is not None:
                self._serving.to_loop(self.driver.goal_queue.cancel, handle)
        except DriverEndedError:
            return CancelResponse.REJECT
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            self._serving.failed('canceling a goal', error)
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT

    def _on_trajectory(self, message: JointTrajectory) -> None:
        """Execute a trajectory without an action client; one without points stops the arm."""
        try:
            self._take_trajectory(message)
        except GoalRejectedError as rejection:
            self._log_outcome(rejection.outcome)
        except DriverEndedError as error:
            self._node.get_logger().warning(f'a trajectory was dropped: {error}')
        except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
            self._serving.failed('taking a trajectory', error)

    def _take_trajectory(self, message: JointTrajectory) -> None:
        """Raises GoalRejectedError, DriverEndedError."""
        if not message.points:
            self._serving.to_loop(self._begin_stop)
            return
        if what := self._point_streams.noticed(len(message.points), self._loop.time()):
            self._node.get_logger().warning(what)
        goal = self._checked(FollowJointTrajectory.Goal(trajectory=message))
        handle = GoalHandle(goal, self._log_outcome, partial(self._on_feedback, None))
        self._serving.to_loop(self.driver.goal_queue.submit, handle)

    def _checked(self, request: FollowJointTrajectory.Goal) -> Goal:
        """Return the goal of a request. Raises GoalRejectedError."""
        values = self._parameters
        names = self._limits.names
        if request.multi_dof_trajectory.points:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL, 'multi_dof_trajectory has points: not supported'
            )
        trajectory = trajectory_from_message(request.trajectory, names)
        if values['timing'] == 'time_optimal':
            trajectory = untimed(trajectory, self._limits)
        check_limits(
            trajectory,
            self._limits,
            may_end_moving=values['allow_nonzero_velocity_at_trajectory_end'],
        )
        self._check_stamp(request.trajectory.header.stamp, trajectory.duration)
        path, goal = (
            tolerances(
                getattr(request, field),
                field,
                names,
                np.array([values[f'constraints.{name}.{default}'] for name in names]),
            )
            for field, default in (('path_tolerance', 'trajectory'), ('goal_tolerance', 'goal'))
        )
        goal_time = duration_in_s(request.goal_time_tolerance)
        return Goal(
            trajectory,
            goal.position,
            max(goal_time, 0.0) if goal_time != 0.0 else values['constraints.goal_time'],
            goal_velocity=goal.velocity,
            path_tolerance=path if path.checked else None,
            units=self._limits.units,
        )

    def _check_stamp(self, stamp: Any, duration: float) -> None:
        start = duration_in_s(stamp)
        if start == 0.0:
            return
        ahead = start - self._clock.now().nanoseconds * 1e-9
        if ahead + duration < 0.0:
            raise GoalRejectedError(
                ErrorCode.OLD_HEADER_TIMESTAMP,
                f'header.stamp: the trajectory ended {-ahead - duration:.3g} s ago',
            )
        if ahead > MAX_START_AHEAD_S:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'header.stamp is {ahead:.3g} s in the future: a start later than in '
                f'{MAX_START_AHEAD_S:g} s is not supported',
            )

    def _on_set_parameters(self, changes: list[Any]) -> SetParametersResult:
        try:
            why = self._set_parameters(changes)
        except (TraceError, DriverEndedError) as error:
            why = str(error)
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            why = self._serving.failed('setting parameters', error)
        return SetParametersResult(successful=not why, reason=why)

    def _set_parameters(self, changes: list[Any]) -> str:
        """Apply changes; return why they cannot be. Raises TraceError, DriverEndedError.

        Ranges and read-only flags were checked by rclpy from the descriptors.
        """
        values = {
            parameter.name: parameter.value
            for parameter in changes
            if parameter.name in self._parameters
        }
        if why := parameters.rejection(changes):
            return why
        self._context.copy().run(self._tracing.change, values)  # the loop is in the first
        self._parameters |= values
        self._serving.to_loop(self._apply_settings)
        return ''

    # --- from the driver: these run in the loop's thread ------------------------------------

    def on_joints(self, sample: JointSample) -> None:
        """Publish `joint_states`, stamped with the time at which they were measured."""
        stamp = self._stamps.of(sample.measured)
        self._joint_states.publish(self._joint_state.write(sample, stamp))

    def on_status(self, status: Status) -> None:
        """Publish `robot_status`."""
        stamp = self._clock.now().to_msg()
        self._robot_status.publish(messages.robot_status(status, stamp))

    def on_link_state(self, name: str, why: str) -> None:
        """Publish `~/link_state`."""
        self._node.get_logger().debug(f'link {name}: {why}')
        self._link_state.publish(String(data=name))

    def _on_feedback(
        self, goal_handle: Any, execution: GoalExecution, sample: JointSample
    ) -> None:
        """Publish action feedback and `~/controller_state` at `action_monitor_rate`."""
        if not self._feedback_pace.due(sample.time, self._parameters['action_monitor_rate']):
            return
        stamp = self._clock.now().to_msg()
        self._controller_state.publish(messages.controller_state(execution, sample, stamp))
        if goal_handle is not None:
            goal_handle.publish_feedback(messages.feedback(execution, sample, stamp))

    def _begin_stop(self) -> None:
        task = self._loop.create_task(self._stop_for_topic())
        task.add_done_callback(report_task_error)

    async def _stop_for_topic(self) -> None:
        logger = self._node.get_logger()
        try:
            logger.info(f'empty trajectory: {await self._commands.stop()}')
        except CommandError as error:
            logger.error(f'empty trajectory: {error}')

    async def _publish_diagnostics(self) -> None:
        while True:
            stamp = self._clock.now().to_msg()
            self._diagnostic_array.publish(self._diagnostics.build(stamp, self._loop.time()))
            await asyncio.sleep(1.0)

    def _log_outcome(self, outcome: Outcome) -> None:
        text = f'goal {outcome.end.value}: {outcome.text}'
        if outcome.end is End.SUCCEEDED:  # a line each: rclpy allows a line one severity
            self._node.get_logger().info(text)
        else:
            self._node.get_logger().warning(text)
