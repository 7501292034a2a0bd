# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Methods of a Robot that move the arm, and the speed scaling of its motions."""

from collections.abc import Callable, Sequence
from functools import partial
from os import PathLike

import numpy.typing as npt

from epson_driver.api import moves
from epson_driver.api.arm import Arm
from epson_driver.api.errors import checked_arguments, not_started, refusals
from epson_driver.api.motion import Motion
from epson_driver.api.poses import Pose, Waypoint, is_pose
from epson_driver.api.recording import RATE, SPEED, Recording
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.motion import Array
from epson_driver.motion.point_to_point import LONGEST_SEGMENT_S, straight
from epson_driver.tool_motion.joint_path import ShownFrame
from epson_driver.tool_motion.pose_path import Run
from epson_driver.tool_motion.tool_trajectory import ToolLimits, trajectory_along_runs


class Motions(Arm):
    """Methods that move the arm and return a Motion. Robot inherits all of them."""

    @checked_arguments
    async def move_joints(
        self,
        target: 'Pose',
        *,
        speed: float = 0.2,
        acceleration: float = 0.5,
        wait: bool = True,
    ) -> Motion:
        """Move straight in joint space to n joint positions, rad (m), or to a pose of the tool.

        * target: joint positions, or a pose in any form that `move_line` accepts. A pose is in
          base_link, an EpsonPoint in EPSON's world. The arm reaches it in the configuration
          nearest to the current one.
        * speed, acceleration: fractions of the joint limits, (0, 1].
        * wait: whether to wait until the arm has arrived. Ctrl-C, or a cancellation of the task,
          during the wait stops the arm.

        Raises ArgumentError if an argument is invalid, and MotionError if the arm is not enabled,
        another motion is running, or this motion fails. Both are RobotErrors. A running motion is
        never replaced. Wait for its end or cancel it first.
        """
        limits = self.model.limits
        moves.check_speeds(speed, acceleration)
        pose = is_pose(target, len(limits.names))
        if pose:
            self._frames.target('target', target, None)
        else:
            positions = moves.joint_rows('target', target, limits, rows=False)
            positions = moves.targets('target', positions[None, :], limits).positions[0]
        start, plan = await self._connection.ready()
        if pose:
            positions = self._joints_at('target', target, None, start)
        trajectory, written = self._setup.joint_move(start, positions, speed, acceleration)
        return await self._connection.execute(trajectory, plan, wait=wait, move=written)

    @checked_arguments
    async def move_waypoints(
        self,
        points: 'npt.ArrayLike',
        *,
        speed: float = 0.2,
        acceleration: float = 0.5,
        wait: bool = True,
    ) -> Motion:
        """Move through joint positions, shape (k, n), rad (m), without stops where possible.

        speed, acceleration: fractions of the joint limits, (0, 1]. The motion is as fast as these
        fractions allow. If the controller stops at each point of a trajectory, the arm also stops
        at each of these points. Planning may take seconds, even with `wait=False`. Raises the
        exceptions of `move_joints`.
        """
        from epson_driver.driver.smoothing import Smoothing, SmoothingError

        limits = self.model.limits
        moves.check_speeds(speed, acceleration)
        waypoints = moves.targets('points', points, limits)
        start, plan = await self._connection.ready()
        smoother = self._connection.running.goal_queue.smoother
        ignored = not self._setup.profile.program.uses.duration
        smoothing = Smoothing(time_optimal=True, own_points=ignored, longest=LONGEST_SEGMENT_S)
        try:
            trajectory, remark = await smoother.prepared(
                waypoints, start, (speed, acceleration), smoothing
            )
        except SmoothingError as error:
            raise not_started(str(error)) from error
        finally:
            smoother.make_ready()
        return await self._connection.execute(trajectory, plan, wait=wait, remark=remark)

    @checked_arguments
    async def move_trajectory(
        self,
        times: 'npt.ArrayLike',
        positions: 'npt.ArrayLike',
        velocities: 'npt.ArrayLike | None' = None,
        *,
        joint_names: Sequence[str] | None = None,
        wait: bool = True,
    ) -> Motion:
        """Execute a planned trajectory unchanged, starting at the current position.

        * times: time of each point from the start, shape (k,), s, strictly increasing.
        * positions, velocities: shape (k, n), rad and rad/s (m, m/s).
        * joint_names: names of the joints in the order of the columns. None: the model's order.

        docs/goals.md lists the requirements on a trajectory. Raises the exceptions of
        `move_joints`.
        """
        limits = self.model.limits
        trajectory = moves.planned(times, positions, velocities, joint_names, limits)
        return await self._connection.execute(trajectory, PlanningCancellation(), wait=wait)

    @checked_arguments
    def record(self, rate: float = 1000.0) -> Recording:
        """Start to record the measured joints. `Recording.stop` ends the recording.

        The arm may be moved by any program or by hand. rate: maximum number of samples per second.
        The controller may send fewer. Raises RobotError if not connected, ArgumentError if the
        rate is invalid.
        """
        period = 1.0 / RATE.checked(rate, 'rate')
        self._connection.running  # noqa: B018 - it raises if not connected
        recording = Recording(self.model.joint_names, period)
        recording.start(self._connection.changes.recorded.add)
        return recording

    @checked_arguments
    async def replay(
        self,
        recording: Recording | str | PathLike[str],
        *,
        speed: float = 1.0,
        wait: bool = True,
    ) -> Motion:
        """Move straight in joint space to a recording's first position, then replay the recording.

        * recording: a Recording, which is stopped if it is running, or the path of a file.
        * speed: fraction of the recorded speed, 0.01 to 1.

        The pause before the first recorded motion is skipped. Later pauses are replayed. Raises
        ArgumentError if the file cannot be read, and the exceptions of `move_trajectory`.
        """
        SPEED.checked(speed, 'speed')
        if not isinstance(recording, Recording):
            recording = Recording.load(recording)
        recording.stop()
        limits = self.model.limits
        path = moves.checked(recording.plan(limits, speed), limits, 'recording')
        start, plan = await self._connection.ready()
        trajectory, _ = self._setup.joint_move(start, path.positions[0], 0.2, 0.5)
        return await self._connection.execute(moves.joined(trajectory, path), plan, wait=wait)

    @checked_arguments
    async def move_line(
        self,
        pose: 'Pose',
        *,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        jerk: float | None = None,
        slow: bool = True,
        wait: bool = True,
    ) -> Motion:
        """Move the tool along a straight line to a pose.

        The tool rotates about a fixed axis at the same time.

        * pose: a homogeneous matrix, shape (4, 4), m, or x y z, m, and a quaternion x y z w, shape
          (7,), or an EpsonPoint.
        * frame: the frame of the pose: 'base_link', 'base' (EPSON's world), 'tool' (the current
          tool frame), or a name given to `set_frame`. None: 'base_link', or 'base' for an
          EpsonPoint.
        * speed, acceleration: limits of the tool, m/s and m/s².
        * turn_speed, turn_acceleration: limits of the tool's rotation, rad/s and rad/s².
        * jerk: jerk limit of the tool, m/s³. None: `acceleration` times 10 / s. The jerk limit of
          the rotation is `turn_acceleration` times the ratio of `jerk` to `acceleration`.
        * accuracy: maximum distance between the line and the path through the sent points, m. If
          the arm's measured distance from the line is larger, the motion's text reports it.
        * slow: True reduces the speed where a joint limit requires it. False rejects such a line.

        Raises PathError, before anything is sent, if the pose is out of reach or the line passes a
        singularity. Also raises the exceptions of `move_joints`.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, jerk=jerk, slow=slow
        )
        point = moves.PathPoint(self._frames.target('pose', pose, frame))
        shown = self._frames.shown(frame, pose)
        return await self._move_tool(point.run, tool, wait, shown, point)

    @checked_arguments
    async def move_arc(
        self,
        via: 'npt.ArrayLike',
        pose: 'Pose',
        *,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        jerk: float | None = None,
        slow: bool = True,
        wait: bool = True,
    ) -> Motion:
        """Move the tool along an arc through a point to a pose.

        via: the point, x y z, in m and in the frame of the pose, even if the pose is an
        EpsonPoint. `move_line` describes the other arguments and the exceptions.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, jerk=jerk, slow=slow
        )
        middle = self._frames.point('via', via, frame, pose)
        point = moves.PathPoint(self._frames.target('pose', pose, frame), middle)
        shown = self._frames.shown(frame, pose)
        return await self._move_tool(point.run, tool, wait, shown, point)

    @checked_arguments
    async def move_path(
        self,
        points: 'Sequence[Waypoint | Pose]',
        *,
        blend: float = 0.0,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        jerk: float | None = None,
        slow: bool = True,
        wait: bool = True,
    ) -> Motion:
        """Move the tool through poses or Waypoints, along a line or an arc to each of them.

        * blend: distance from a point, m, within which the tool may cut the corner without a stop.
          The tool is then as fast as the limits allow. 0: the tool stops at the point. A Waypoint
          may have a different blend and frame.
        * frame: see `move_line`. The frame 'tool' is the tool frame at the start of the motion.

        `move_line` describes the other arguments and the exceptions. An exception's text contains
        the index of the point that is invalid or whose blend is longer than its segment.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, jerk=jerk, slow=slow
        )
        path_points = moves.path_points(points, blend, frame, self._frames)
        path, last = partial(moves.path_runs, path_points), points[-1]
        if isinstance(last, Waypoint):
            frame, last = last.frame or frame, last.pose
        return await self._move_tool(path, tool, wait, self._frames.shown(frame, last))

    async def _move_tool(
        self,
        path: Callable[[Array], list[Run]],
        limits: ToolLimits,
        wait: bool,
        shown: ShownFrame,
        point: moves.PathPoint | None = None,
    ) -> Motion:
        tool, arm = self._hand
        tool.check(limits.speed, limits.acceleration)
        start, plan = await self._connection.ready()
        tool_path = path(arm.forward(start))
        if not tool_path:  # the tool is already there
            trajectory = straight(start, start, self.model.limits, 1.0, 1.0, sampled=False)
            return await self._connection.execute(
                trajectory, plan, wait=wait, move=lambda written: written.joints(start, 0.01, 0.01)
            )
        with refusals():
            trajectory = await plan.in_thread(
                partial(trajectory_along_runs, arm, start, tool_path, limits, frame=shown)
            )
        checked_path = (moves.deviation(arm, tool_path), limits.accuracy)
        via = None
        if point is not None and point.via is not None:
            via = point.via.in_base_link(arm.forward(start))[:3, 3]
        return await self._connection.execute(
            trajectory,
            plan,
            wait=wait,
            path=checked_path,
            move=None
            if point is None
            else lambda written: written.path(arm, tool.pose, trajectory.positions, limits, via),
        )

    @property
    def speed_scaling(self) -> float:
        """Speed of all motions as a fraction of their planned speed."""
        return self._connection.running.goal_queue.scaling.target

    @checked_arguments
    def set_speed_scaling(self, factor: float) -> None:
        """Set the speed of all motions as a fraction of the planned speed, even during a motion.

        factor: 0.01 to 1, or 0 for a pause. In a pause the arm comes to rest, and the motion
        continues once the factor is above 0. A lower factor takes effect with a delay, because it
        does not slow down points that the controller already has (docs/goals.md). Raises
        ArgumentError if the factor is invalid, RobotError if the controller does not support it.
        """
        self._connection.set_speed_scaling(moves.checked_factor(factor))
