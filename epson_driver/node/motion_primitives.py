# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The action `~/execute_motion_primitive_sequence`: a sequence of joint moves, lines and arcs.

The whole sequence is planned from the current position and executed as one goal of the driver's
queue. It is checked, stopped and reported like a trajectory.
"""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from control_msgs.action import ExecuteMotionPrimitiveSequence
from rclpy.action.server import ServerGoalHandle

from epson_driver.driver.delivery.statements import MOST_CHARACTERS, Load, Moves
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import FRESH_POSE_TIMEOUT_S, GoalHandle
from epson_driver.driver.goal.planning_scope import PlanningEndedError, PlanningScope
from epson_driver.driver.inhibit import Purpose
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import wait_for_fresh_state
from epson_driver.motion import Array
from epson_driver.node.goal_action import ActionType, GoalAction, OnEnd
from epson_driver.node.goal_server import RESULT_TIMEOUT_S, GoalServer
from epson_driver.node.loop_bridge import NodeContext
from epson_driver.node.motion_primitive_messages import primitive_result, primitives_from_message
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.motion_sequence import (
    Kind,
    PlannedSequence,
    Primitive,
    SequenceError,
    plan_sequence,
)
from epson_driver.tool_motion.tool_trajectory import ToolLimits

RETIMED = (
    'parameter timing = time_optimal: nothing would be left of the velocities and rests of the '
    'motions; as_planned keeps them'
)


RESTS = 'must be 0: by Remote Ethernet alone the arm rests after each motion, at no set time'

HALF_STEP_S = 1e-4
"""Time tolerance, s. The end of a motion is the first point later than its time minus this."""


class ToolBusyError(RuntimeError):
    """The tool cannot change, because a sequence is planned or running with it."""

    def __init__(self) -> None:
        super().__init__(
            'a sequence of motion primitives is planned, or runs, with the tool as it is: wait '
            'for its end, or cancel it first'
        )


class MotionPrimitives:
    """Serves the action over a driver. Must be created in the driver's event loop."""

    def __init__(self, context: NodeContext, goals: GoalServer) -> None:
        self._setup = context.setup
        self._driver = context.driver
        self._queue = context.driver.goal_queue
        self._goals = goals
        self._bridge = context.bridge
        self.kinematics = Kinematics(self._setup.model)
        """Kinematics with the tool to which poses refer."""
        self._tool = np.eye(4)
        action = ActionType(
            ExecuteMotionPrimitiveSequence,
            '~/execute_motion_primitive_sequence',
            self._prepare,
            primitive_result,
            RESULT_TIMEOUT_S,
        )
        self._action = GoalAction(action, self._queue, self._bridge)

    @property
    def busy(self) -> bool:
        """True while a goal of the action has no result."""
        return self._action.busy

    # --- from ROS: in the executor's thread -------------------------------------------------

    def set_tool(self, pose: Array) -> None:
        """Set the tool for the poses of later sequences: (4, 4), m, in tool0.

        Raises ToolBusyError while a sequence is planned or running, because it keeps its tool.
        """
        if self.busy:
            raise ToolBusyError
        self.kinematics, self._tool = Kinematics(self._setup.model, pose), pose

    def set_payload(self, mass: float) -> bool:
        """Send a payload, kg, with each motion. Returns whether the controller supports it."""
        if self._driver.moves is None:
            return False
        self._driver.moves.load = Load(mass) if mass else None
        return True

    async def _prepare(
        self, ros_handle: ServerGoalHandle, plan: PlanningScope
    ) -> Callable[[OnEnd], GoalHandle]:
        """Read and plan a sequence. Raises GoalRejectedError, DriverEndedError."""
        if self._setup.values['timing'] == 'time_optimal':
            raise _invalid(RETIMED)
        primitives = primitives_from_message(
            ros_handle.request.trajectory,
            self._setup.model.limits,
            self._setup.values['frame_id'],
        )
        planned = await self._bridge.in_loop(partial(self._plan, primitives, plan))
        statement = None
        if (moves := self._driver.moves) is not None:
            statement = sequence_statement(self.kinematics, self._tool, primitives, planned, moves)
        goal = self._setup.goal(planned.trajectory, statement)
        on_feedback = partial(self._on_feedback, ros_handle, planned)
        return partial(GoalHandle, goal, on_feedback=on_feedback, plan=plan)

    # --- in the loop's thread ---------------------------------------------------------------

    async def standing(self, plan: PlanningScope) -> Array:
        """Return the joint positions at rest. The planning scope ends if motion becomes inhibited.

        Raises GoalRejectedError unless a motion may start now.
        """
        self._queue.plans.begin(plan)
        self._queue.check(Purpose.ALONE, asyncio.get_running_loop().time())
        now = await wait_for_fresh_state(
            self._driver.robot.why_not_ready, self._driver.changed, FRESH_POSE_TIMEOUT_S
        )
        return self._queue.ready_sample(now).positions

    async def _plan(self, primitives: list[Primitive], plan: PlanningScope) -> PlannedSequence:
        """Plan from the current position, in a thread. Raises GoalRejectedError.

        Canceling the goal, or any other end of the scope, interrupts the planning.
        """
        start = await self.standing(plan)
        try:
            return await plan.in_thread(
                lambda look: plan_sequence(
                    self.kinematics,
                    start,
                    primitives,
                    sampled=self._setup.interpolates,
                    look=look,
                )
            )
        except (SequenceError, PlanningEndedError) as error:
            raise _invalid(str(error)) from error

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
    moves: Moves,
) -> str:
    """Return a planned sequence as statements for one `$Execute`, with a rest after each.

    tool: in the flange, shape (4, 4), m. Raises GoalRejectedError if statements cannot express it.
    """
    texts, trajectory = [], planned.trajectory
    ends = np.searchsorted(trajectory.times, planned.ends - HALF_STEP_S)
    begin = 0
    for index, (primitive, end) in enumerate(zip(primitives, ends.tolist(), strict=True)):
        for field, value in (
            ('blend_radius', primitive.blend_radius),
            ('move_time', primitive.move_time),
        ):
            if value:
                raise _invalid(f'motions[{index}]: {field} = {value:g}: {RESTS}')
        positions = trajectory.positions[begin : end + 1]
        if primitive.kind is Kind.LINEAR_JOINT:
            limits = arm.model.limits
            speed = _share(primitive.velocity, limits.velocity)
            ramp = _share(primitive.acceleration, limits.acceleration)
            texts.append(moves.joints(positions[-1], speed, ramp))
        else:
            usual = ToolLimits()
            speeds = ToolLimits(
                primitive.velocity or usual.speed, primitive.acceleration or usual.acceleration
            )
            texts.append(moves.path(arm, tool, positions, speeds, primitive.via))
        begin = end
    text = '; '.join(texts)
    if len(text) > MOST_CHARACTERS:
        raise _invalid(f'{len(primitives)} motions: more than one $Execute takes: send fewer')
    return text


def _share(asked: float | None, limits: Array) -> float:
    return 1.0 if asked is None else min(float(np.min(asked / limits)), 1.0)


def _invalid(text: str) -> GoalRejectedError:
    return GoalRejectedError(ErrorCode.INVALID_GOAL, text)
