# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The action `~/execute_motion_primitive_sequence`: a sequence of joint moves, lines and arcs.

The whole sequence is planned from the current position, and executed as one goal of the driver's
queue. The goal is checked, stopped and reported like a trajectory.
"""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from control_msgs.action import ExecuteMotionPrimitiveSequence
from control_msgs.msg import MotionArgument, MotionPrimitive, MotionPrimitiveSequence
from geometry_msgs.msg import Pose, PoseStamped
from rclpy.action.server import ServerGoalHandle

from epson_driver.driver.delivery.statements import MAX_CHARACTERS, Load, StatementDelivery
from epson_driver.driver.goal.goal import check_limits
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import FRESH_POSE_TIMEOUT_S, GoalHandle
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation, PlanningEndedError
from epson_driver.driver.inhibit import Purpose
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import wait_for_fresh_state
from epson_driver.inputs import InputError, Rule, number, shown
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.node.goal_server import GoalServer
from epson_driver.node.loop_bridge import GoalAction, NodeContext, OnEnd
from epson_driver.node.messages import outcome_text
from epson_driver.node.trajectory_messages import invalid_goal
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.motion_sequence import (
    Kind,
    PlannedSequence,
    Primitive,
    SequenceError,
    plan_sequence,
)
from epson_driver.tool_motion.tool_pose import finite_numbers, pose_of_quaternion
from epson_driver.tool_motion.tool_trajectory import ToolLimits

MAX_PRIMITIVES = 256
"""Maximum number of motions, because the feedback's current_primitive_index is a uint8."""

POSES = {Kind.LINEAR_JOINT: 0, Kind.LINEAR_CARTESIAN: 1, Kind.CIRCULAR_CARTESIAN: 2}

ARGUMENTS: dict[str, Rule] = {
    'velocity': number(1e-5, 1000.0, 'rad/s or m/s'),
    'acceleration': number(1e-4, 100_000.0, 'rad/s² or m/s²'),
    'move_time': number(0.0, 3600.0, 's'),
}
"""Allowed additional arguments of a motion. Velocity and acceleration apply to the joints in a
joint move, and to the tool in other motions. A nonzero move_time replaces both."""

_CODES = (ErrorCode.SUCCESSFUL, ErrorCode.INVALID_GOAL, ErrorCode.OLD_HEADER_TIMESTAMP)


def primitives_from_message(
    message: MotionPrimitiveSequence, limits: JointLimits, frame: str
) -> list[Primitive]:
    """Return the motions of a message. Raises GoalRejectedError if a pose is not in `frame`."""
    count = len(message.motions)
    if not 0 < count <= MAX_PRIMITIVES:
        raise invalid_goal(f'trajectory has {count} motions: must have 1 to {MAX_PRIMITIVES}')
    return [
        _named(f'motions[{index}]', partial(_primitive, item, limits, frame))
        for index, item in enumerate(message.motions)
    ]


def primitive_result(outcome: Outcome) -> ExecuteMotionPrimitiveSequence.Result:
    code = outcome.code if outcome.code in _CODES else ErrorCode.INVALID_GOAL
    text = outcome_text(outcome)
    return ExecuteMotionPrimitiveSequence.Result(error_code=int(code), error_string=text)


def _named(where: str, read: Callable[[], Primitive]) -> Primitive:
    try:
        return read()
    except (ValueError, GoalRejectedError) as error:
        raise invalid_goal(f'{where}: {error}') from error


def _primitive(message: MotionPrimitive, limits: JointLimits, frame: str) -> Primitive:
    try:
        kind = Kind(message.type)
    except ValueError:
        known = ', '.join(f'{item.name} ({item.value})' for item in Kind)
        raise InputError(f'type = {message.type}: must be one of {known}') from None
    if len(message.poses) != POSES[kind]:
        raise InputError(
            f'{kind.name} has {len(message.poses)} poses: must have {POSES[kind]}'
            + (', the end and an intermediate position' if kind is Kind.CIRCULAR_CARTESIAN else '')
        )
    arguments = _arguments(message.additional_arguments)
    via = None
    if kind is Kind.LINEAR_JOINT:
        target = _joints(message.joint_positions, limits)
    elif len(message.joint_positions):
        raise InputError(f'joint_positions: must be empty, because {kind.name} moves to a pose')
    else:
        target = _pose('poses[0]', message.poses[0], frame)
        if kind is Kind.CIRCULAR_CARTESIAN:
            via = _place('poses[1]', message.poses[1], frame)
    if not np.isfinite(message.blend_radius) or message.blend_radius < 0.0:
        raise InputError(f'blend_radius = {message.blend_radius}: must be 0 or more, m')
    return Primitive(
        kind,
        target,
        via,
        arguments.get('velocity'),
        arguments.get('acceleration'),
        arguments.get('move_time', 0.0),
        message.blend_radius,
    )


def _arguments(messages: Sequence[MotionArgument]) -> dict[str, float]:
    result: dict[str, float] = {}
    for message in messages:
        name = message.argument_name
        if name not in ARGUMENTS:
            known = ', '.join(ARGUMENTS)
            raise InputError(
                f'additional_arguments: unknown name {shown(name)}, must be one of {known}'
            )
        if name in result:
            raise InputError(f'additional_arguments has {name} twice')
        result[name] = ARGUMENTS[name].checked(message.argument_value, name)
    return result


def _joints(values: Sequence[float], limits: JointLimits) -> Array:
    if len(values) != len(limits.names):
        raise InputError(
            f'joint_positions has {len(values)} values: must have {len(limits.names)}, for '
            f'{", ".join(limits.names)}'
        )
    positions = limits.settled(np.array(values, dtype=float))
    check_limits(Trajectory(limits.names, np.ones(1), positions[None, :]), limits)
    return positions


def _pose(field: str, message: PoseStamped, frame: str) -> Array:
    _place(field, message, frame)
    return pose_of_quaternion(field, finite_numbers(field, pose_values(message.pose)))


def pose_values(pose: Pose) -> list[float]:
    place = [getattr(pose.position, name) for name in 'xyz']
    return place + [getattr(pose.orientation, name) for name in 'xyzw']


def _place(field: str, message: PoseStamped, frame: str) -> Array:
    if message.header.frame_id not in ('', frame):
        raise InputError(
            f'{field} is in the frame {shown(message.header.frame_id)}: must be in {frame}'
        )
    place = np.array([getattr(message.pose.position, name) for name in 'xyz'])
    if not np.all(np.isfinite(place)):
        raise InputError(f'{field}: the position {place.tolist()} must be finite numbers')
    return place


RETIMED = (
    'parameter timing = time_optimal: must be as_planned, to keep the velocities and stops of the '
    'motions'
)


RESTS = 'must be 0: over Remote Ethernet alone the arm stops after each motion, without timing'

HALF_STEP_S = 1e-4
"""Maximum time before the end of a motion at which a trajectory point counts as its end, s."""


class ToolBusyError(RuntimeError):
    """The tool cannot be changed while a sequence is planned or executed with it."""

    def __init__(self) -> None:
        super().__init__(
            'a sequence of motion primitives is being planned or executed with the current tool: '
            'wait for its end, or cancel it first'
        )


class MotionPrimitives:
    def __init__(self, context: NodeContext, goals: GoalServer) -> None:
        self._setup = context.setup
        self._driver = context.driver
        self._queue = context.driver.goal_queue
        self._goals = goals
        self._bridge = context.bridge
        self.kinematics = Kinematics(self._setup.model)
        """Kinematics of the arm with the current tool, to which the poses in goals refer."""
        self._tool = np.eye(4)
        self._action = GoalAction(
            self._bridge,
            self._queue,
            ExecuteMotionPrimitiveSequence,
            '~/execute_motion_primitive_sequence',
            self._prepare,
            primitive_result,
        )

    @property
    def busy(self) -> bool:
        return self._action.busy

    # --- from ROS: in the executor's thread -------------------------------------------------

    def set_tool(self, pose: Array) -> None:
        """Set the tool for later sequences. pose: pose of the tool in tool0, shape (4, 4), m."""
        if self.busy:
            raise ToolBusyError
        self.kinematics, self._tool = Kinematics(self._setup.model, pose), pose

    def set_payload(self, mass: float) -> bool:
        """Set the payload sent with each motion, kg.

        Return whether the controller supports payloads.
        """
        if self._driver.set_load is None:
            return False
        self._driver.set_load(Load(mass) if mass else None)
        return True

    async def _prepare(
        self, ros_handle: ServerGoalHandle, plan: PlanningCancellation, on_end: OnEnd
    ) -> GoalHandle:
        if self._setup.values['timing'] == 'time_optimal':
            raise invalid_goal(RETIMED)
        primitives = primitives_from_message(
            ros_handle.request.trajectory,
            self._setup.model.limits,
            self._setup.values['frame_id'],
        )
        planned = await self._bridge.in_loop(partial(self._plan, primitives, plan))
        statement = None
        if (written := self._driver.statements) is not None:
            statement = sequence_statement(
                self.kinematics, self._tool, primitives, planned, written
            )
        goal = self._setup.goal(planned.trajectory, statement)
        on_feedback = partial(self._on_feedback, ros_handle, planned)
        return GoalHandle(goal, on_end, on_feedback, plan=plan)

    # --- in the loop's thread ---------------------------------------------------------------

    async def start_positions(self, plan: PlanningCancellation) -> Array:
        """Return the joint positions from which a motion can be planned, shape (n,).

        A stop, or any other event that inhibits motion, cancels `plan`.
        """
        self._queue.plans.begin(plan)
        self._queue.check(Purpose.ALONE, asyncio.get_running_loop().time())
        now = await wait_for_fresh_state(
            self._driver.robot.why_not_ready, self._driver.changed, FRESH_POSE_TIMEOUT_S
        )
        return self._queue.ready_sample(now).positions

    async def _plan(
        self, primitives: list[Primitive], plan: PlanningCancellation
    ) -> PlannedSequence:
        start = await self.start_positions(plan)
        try:
            return await plan.in_thread(
                lambda checkpoint: plan_sequence(
                    self.kinematics,
                    start,
                    primitives,
                    sampled=self._setup.profile.program.exact_times,
                    checkpoint=checkpoint,
                )
            )
        except (SequenceError, PlanningEndedError) as error:
            raise invalid_goal(str(error)) from error

    def _on_feedback(
        self,
        ros_handle: ServerGoalHandle,
        planned: PlannedSequence,
        execution: GoalExecution,
        sample: JointSample,
    ) -> None:
        if self._goals.publish_state(execution, sample) is None:
            return
        desired = execution.desired
        time = 0.0 if desired is None else desired[0]
        index = planned.index(time / execution.goal.trajectory.duration)
        ros_handle.publish_feedback(
            ExecuteMotionPrimitiveSequence.Feedback(current_primitive_index=index)
        )


def sequence_statement(
    arm: Kinematics,
    tool: Array,
    primitives: Sequence[Primitive],
    planned: PlannedSequence,
    statements: StatementDelivery,
) -> str:
    """Return a planned sequence as SPEL+ statements for one `$Execute` of Remote Ethernet.

    The arm stops after each statement. tool: pose of the tool in the flange, shape (4, 4), m.
    Raises GoalRejectedError if statements cannot express the sequence.
    """
    texts, trajectory = [], planned.trajectory
    end_indices = np.searchsorted(trajectory.times, planned.ends - HALF_STEP_S)
    start = 0
    for index, (primitive, end) in enumerate(zip(primitives, end_indices.tolist(), strict=True)):
        for field, value in (
            ('blend_radius', primitive.blend_radius),
            ('move_time', primitive.move_time),
        ):
            if value:
                raise invalid_goal(f'motions[{index}]: {field} = {value:g}: {RESTS}')
        positions = trajectory.positions[start : end + 1]
        if primitive.kind is Kind.LINEAR_JOINT:
            limits = arm.model.limits
            speed = _fraction(primitive.velocity, limits.velocity)
            ramp = _fraction(primitive.acceleration, limits.acceleration)
            texts.append(statements.joints(positions[-1], speed, ramp))
        else:
            usual = ToolLimits()
            speeds = ToolLimits(
                primitive.velocity or usual.speed, primitive.acceleration or usual.acceleration
            )
            texts.append(statements.path(arm, tool, positions, speeds, primitive.via))
        start = end
    text = '; '.join(texts)
    if len(text) > MAX_CHARACTERS:
        raise invalid_goal(f'{len(primitives)} motions: too long for one $Execute, send fewer')
    return text


def _fraction(requested: float | None, limits: Array) -> float:
    return 1.0 if requested is None else min(float(np.min(requested / limits)), 1.0)
