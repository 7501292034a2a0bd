# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals from ROS: the action `~/follow_joint_trajectory` and the two topics for trajectories.

Each request is converted to a goal (goal_action.py) and passed to the driver's goal queue, which
reports feedback and the outcome.
"""

import asyncio
from collections.abc import Callable
from functools import partial

from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.action.server import ServerGoalHandle
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.goal.planning_scope import PlanningScope
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import report_task_error
from epson_driver.node import messages
from epson_driver.node.goal_action import ActionType, GoalAction, GoalRequests, OnEnd, log_outcome
from epson_driver.node.loop_bridge import DriverEndedError, NodeContext
from epson_driver.node.messages import error_text
from epson_driver.node.trajectory_messages import duration_in_s

MAX_GAP_S = 0.3
"""Maximum time between two messages of a stream, s."""

MIN_POINTS = 3
"""Number of consecutive messages that count as a stream."""

MAX_WINDOW_S = 0.5
"""Maximum duration of a window, a short trajectory that is part of a stream, s."""

WARNING = (
    'single points or short windows arrive as a stream: here each is a separate goal, which '
    'replaces the last one after the arm has stopped, or is rejected if it starts too far from '
    'the arm. Send streams to ~/servo'
)


class PointStreams:
    """Detects a stream of setpoints (single points or windows) on a topic that is meant for goals.

    Each message is executed as a goal, which replaces the running goal after the arm has come to
    rest. Therefore the arm moves in short jerks and falls behind a stream. The node cannot follow
    the stream here, because its first message looks like a goal and the arm already moves when the
    next one arrives. Instead, the node warns once per stream. Times are monotonic, s.
    """

    def __init__(self) -> None:
        self._last = float('-inf')
        self._count = 0

    def record_and_check(self, points: int, duration: float, now: float) -> str | None:
        """Record a trajectory of `points` points that takes `duration` s.

        Return the warning once for each stream, otherwise None.
        """
        short = points == 1 or duration <= MAX_WINDOW_S
        follows = short and now - self._last < MAX_GAP_S
        self._count = self._count + 1 if follows else int(short)
        if short:
            self._last = now
        return WARNING if self._count == MIN_POINTS else None


class Throttle:
    """Limits samples to `rate` per second. Times are monotonic, s."""

    def __init__(self) -> None:
        self._next = 0.0

    def passes(self, time: float, rate: float) -> bool:
        """Return whether to forward the sample at `time`: the first one per period of 1/`rate` s.

        Periods follow each other directly, except after a gap in the samples, so the mean rate is
        correct.
        """
        if time < self._next:
            return False
        following = self._next + 1.0 / rate
        self._next = following if following > time else time + 1.0 / rate
        return True


IDLE_PERIOD_S, MAX_PERIOD_S = 0.04, 0.5
"""Maximum periods of ~/controller_state, s: IDLE_PERIOD_S without a goal, MAX_PERIOD_S during a
goal with a low action_monitor_rate. The panel and smooth_goals read the arm's joints from this
topic."""

RESULT_TIMEOUT_S = 60
"""Time for which a goal and its result are stored for late requests, s. rclpy's default of 15
minutes would store all points of all goals of that time."""

TRAJECTORY_TOPICS = ('~/joint_trajectory', 'joint_path_command')


class GoalServer:
    """Passes goals from ROS to a driver. Must be created in the driver's event loop."""

    def __init__(self, context: NodeContext, commands: ArmCommands) -> None:
        node = context.node
        self._logger = node.get_logger()
        self._log_outcome = partial(log_outcome, self._logger)
        self._clock = node.get_clock()
        self._loop = asyncio.get_running_loop()
        self._queue = context.driver.goal_queue
        self._commands = commands
        self._bridge = context.bridge
        self._values = context.values
        self.requests = GoalRequests(context.setup, self._clock, self._loop.time)
        self._feedback_throttle = Throttle()
        self._names = context.setup.model.joint_names
        self._published = 0.0
        self._point_streams = PointStreams()
        self._controller_state = node.create_publisher(
            JointTrajectoryControllerState, '~/controller_state', 10
        )
        for topic in TRAJECTORY_TOPICS:
            node.create_subscription(
                JointTrajectory,
                topic,
                self._on_trajectory,
                10,
                callback_group=self._bridge.group,
            )
        action = ActionType(
            FollowJointTrajectory,
            '~/follow_joint_trajectory',
            self._prepare,
            messages.result,
            RESULT_TIMEOUT_S,
        )
        self._action = GoalAction(action, self._queue, self._bridge)

    @property
    def busy(self) -> bool:
        """True while a goal of the action has no result."""
        return self._action.busy

    # --- from ROS: these run in the executor's thread ---------------------------------------

    async def _prepare(
        self, ros_handle: ServerGoalHandle, _plan: PlanningScope
    ) -> Callable[[OnEnd], GoalHandle]:
        goal = self.requests.checked_goal(ros_handle.request)
        return partial(GoalHandle, goal, on_feedback=partial(self._on_feedback, ros_handle))

    def _on_trajectory(self, message: JointTrajectory) -> None:
        try:
            self.take_trajectory(message)
        except GoalRejectedError as rejection:
            self._log_outcome(rejection.outcome)
        except DriverEndedError as error:
            self._logger.warning(f'a trajectory was dropped: {error}')
        except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
            self._bridge.failed('receiving a trajectory', error)

    def take_trajectory(self, message: JointTrajectory) -> None:
        """Submit a trajectory from a topic, or stop the arm if it has no points.

        Raises GoalRejectedError if it is invalid, DriverEndedError if the driver has ended.
        """
        if not message.points:
            self._bridge.to_loop(self._begin_stop)
            return
        duration = duration_in_s(message.points[-1].time_from_start)
        if what := self._point_streams.record_and_check(
            len(message.points), duration, self._loop.time()
        ):
            self._logger.warning(what)
        goal = self.requests.checked_goal(FollowJointTrajectory.Goal(trajectory=message))
        handle = GoalHandle(goal, self._log_outcome, partial(self._on_feedback, None))
        self._bridge.hand_over(self._queue.submit, handle)

    # --- from the driver: these run in the loop's thread ------------------------------------

    def _on_feedback(
        self, ros_handle: ServerGoalHandle | None, execution: GoalExecution, sample: JointSample
    ) -> None:
        stamp = self.publish_state(execution, sample)
        if stamp is not None and ros_handle is not None:
            ros_handle.publish_feedback(messages.feedback(execution, sample, stamp))

    def publish_state(self, execution: GoalExecution, sample: JointSample) -> Time | None:
        """Publish `~/controller_state` at `action_monitor_rate`. Return the stamp if published."""
        if not self._feedback_throttle.passes(sample.time, self._values['action_monitor_rate']):
            return None
        stamp = self._clock.now().to_msg()
        self._controller_state.publish(messages.controller_state(execution, sample, stamp))
        self._published = sample.time
        return stamp

    def on_joints(self, sample: JointSample, stamp: Time) -> None:
        """Publish the measured joints on `~/controller_state`, unless it has a recent message."""
        period = IDLE_PERIOD_S if self._queue.execution is None else MAX_PERIOD_S
        late = sample.time - self._published >= period
        if late and self._controller_state.get_subscription_count():
            self._published = sample.time
            self._controller_state.publish(messages.idle_state(self._names, sample, stamp))

    def _begin_stop(self) -> None:
        task = self._loop.create_task(self._stop_for_topic())
        task.add_done_callback(report_task_error)

    async def _stop_for_topic(self) -> None:
        try:
            self._logger.info(f'empty trajectory: {await self._commands.stop()}')
        except CommandError as error:
            self._logger.error(f'empty trajectory: {error_text(error)}')
