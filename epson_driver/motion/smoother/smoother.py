# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoother, which turns points into one smooth motion while they arrive."""

import logging
import math

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.execution import Execution, Observer
from epson_driver.motion.smoother.output_guard import Motion, OutputGuard, Violation
from epson_driver.motion.smoother.planner import plan
from epson_driver.motion.smoother.replanning import Planner, Replanning
from epson_driver.motion.smoother.request import Plan, Request
from epson_driver.motion.smoother.waypoints import Mode, Waypoints

log = logging.getLogger(__name__)


class Smoother:
    """A smooth motion through streamed points, within every limit.

    The motion starts from rest at `position`, shape (n,), rad. `step` advances time. By default,
    `step` also plans, and a plan takes effect `latency` s later. With `planner` None, the caller
    plans each `request` and passes the plan to `take` within `latency` s.

    If the stream of points ends, the arm comes to rest at the last point. An error is logged, and
    the arm comes to rest, too:

    * If the next output of `step` would exceed a limit, which is a defect of this package, all
      points are discarded, and the arm brakes from the last output. `violations` counts these
      events, and `violation` is the last one.
    * If the planner raises, the current plan continues. `planner_errors` counts these exceptions,
      and `planner_error` is the last one.

    `catch_up`: approximate maximum ratio of the speed to the commanded speed while a late motion
    makes up time. With 1, the motion stays late. `observer` is called with every new motion.

    Raises ValueError if `position` is invalid or outside the limits, or `catch_up` is below 1.
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

    def append(self, position: Array, duration: float | None = None) -> None:
        """Append a point, shape (n,), rad.

        `duration`: time from the previous point, s. With None, the motion is as fast as the limits
        allow. Raises ValueError, and changes nothing, if a number is invalid or outside the
        position limits.
        """
        execution = self._execution
        self._waypoints.append(position, duration, execution.now, in_motion=execution.in_motion)
        self._replanning.news = True

    def finish(self) -> None:
        """End the trajectory with a rest at the last point. Later points belong to a new one."""
        if self._waypoints.finish():
            self._replanning.news = True

    def stop(self) -> None:
        """Discard all points and come to rest, on the path if a stop there respects the limits."""
        self._forget()
        self._execution.stop()

    def change_limits(self, limits: JointLimits) -> None:
        """Replace the limits, except the position limits. Raises RuntimeError unless `at_rest`."""
        if not self.at_rest:
            raise RuntimeError('the limits can only change while the arm is at rest')
        paused = self._execution.plan
        if paused is not None:  # the path's u depends on the old velocity limits
            self._execution.rest_between(paused, paused.timing.end)
        self._waypoints.limits = limits
        self._replanning.start_over()

    @property
    def held(self) -> bool:
        """Whether the arm rests on its path, or brakes to rest, because of `hold`."""
        return self._execution.held

    def hold(self) -> None:
        """Come to rest on the path, and keep the points. A second call has no effect."""
        if not self.held:
            self._execution.held = True
            self._execution.clock_start = None
            self._replanning.start_over()
            self._execution.pause()

    def resume(self) -> None:
        """Continue to the points after `hold`. The lost time is not made up."""
        self._execution.held = False

    def _forget(self) -> None:
        self._waypoints.forget()
        self._replanning.forget()

    def step(self, dt: float) -> Motion:
        """Advance time by `dt` s, ≥ 0, and return the motion at the new time."""
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

    def steps(self, dt: float, count: int) -> list[Motion]:
        """Advance time as up to `count` steps of `dt` > 0 s do, until the arm no longer moves.

        Steps along one plan are evaluated together, so the next plan may start later than with
        separate steps.
        """
        motions: list[Motion] = []
        execution = self._execution
        while len(motions) < count and self.moving:
            motions.append(self.step(dt))
            times = execution.now + dt * np.arange(1.0, count - len(motions) + 1.0)
            times = times[times < execution.next_change()]
            if execution.plan is None or execution.paused or not len(times):
                continue
            batch = execution.plan.along(times)
            if self._guard.allows(batch, dt, self.limits):  # otherwise the next step brakes
                execution.pass_time(float(times[-1]))
                motions += map(Motion, *batch)
        return motions

    def _guarded(self, dt: float) -> Motion:
        """Return the current motion. If it exceeds a limit, brake from the previous output.

        dt: time since the previous output, s.
        """
        motion = self.motion
        violation = self._guard.violation(motion, dt, self.limits)
        if violation is None:
            return motion
        self.violations += 1
        self.violation = violation
        log.error(
            'the smooth motion deviates from the plan, so the arm brakes: %s (violation %d)',
            violation,
            self.violations,
        )
        self._forget()
        self._execution.brake(self._guard.last, elapsed=dt)
        self._guard.last = motion = self.motion
        return motion

    @property
    def motion(self) -> Motion:
        return self._execution.motion

    @property
    def now(self) -> float:
        return self._execution.now

    @property
    def at_rest(self) -> bool:
        """Whether the arm is at rest now, even if points are ahead."""
        return self._execution.at_rest

    @property
    def moving(self) -> bool:
        """Whether the arm moves, has points ahead, or is at rest for a commanded time."""
        execution, waypoints = self._execution, self._waypoints
        return (
            execution.in_motion
            or execution.next is not None
            or bool(waypoints.ahead)
            or execution.near_last
            or execution.now < waypoints.rest_until
        )

    @property
    def look_ahead(self) -> float:
        """Duration of the motion to all points ahead, s, at full speed where no time is given."""
        execution, waypoints = self._execution, self._waypoints
        if execution.plan is None or execution.stopping:
            return waypoints.time_from_rest(execution.now)
        return waypoints.last.clock - execution.plan.clock(execution.now)

    @property
    def points_ahead(self) -> int:
        return len(self._waypoints.ahead)

    @property
    def limits(self) -> JointLimits:
        return self._waypoints.limits

    @property
    def latency(self) -> float:
        """Time allowed for planning, s."""
        return self._replanning.latency

    @latency.setter
    def latency(self, value: float) -> None:
        self._replanning.latency = value

    def request(self) -> Request | None:
        """Return the next planning request. None: no request is due, or one is pending."""
        return self._replanning.request()

    def take(self, answer: Plan | None) -> bool:
        """Accept the plan for the last request. Return False if the plan is None or too late."""
        return self._replanning.take(answer)

    @property
    def planner_errors(self) -> int:
        return self._replanning.planner_errors

    @property
    def planner_error(self) -> Exception | None:
        return self._replanning.planner_error
