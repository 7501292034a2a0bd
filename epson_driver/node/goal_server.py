# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals from ROS: the action `~/follow_joint_trajectory` and the two topics for trajectories.

Each request is converted to a goal (trajectory_messages.py) and passed to the driver's goal queue,
which reports feedback and the outcome.
"""

import asyncio
from functools import partial

from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.action.server import ServerGoalHandle
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import report_task_error
from epson_driver.node import messages
from epson_driver.node.loop_bridge import (
    DriverEndedError,
    GoalAction,
    NodeContext,
    OnEnd,
    log_outcome,
)
from epson_driver.node.messages import error_text
from epson_driver.node.trajectory_messages import GoalRequests, duration_in_s

MAX_GAP_S = 0.3
"""Maximum time between two messages of a stream, s."""

MIN_POINTS = 3
"""Number of consecutive messages that count as a stream."""

MAX_WINDOW_S = 0.5
"""Maximum duration of a window, a short trajectory that is part of a stream, s."""

WARNING = (
    'single points or short windows arrive as a stream: this topic takes each as a separate goal, '
    'which starts after the arm has stopped, or is rejected if it starts too far from the arm. '
    'Send streams to ~/servo'
)


class PointStreams:
    """Detects a stream of setpoints (single points or windows) on a topic that is meant for goals.

    Each message is executed as a goal. A goal replaces the running goal only after the arm has
    come to rest, so the arm moves jerkily and falls behind a stream. The node cannot follow the
    stream as a stream, because its first message looks like a goal, and the arm already moves when
    the second message arrives. Therefore the node warns once per stream. Times are monotonic, s.
    """

    def __init__(self) -> None:
        self._last = float('-inf')
        self._count = 0

    def record_and_check(self, points: int, duration: float, now: float) -> str | None:
        """Record a message. Return a warning with the third message of a stream, else None.

        points, duration: number of points, and duration of the message's trajectory, s.
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
        """Return whether to forward the sample at `time`, s.

        Only the first sample of each period of 1/`rate` s is forwarded. A period starts at the end
        of the previous period, so the mean rate is correct. After a gap in the samples, a period
        starts at the next sample.
        """
        if time < self._next:
            return False
        following = self._next + 1.0 / rate
        self._next = following if following > time else time + 1.0 / rate
        return True


IDLE_PERIOD_S, MAX_PERIOD_S = 0.04, 0.5
"""Maximum periods of ~/controller_state, s: IDLE_PERIOD_S without a goal, and MAX_PERIOD_S during
a goal if action_monitor_rate is low. The panel and smooth_goals read joints from this topic."""

TRAJECTORY_TOPICS = ('~/joint_trajectory', 'joint_path_command')


class GoalServer:
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
                JointTrajectory, topic, self._on_trajectory, 10, callback_group=self._bridge.group
            )
        self._action = GoalAction(
            self._bridge,
            self._queue,
            FollowJointTrajectory,
            '~/follow_joint_trajectory',
            self._prepare,
            messages.result,
        )

    @property
    def busy(self) -> bool:
        return self._action.busy

    # --- from ROS: these run in the executor's thread ---------------------------------------

    async def _prepare(
        self, ros_handle: ServerGoalHandle, _plan: PlanningCancellation, on_end: OnEnd
    ) -> GoalHandle:
        goal = self.requests.checked_goal(ros_handle.request)
        return GoalHandle(goal, on_end, partial(self._on_feedback, ros_handle))

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
        """Submit a trajectory from a topic, or stop the arm if the trajectory has no points.

        Raises GoalRejectedError if the trajectory is invalid, DriverEndedError if the driver has
        ended.
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
        """Publish `~/controller_state` if it is due. Return its stamp if published."""
        if not self._feedback_throttle.passes(sample.time, self._values['action_monitor_rate']):
            return None
        stamp = self._clock.now().to_msg()
        self._controller_state.publish(messages.controller_state(execution, sample, stamp))
        self._published = sample.time
        return stamp

    def on_joints(self, sample: JointSample, stamp: Time) -> None:
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
