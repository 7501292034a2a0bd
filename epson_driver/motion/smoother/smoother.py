# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoother: points in as they come, one smooth motion out."""

import logging
import math
from collections.abc import Sequence

from epson_driver.motion.joint_motion import fastest_move
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.execution import Execution, Observer
from epson_driver.motion.smoother.output_guard import Motion, OutputGuard, Violation
from epson_driver.motion.smoother.planner import plan
from epson_driver.motion.smoother.replanning import Planner, Replanning
from epson_driver.motion.smoother.request import Plan, Request
from epson_driver.motion.smoother.waypoints import Mode, Waypoints

log = logging.getLogger(__name__)


class Smoother:
    """A smooth motion through streamed points, inside every limit.

    `position` is where the arm rests at first, shape (n,), rad. Time passes with `step`. Planning
    takes a while: by default it is done in `step`, and a plan counts `latency` s later. With
    `planner` None, whoever owns the smoother has each `request` planned elsewhere and calls
    `take`; `latency` is how long that may take then.

    Whatever happens to the stream, the arm comes to rest at the last point known, never beyond.
    Should what `step` is about to give out break a limit, the arm brakes from what it gave out
    last, all points are forgotten, an error is logged, and `violations` counts it: that is a
    defect of this package. `violation` says what the last one was. A planner that raises has found
    no plan: the plan so far, which ends at rest, goes on, an error is logged, `planner_errors`
    counts it, and `planner_error` is the last one. `observer` is told of every change of what is
    executed. A motion that is late is made about `catch_up` times as fast as commanded at most;
    with 1 it stays late.

    Raises ValueError for a start that is not n finite numbers within the limits, or a `catch_up`
    below 1.
    """

    def __init__(
        self,
        limits: JointLimits,
        position: Array,
        mode: Mode = Mode.TIME_PRESERVING,
        *,
        latency: float = 0.0,
        planner: Planner | None = plan,
        observer: Observer | None = None,
        catch_up: float = math.inf,
    ) -> None:
        if not catch_up >= 1.0:  # NaN too
            raise ValueError(f'catch_up = {catch_up}: must be 1 or more')
        self._waypoints = Waypoints(limits, position, mode)
        self._execution = Execution(self._waypoints, observer)
        self._replanning = Replanning(self._waypoints, self._execution, planner, latency, catch_up)
        self._guard = OutputGuard(self.motion)
        self.violations = 0
        self.violation: Violation | None = None

    # What comes in.

    def append(self, position: Array, duration: float | None = None) -> None:
        """Go on to another point, shape (n,), rad.

        `duration`: for the way from the point before, s; None: as fast as the limits allow. Raises
        ValueError, and takes nothing, for numbers that are wrong or outside the position limits.
        """
        execution = self._execution
        self._waypoints.append(position, duration, execution.now, in_motion=execution.in_motion)
        self._replanning.news = True

    def finish(self) -> None:
        """Rest at the last point: the trajectory ends there. Points that follow begin another."""
        if self._waypoints.finish():
            self._replanning.news = True

    def stop(self) -> None:
        """Forget all points and come to rest, on the path if that can be verified."""
        self._forget()
        self._execution.stop()

    def replace(self, points: Array, durations: Sequence[float | None] | None = None) -> None:
        """Forget all points and go through others, shape (k, n), from wherever the arm is.

        A moving arm goes to the first of them in joint space, straight out of its motion, and
        rests there for an instant; one that is `held` comes to rest. Raises as `append`.
        """
        each = [None] * len(points) if durations is None else durations
        if len(each) != len(points):
            raise ValueError(f'{len(each)} durations for {len(points)} points')
        checked = [
            self._waypoints.checked(point, duration, f'point {index}')
            for index, (point, duration) in enumerate(zip(points, each, strict=True))
        ]
        move = None
        if self._execution.in_motion and checked and not self.held:
            move = fastest_move(self.limits, self.motion, checked[0])
        self._forget()
        if move is None:
            self._execution.stop()
        else:
            self._execution.move_off_the_path(move)
        for point, duration in zip(checked, each, strict=True):
            self.append(point, duration)

    def change_limits(self, limits: JointLimits) -> None:
        """Keep to other limits from now on, with the same ones of position.

        The points are kept. Raises RuntimeError unless the arm is `at_rest`.
        """
        if not self.at_rest:
            raise RuntimeError('the limits of a motion cannot change: only at rest')
        paused = self._execution.plan
        if paused is not None:  # its path is measured in the speeds so far
            self._execution.rest_between(paused, paused.timing.end)
        self._waypoints.limits = limits
        self._replanning.start_over()

    @property
    def held(self) -> bool:
        """Whether the arm rests on its path, or brakes for that, until `resume`."""
        return self._execution.held

    def hold(self) -> None:
        """Rest on the path, and keep the points. A second call is no error."""
        if not self.held:
            self._execution.held = True
            self._execution.clock_start = None
            self._replanning.start_over()
            self._execution.pause()

    def resume(self) -> None:
        """Go on to the points after `hold`. The lost time is not made up for."""
        self._execution.held = False

    def _forget(self) -> None:
        """Forget all points, and what is planned for them. The motion goes on."""
        self._waypoints.forget()
        self._replanning.forget()

    # What comes out.

    def step(self, dt: float) -> Motion:
        """Let `dt` s pass, and return the motion then.

        Raises ValueError for a time that is negative or no finite number.
        """
        if not 0.0 <= dt < math.inf:  # NaN too
            raise ValueError(f'dt = {dt} s: must be 0 or more')
        execution = self._execution
        end = execution.now + dt
        self._replanning.plan_now()
        while (due := execution.next_change()) <= end:
            execution.change(due)
            self._replanning.plan_now()
        execution.pass_time(end)
        return self._guarded(dt)

    def _guarded(self, dt: float) -> Motion:
        """Return the motion now if that can follow what was given out `dt` s ago, or a braking."""
        motion = self.motion
        violation = self._guard.violation(motion, dt, self.limits)
        if violation is None:
            return motion
        self.violations += 1
        self.violation = violation
        log.error(
            'the smooth motion is not what was planned, and the arm brakes: %s (violation %d)',
            violation,
            self.violations,
        )
        self._forget()
        self._execution.brake(self._guard.last, elapsed=dt)
        self._guard.last = motion = self.motion
        return motion

    @property
    def motion(self) -> Motion:
        """The motion now."""
        return self._execution.motion

    @property
    def now(self) -> float:
        """How much time has passed, s."""
        return self._execution.now

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands now, be it with points to go to."""
        return self._execution.at_rest

    @property
    def moving(self) -> bool:
        """Whether the arm moves, has points to go to, or was told to rest for a time."""
        execution, waypoints = self._execution, self._waypoints
        return (
            execution.in_motion
            or execution.next is not None
            or bool(waypoints.ahead)
            or execution.beside_last
            or execution.now < waypoints.rest_until
        )

    @property
    def look_ahead(self) -> float:
        """How much is known ahead, s: commanded time, or time at full speed without one."""
        execution, waypoints = self._execution, self._waypoints
        if execution.plan is None or execution.stopping:
            return waypoints.time_from_rest(execution.now)
        return waypoints.last.clock - execution.plan.clock(execution.now)

    @property
    def points_ahead(self) -> int:
        """How many points lie ahead."""
        return len(self._waypoints.ahead)

    # What it keeps to, and how it is planned.

    @property
    def limits(self) -> JointLimits:
        """The limits of the joints, as `change_limits` set them."""
        return self._waypoints.limits

    @property
    def mode(self) -> Mode:
        """What the durations of the points mean."""
        return self._waypoints.mode

    @property
    def latency(self) -> float:
        """How long planning may take, s."""
        return self._replanning.latency

    @latency.setter
    def latency(self, value: float) -> None:
        self._replanning.latency = value

    def request(self) -> Request | None:
        """Return what should be planned now, or None. `take` its plan before the next one."""
        return self._replanning.request()

    def take(self, answer: Plan | None) -> bool:
        """Take the plan for the last request and return whether it is used.

        One that comes too late, or None, changes nothing.
        """
        return self._replanning.take(answer)

    @property
    def planner_errors(self) -> int:
        """How often the planner raised."""
        return self._replanning.planner_errors

    @property
    def planner_error(self) -> Exception | None:
        """The last exception of the planner, or None."""
        return self._replanning.planner_error
