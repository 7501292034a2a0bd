# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion that the smoother executes: along a plan, off the path, or at rest."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from epson_driver.motion.joint_motion import JointMotion, fastest_stop
from epson_driver.motion.limits import Array
from epson_driver.motion.smoother import ruckig_move
from epson_driver.motion.smoother.output_guard import Motion
from epson_driver.motion.smoother.request import ActivePlan, Problem
from epson_driver.motion.smoother.waypoints import MIN_MOVE, Waypoint, Waypoints
from epson_driver.motion.time_parametrisation import TimeParametrisation

JUST_STARTED_S = 1.1e-5
"""Time after a start from rest during which the arm still counts as at rest."""

MAX_STOP_RATIO = 8.0
"""Maximum duration of a stop on the path, as a multiple of the fastest stop's. Near a rest, the
parameter of a path in time still rises by 1 per second."""

Observer = Callable[[float, ActivePlan | JointMotion | None], None]
"""Function called with the start time, s, and each new motion, which is None for a rest."""


class Execution:
    """The motion of the arm over time.

    * plan, joint_motion: the executed plan or joint motion. If both are None, the arm is at rest.
    * next: a plan that starts later, or None.
    * now: current time, s, which the caller advances.
    """

    def __init__(self, waypoints: Waypoints, observer: Observer | None = None) -> None:
        self._waypoints = waypoints
        self._observer = observer
        self._position = waypoints.origin.position
        self.now = 0.0
        self.plan: ActivePlan | None = None
        self.joint_motion: JointMotion | None = None
        self._joint_motion_start = 0.0
        self.next: ActivePlan | None = None
        self.stopping = False
        """Whether the arm brakes to rest because its points were discarded."""
        self.paused = False
        """Whether the arm rests on the path, because a plan with `pause` has ended."""
        self.held = False
        """Whether the arm must rest on the path until `Smoother.resume`."""
        self.clock_start: float | None = None
        """Time of the zero of the points' commanded times, s. None: the next plan sets it."""

    @property
    def motion(self) -> Motion:
        if self.joint_motion is not None:
            return Motion(*self.joint_motion.at(self.now - self._joint_motion_start))
        if self.plan is None:
            zeros = np.zeros_like(self._position)
            return Motion(self._position.copy(), zeros, zeros.copy())
        u, v, a = self.plan.timing.at(self.now - self.plan.start)
        q, first, second = self.plan.path.at(u)
        return Motion(q, first * v, first * a + second * (v * v))

    @property
    def in_motion(self) -> bool:
        """Whether the arm moves, or rests on the path.

        If not, it rests at the origin of the waypoints.
        """
        return self.plan is not None or self.joint_motion is not None

    @property
    def at_rest(self) -> bool:
        return self.paused or not self.in_motion

    @property
    def near_last(self) -> bool:
        """Whether the arm rests within the merge tolerance of the last point, but not at it."""
        return not self.in_motion and self._waypoints.near_last(self._position)

    def next_change(self) -> float:
        """Return the time at which the next plan starts or the executed motion ends, s."""
        due = math.inf if self.next is None else self.next.start
        if self.joint_motion is not None:
            return min(due, self._joint_motion_start + self.joint_motion.duration)
        if self.plan is not None and not self.paused:
            return min(due, self.plan.end)
        return due

    def change(self, due: float) -> None:
        """Advance time to the next change of the motion, and make this change.

        due: time of the change, s, as returned by `next_change`.
        """
        self.now = max(self.now, due)
        plan = self.plan
        if self.next is not None and self.next.start <= self.now:
            self._start_next(self.next)
        elif self.joint_motion is not None:
            self._arrive(self.joint_motion.end)
        elif plan is not None and plan.timing.end < plan.path.end:
            if self.stopping:
                self._arrive(plan.path.at(plan.timing.end)[0])
            elif plan.pause:
                self.paused = True
                self.clock_start = None
            else:
                self.rest_between(plan, plan.timing.end)
        elif plan is not None:
            self._arrive(plan.path.knots.position[-1], None if self.stopping else plan.route[-1])

    def pass_time(self, until: float) -> None:
        """Advance time to `until`, s, without a change, and remove the points passed by then."""
        self.now = until
        plan = self.plan
        if plan is None:
            return
        u, _, _ = plan.timing.at(self.now - plan.start)
        passed = plan.route[-1]
        if u < plan.path.end:
            passed = plan.route[plan.path.segment(u)]
        self._waypoints.passed(passed)

    def _start_next(self, plan: ActivePlan) -> None:
        if self.plan is None or self.clock_start is None:
            self.clock_start = plan.start - plan.clock(plan.start)
        self.next = None
        self._execute(plan)
        self.paused = False

    def _arrive(self, position: Array, point: Waypoint | None = None) -> None:
        self._position = position
        self._waypoints.arrived(self.now, point)
        self._execute(None)
        self.stopping = self.paused = False
        self.clock_start = None

    def rest_between(self, plan: ActivePlan, u: float) -> None:
        """Come to rest between two points, at path parameter `u`. The next path starts there."""
        position = plan.path.at(u)[0]
        segment = plan.path.segment(u)
        remaining = plan.path.knots.position[segment + 1] - position
        if np.max(np.abs(remaining)) <= MIN_MOVE:
            segment += 1  # the remainder is only rounding
        if segment == len(plan.route) - 1:
            self._arrive(position, plan.route[segment])
            return
        index = plan.route[segment].index
        self._arrive(position, Waypoint(index, position, position, plan.clock(self.now)))

    def _execute(self, motion: ActivePlan | JointMotion | None) -> None:
        self.plan = motion if isinstance(motion, ActivePlan) else None
        self.joint_motion = motion if isinstance(motion, JointMotion) else None
        if self._observer is not None:
            self._observer(self.now, motion)

    def stop(self) -> None:
        """Come to rest, on the path if possible. The caller must have discarded all points."""
        state = self.motion
        if self.at_rest or (self.plan is not None and self._just_started(self.plan)):
            self._waypoints.continue_from(state.position)
            self._arrive(state.position)
        elif not self.stopping:
            timing = None if self.plan is None else self._stop_on(self.plan)
            brake = fastest_stop(self._waypoints.limits, state)
            if timing is not None and timing.duration > MAX_STOP_RATIO * brake.duration:
                timing = None
            if self.plan is not None and timing is not None:
                self._execute(dataclasses.replace(self.plan, timing=timing, start=self.now))
                self._waypoints.continue_from(self.plan.path.at(timing.end)[0])
                self.stopping = True
            else:
                self.brake(state)

    def brake(self, state: Motion, elapsed: float = 0.0) -> None:
        """Brake in joint space, as hard as the limits allow.

        state: state at the start of braking, `elapsed` s ago.
        """
        motion = fastest_stop(self._waypoints.limits, state)
        self._execute(motion)
        self._joint_motion_start = self.now - elapsed
        self.paused = False
        self.stopping = True
        self._waypoints.continue_from(motion.end)

    def pause(self) -> None:
        """Stay at rest, or brake on the path. If that is impossible, wait for the next plan."""
        plan = self.plan
        if plan is None or plan.pause or self.stopping:
            return
        if self._just_started(plan):
            self.rest_between(plan, float(plan.timing.positions[0]))
            return
        timing = self._stop_on(plan)
        if timing is not None:
            self._execute(dataclasses.replace(plan, timing=timing, start=self.now, pause=True))

    def _just_started(self, plan: ActivePlan) -> bool:
        if self.now - plan.start >= JUST_STARTED_S:
            return False
        _, first, second = plan.path.at(float(plan.timing.positions[0]))
        v, a = plan.timing.velocities[0], plan.timing.accelerations[0]
        return not ((first * v).any() or (first * a + second * v**2).any())

    def _stop_on(self, plan: ActivePlan) -> TimeParametrisation | None:
        state = plan.timing.at(self.now - plan.start)
        return ruckig_move.stop(Problem(plan.path, state, self._waypoints.limits))
