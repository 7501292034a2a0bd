# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion through points that are known in advance, without a stop.

Planning takes longer than a motion cycle. A plan is therefore requested ahead of time, and starts
one planning latency after its request. The latency adapts to the planning times of recent plans,
so few plans are late. A late plan is not used. The previous plan continues instead, so the arm
never waits for the planner.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Plan, Request, Smoother
from epson_driver.profiles.profile import MotionProfile
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.setpoint_follower import SetpointFollower


@dataclass(slots=True)
class DeadlineCounters:
    """Counts of timing and planning failures since the start.

    * deadline_misses: motion cycles that were late by a whole period.
    * late_plans: plans that arrived after their start time, so the previous plan continued.
    * planner_failures: times that the planner process ended or found no plan, plus `violations`.
    * violations: times that the arm braked because its motion would have exceeded a limit.
    """

    deadline_misses: int = 0
    late_plans: int = 0
    planner_failures: int = 0
    violations: int = 0

    def since(self, before: 'DeadlineCounters') -> str:
        counts = (
            (self.deadline_misses - before.deadline_misses, 'late motion cycle(s)'),
            (self.late_plans - before.late_plans, 'plan(s) too late and not used'),
            (self.planner_failures - before.planner_failures, 'planner failure(s)'),
            (self.violations - before.violations, 'limit violation(s) prevented'),
        )
        return ', '.join(f'{count} {text}' for count, text in counts if count)


MAX_ATTEMPTS = 10  # consecutive failed plans from rest
Answer = Callable[[Plan | None], None]

INITIAL_LATENCY_S = 0.04
MIN_LATENCY_S = 0.01
MAX_LATENCY_S = 0.15
PERCENTILE, MARGIN_FACTOR = 90.0, 1.3
"""The planning latency is this percentile of recent planning times, multiplied by this factor."""

LATE_FACTOR = 1.5
"""If a plan is late, the planning latency is multiplied by at least this factor."""

MAX_RECENT_PLANS = 32  # about one second of motion


class PlanningLatency:
    """The expected planning latency, s, from the times of recent plans."""

    def __init__(self) -> None:
        self.value = INITIAL_LATENCY_S
        self._recent = deque([INITIAL_LATENCY_S / MARGIN_FACTOR], MAX_RECENT_PLANS)

    def took(self, seconds: float, late: bool = False) -> None:
        self._recent.append(seconds)
        latency = MARGIN_FACTOR * float(np.percentile(self._recent, PERCENTILE))
        if late:
            latency = max(latency, LATE_FACTOR * self.value)
        self.value = min(max(latency, MIN_LATENCY_S), MAX_LATENCY_S)


class Planner(Protocol):
    """The planner, which accepts one request at a time."""

    @property
    def ready(self) -> bool: ...

    def ask(self, request: Request, limits: JointLimits, answer: Answer) -> None:
        """Request a plan.

        `answer` is called exactly once, with the plan, or with None if planning failed.
        """


class Streaming:
    """An arm that moves smoothly through streamed points within its limits.

    The smoother plans the motion through the points of a trajectory. A stream of setpoints that
    starts at rest is not planned. `SetpointFollower` follows it until a trajectory starts.

    Points are accepted while less than `motion.look_ahead` s and fewer than
    `motion.look_ahead_points` points are known ahead of the arm, and none during a hold or while
    it brakes.

    `uses` selects the fields of a point that determine the time of its move. A duration is
    respected within the limits. Without a duration, a velocity in (0, 1) is the fraction of the
    joints' speed. Without both, the arm is as fast as the limits allow. If `uses` selects no
    field, each move uses the fraction `speed` of the joints' speed. Otherwise `speed` has no
    effect. `accel` has no effect at all, because SPEL+'s Accel only applies to point-to-point
    motion. `motion` gives the initial values of both.

    `low_power_limits` replace `limits` in every motion that starts from rest while `low_power` is
    set. They must have the same position limits. If None, low power changes no limits.

    `timing` counts late plans and prevented violations. `failed` is called with the reason if
    MAX_ATTEMPTS plans from rest fail, or if the smoother brakes to prevent the violation of a
    limit. Raises ValueError if `start`, shape (n,), rad, is not within the limits.
    """

    def __init__(
        self,
        limits: JointLimits,
        start: Array,
        planner: Planner,
        timing: DeadlineCounters,
        failed: Callable[[str], None],
        motion: MotionProfile,
        uses: FieldsUsed,
        low_power_limits: JointLimits | None = None,
    ) -> None:
        self.limits = limits
        self.low_power = False
        self.speed = motion.speed
        self.accel = motion.accel
        self._power_limits = {False: limits, True: low_power_limits or limits}
        self._uses = uses
        self._latency = PlanningLatency()
        self._planner = planner
        self._timing = timing
        self._failed = failed
        self._motion = motion
        self.started_points = 0
        self._accepted_points = 0
        self._now = 0.0
        self._paused = False
        self._braking = False
        # The planner's pending request, its time, and whether its plan must not be used.
        self._request: Request | None = None
        self._request_time = 0.0
        self._request_discarded = False
        self._failed_attempts = 0
        self._reset(start)

    def _reset(self, position: Array) -> None:
        self._smoother = Smoother(
            self._power_limits[self.low_power],
            position,
            latency=self._latency.value,
            planner=None,
        )
        self._follower: SetpointFollower | None = None
        self._discard_request()
        self._goal: Array | None = None
        if self._paused:
            self._smoother.hold()
        self._update_output()

    def _update_output(self) -> None:
        motion = self._smoother.motion if self._follower is None else self._follower.state
        self._position, self._velocity, _ = motion

    @property
    def _source(self) -> Smoother | SetpointFollower:
        return self._smoother if self._follower is None else self._follower

    @property
    def position(self) -> Array:
        return self._position

    @property
    def velocity(self) -> Array:
        return self._velocity

    @property
    def moving(self) -> bool:
        """Whether the arm moves, has points to execute, or waits for a commanded time."""
        return self._source.moving

    @property
    def at_rest(self) -> bool:
        return not self.moving or (self._paused and self._source.at_rest)

    @property
    def has_room(self) -> bool:
        if self._paused or self._braking:
            return False
        return (
            self._source.points_ahead < self._motion.look_ahead_points
            and self._source.look_ahead < self._motion.look_ahead
        )

    @property
    def done(self) -> bool:
        return True

    def take(self, point: Point) -> None:
        """Accept a point. A sequence of 0 starts a new trajectory from rest."""
        starts = point.sequence == 0
        if starts and not self.moving and (point.setpoint or self._follower is not None):
            self._reset(self._position)
            if point.setpoint:
                self._follower = SetpointFollower(self._smoother.limits, self._position)
        self._apply_power()
        if starts:
            self._source.finish()
        self._source.append(point.target, self._duration(point))
        self._goal = point.target
        self._accepted_points += 1

    def stop(self) -> bool:
        """Brake and discard all points.

        Return whether acknowledged points are lost because the arm had not reached the last one.
        """
        lost = self.moving and not self._braking
        self._accepted_points = self.started_points
        self._source.stop()
        self.resume()
        self._braking = self._source.moving
        self._discard_request()
        self._goal = None
        return lost

    def hold(self) -> None:
        """Brake on the path. An arm that is already braking continues to brake."""
        if not self._paused:
            self._paused = True
            self._source.hold()
            self._discard_request()

    def resume(self) -> None:
        self._paused = False
        self._source.resume()

    def set_position(self, position: Array) -> None:
        if self.moving:
            raise RuntimeError(
                'the arm is moving or has pending points: it cannot be moved by hand'
            )
        self._reset(position)

    def step(self, dt: float) -> None:
        self._now += dt
        violations = self._smoother.violations
        self._source.step(dt)
        self._update_output()
        if self._smoother.violations > violations:
            self._on_limit_violation()
        self._braking = self._braking and self._source.moving
        ahead = max(self._source.points_ahead - 1, 0)
        self.started_points = max(self.started_points, self._accepted_points - ahead)
        self._apply_power()
        if self._follower is None and self._request is None and self._planner.ready:
            request = self._smoother.request()
            if request is not None:
                self._request = request
                self._request_time = self._now
                self._planner.ask(request, self._smoother.limits, self._receive_plan)

    def _on_limit_violation(self) -> None:
        self._timing.violations += 1
        self._discard_request()
        self._braking = self._smoother.moving
        self._goal = None
        self._failed(f'the arm brakes: {self._smoother.violation}')

    def _apply_power(self) -> None:
        limits = self._power_limits[self.low_power]
        if limits is not self._source.limits and self._source.at_rest:
            self._source.change_limits(limits)
            self._discard_request()

    def _discard_request(self) -> None:
        self._request_discarded = self._request is not None

    def _duration(self, point: Point) -> float | None:
        if self._uses.duration and point.duration > 0.0:
            return point.duration
        fraction = point.velocity if self._uses.velocity else 0.0
        if self._uses is FieldsUsed.NOTHING:
            fraction = self.speed
        if not 0.0 < fraction < 1.0:
            return None
        origin = self._position if self._goal is None else self._goal
        distance = float(np.max(np.abs(point.target - origin) / self.limits.velocity))
        return distance / fraction or None

    def _receive_plan(self, plan: Plan | None) -> None:
        request, self._request = self._request, None
        discarded, self._request_discarded = self._request_discarded, False
        used = not discarded and self._smoother.take(plan)
        late = plan is not None and not used and not discarded
        self._timing.late_plans += late
        self._latency.took(self._now - self._request_time, late)
        self._smoother.latency = self._latency.value
        at_rest = request is not None and request.start is None
        failed = plan is None and at_rest and not discarded
        self._failed_attempts = self._failed_attempts + 1 if failed else 0
        if self._failed_attempts >= MAX_ATTEMPTS:
            self._failed_attempts = 0
            self._failed(f'no path found in {MAX_ATTEMPTS} attempts')
