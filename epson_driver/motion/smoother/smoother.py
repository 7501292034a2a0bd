# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoother: points in as they come, one smooth motion out."""

import dataclasses
import logging
from collections import deque
from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import ruckig_move
from epson_driver.motion.smoother.active_plan import ActivePlan, PendingRequest, Point
from epson_driver.motion.smoother.joint_motion import JointMotion, fastest_move, fastest_stop
from epson_driver.motion.smoother.output_guard import Motion, OutputGuard, Violation
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.planner import Plan, Request, plan, stopping_time
from epson_driver.motion.smoother.problem import UNBOUND, Problem
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

MERGE_TOLERANCE = 5e-4
"""Points that are closer together than this (rad, in every joint) count as one."""

DWELL = 0.2
"""A repeated point that takes longer than this (s) commands a rest."""

PATIENCE = 0.03
"""How long to wait at rest for more points before beginning with few, s."""

URGENT = 0.4
"""A plan that rests within this share of the reserve should be replaced by any other."""

FEWEST_POINTS = 3
"""How many points a plan looks ahead at least, if they are known."""

PERIOD = 0.03
"""Time between two plans at least, s."""

TELLABLE = 5e-7
"""A resting arm is not moved by less than this (rad, in every joint): messages carry float32."""

RESERVE = 2.5
"""A plan that rests later than in so many times the time of a stop need not be replaced yet."""

SHORTEST = 1e-9
"""A way shorter than this (rad, in every joint) is no way. A point that is no farther outside the
position limits is on them."""

INSTANT = 1e-6
"""A motion that has begun so recently (s) has not left its rest."""


class Mode(StrEnum):
    """What the durations of the points mean."""

    TIME_PRESERVING = 'time_preserving'
    """As commanded where the limits allow; a point without a duration: as fast as they allow."""

    TIME_OPTIMAL = 'time_optimal'
    """Nothing: as fast as the limits allow."""


Planner = Callable[[Request, JointLimits], Plan | None]
"""Returns a verified plan, or None if none was found."""

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
    counts it, and `planner_error` is the last one.
    Raises ValueError for a start that is not n finite numbers within the limits.
    """

    def __init__(
        self,
        limits: JointLimits,
        position: Array,
        mode: Mode = Mode.TIME_PRESERVING,
        *,
        latency: float = 0.0,
        planner: Planner | None = plan,
    ) -> None:
        self.limits = limits
        self.mode = mode
        self.latency = latency
        self._planner = planner
        self._position = self._checked(position, 'the start')
        self._now = 0.0
        self._scale = 1.0
        self._reserve = RESERVE * stopping_time(limits)
        # The motion: a course, or a joint motion, or rest at a position.
        self._rest_until = 0.0
        self._course: ActivePlan | None = None
        self._joint_motion: JointMotion | None = None
        self._joint_begin = 0.0
        self._stopping = False
        self._paused = False
        # The points: the one the arm rests at, those not passed yet, and the last one known.
        self._rest = self._last = Point(0, self._position, self._position)
        self._ahead: deque[Point] = deque()
        self._count = 0
        self._points_made = 0
        self._arrival = 0.0
        self._departure: float | None = None
        """When the clock of the points would have been 0, s, had the motion kept to it."""
        # Planning: what is asked, what begins at its time, and whether a plan could do better.
        self._asked: PendingRequest | None = None
        self._asked_at = -np.inf
        self._next: ActivePlan | None = None
        self._news = False
        # The second line of defence.
        self.violations = 0
        self.violation: Violation | None = None
        self._guard = OutputGuard(self.motion)
        self.planner_errors = 0
        self.planner_error: Exception | None = None

    # What comes in.

    def append(self, position: Array, duration: float | None = None) -> None:
        """Go on to another point, shape (n,), rad.

        `duration`: for the way from the point before, s; None: as fast as the limits allow. Raises
        ValueError, and takes nothing, for numbers that are wrong or outside the position limits.
        """
        what = f'point {self._count}'
        position = self._checked(position, what)
        _check_duration(duration, what)
        if self.mode is Mode.TIME_OPTIMAL:
            duration = None
        ways = np.abs(position - self._last.anchor)
        joint = int(np.argmax(ways))
        if ways[joint] < MERGE_TOLERANCE / 2.0:
            self._merge(position, duration or 0.0)
        elif duration == 0.0:
            raise ValueError(
                f'{what}: duration = 0 s must be positive: {self.limits.names[joint]} has '
                f'{ways[joint]:.6g} rad to go'
            )
        else:
            self._add(position, duration)
        self._count += 1
        self._arrival = self._now
        self._news = True

    def finish(self) -> None:
        """Rest at the last point: the trajectory ends there. Points that follow begin another."""
        self._count = 0
        if self._last.rest is None:
            self._last.rest = 0.0
            self._news = True

    def stop(self) -> None:
        """Forget all points and come to rest, on the path if that can be verified."""
        course, state = self._course, self.motion
        self._forget()
        if self.at_rest:
            self._settle(state.position)
            self._arrive(state.position)
        elif self._joint_motion is not None:
            if not self._stopping:
                self._begin_joint_motion(fastest_stop(self.limits, state))
                self._stopping = True
        elif course is not None and not self._stopping:
            timing = self._stop_on(course)
            if timing is not None:
                self._course = dataclasses.replace(course, timing=timing, begin=self._now)
                self._settle(course.path.at(timing.end)[0])
            else:
                self._begin_joint_motion(fastest_stop(self.limits, state))
            self._stopping = True

    def replace(self, points: Array, durations: Sequence[float | None] | None = None) -> None:
        """Forget all points and go through others, shape (k, n), from wherever the arm is.

        A moving arm goes to the first of them in joint space, straight out of its motion, and
        rests there for an instant. Raises as `append`.
        """
        each = [None] * len(points) if durations is None else durations
        if len(each) != len(points):
            raise ValueError(f'{len(each)} durations for {len(points)} points')
        checked = []
        for index, (point, duration) in enumerate(zip(points, each, strict=True)):
            checked.append(self._checked(point, f'point {index}'))
            _check_duration(duration, f'point {index}')
        move = None
        if self._in_motion and checked:
            move = fastest_move(self.limits, self.motion, checked[0])
        if move is None:
            self.stop()
        else:
            self._forget()
            self._begin_joint_motion(move)
            self._stopping = False
        for point, duration in zip(checked, each, strict=True):
            self.append(point, duration)

    def keep_to(self, limits: JointLimits) -> None:
        """Keep to other limits from now on; those of position must be the same.

        The points are kept. Raises RuntimeError unless the arm is `at_rest`.
        """
        if not self.at_rest:
            raise RuntimeError('the limits of a motion cannot change: only at rest')
        if self._course is not None:
            self._rest_between(
                self._course, self._course.timing.end
            )  # its path is measured in the speeds so far
        self._asked = self._next = None
        self._news = True
        self.limits = limits
        self._reserve = RESERVE * stopping_time(limits)

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands now, be it with points to go to."""
        return self._paused or not self._in_motion

    @property
    def _in_motion(self) -> bool:
        return self._course is not None or self._joint_motion is not None

    @property
    def _beside_rest(self) -> bool:
        """Whether the arm rests beside the last point, by less than the merge tolerance."""
        if self._in_motion or self._last is not self._rest:
            return False
        return bool(np.max(np.abs(self._rest.position - self._position)) > TELLABLE)

    def _merge(self, position: Array, duration: float) -> None:
        """Take a point that is (nearly) where the last one is: it may command a rest."""
        last = self._last
        last.position = position
        if last is self._rest and not self._in_motion:
            self._rest_until = max(self._rest_until, self._now) + duration
        elif duration >= DWELL or last.rest is not None:
            last.rest = (last.rest or 0.0) + duration
        else:
            last.clock += duration

    def _add(self, position: Array, duration: float | None, tiny: bool = False) -> None:
        if self._last.tiny and self._ahead:
            self._ahead.pop()  # nothing asks for an exact rest there any more
            self._last = self._rest
        last = self._last
        if last.rest is None and last is not self._rest:
            last.position = last.anchor  # not the end any more: the first of those merged counts
        if duration is None:
            time = float(np.max(np.abs(position - last.position) / self.limits.velocity))
        else:
            time = duration
        clock = last.clock + (last.rest or 0.0) + time
        anchor = last.anchor if tiny else position
        timed = duration is not None
        self._last = Point(self._index(), anchor, position, clock, timed, tiny=tiny)
        self._ahead.append(self._last)

    def _index(self) -> int:
        self._points_made += 1
        return self._points_made

    def _forget(self) -> None:
        """Forget all points, and what is planned for them. The motion goes on."""
        self._ahead.clear()
        self._asked = self._next = None
        self._news = False
        self._count = 0

    def _settle(self, position: Array) -> None:
        """Expect to rest at a position, from where the next points go on."""
        self._rest = self._last = Point(self._index(), position, position)

    def _checked(self, position: Array, what: str) -> Array:
        """Return a position as it counts: inside the limits, which nothing is clipped to later."""
        limits = self.limits
        position = np.array(position, dtype=float)
        if np.shape(position) != (len(limits.names),):
            raise ValueError(
                f'{what}: shape {np.shape(position)} instead of one number for each of '
                f'{len(limits.names)} joints'
            )
        for name, value, low, high in zip(
            limits.names, position.tolist(), limits.position_min, limits.position_max, strict=True
        ):
            if not low - SHORTEST <= value <= high + SHORTEST:  # NaN too
                raise ValueError(
                    f'{what}, {name}: position {value:.6g} is outside the limits '
                    f'{low:.6g} … {high:.6g} rad'
                )
        inside: Array = np.clip(position, limits.position_min, limits.position_max)
        return inside

    @property
    def scale(self) -> float:
        """The share 0 … 1 of all speeds. At 0 the arm rests on its path until it is raised."""
        return self._scale

    @scale.setter
    def scale(self, value: float) -> None:
        if not 0.0 <= value <= 1.0:
            raise ValueError(f'scale = {value}: must be 0 … 1')
        if value != self._scale:
            self._scale = float(value)
            self._departure = None
            if value == 0.0:
                self._pause()

    def _pause(self) -> None:
        """Stay at rest, or brake at once; if that cannot be verified, a plan is asked for."""
        self._asked = self._next = None
        self._news = True
        course = self._course
        if course is None or course.scale == 0.0 or self._stopping:
            return
        if _just_begun(course, self._now):
            self._rest_between(course, float(course.timing.positions[0]))
            return
        timing = self._stop_on(course)
        if timing is not None:
            self._course = dataclasses.replace(course, timing=timing, begin=self._now, scale=0.0)

    def _stop_on(self, course: ActivePlan) -> TimeParametrisation | None:
        """Return the fastest verified stop on the path from now on, or None."""
        state = course.timing.at(self._now - course.begin)
        speeds = np.full(len(course.route), UNBOUND)
        return ruckig_move.stop(Problem(course.path, state, self.limits, speeds))

    # What comes out.

    def step(self, dt: float) -> Motion:
        """Let `dt` ≥ 0 s pass, and return the motion then."""
        end = self._now + dt
        self._plan_here()
        while (due := self._due()) <= end:
            self._now = max(self._now, due)
            self._turn()
            self._plan_here()
        self._now = end
        self._pass()
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
        self._begin_joint_motion(fastest_stop(self.limits, self._guard.last))
        self._joint_begin -= dt
        self._stopping = True
        self._guard.last = motion = self.motion
        return motion

    @property
    def motion(self) -> Motion:
        """The motion now."""
        if self._joint_motion is not None:
            return Motion(*self._joint_motion.at(self._now - self._joint_begin))
        if self._course is None:
            zeros = np.zeros_like(self._position)
            return Motion(self._position.copy(), zeros, zeros.copy())
        u, v, a = self._course.timing.at(self._now - self._course.begin)
        q, first, second = self._course.path.at(u)
        return Motion(q, first * v, first * a + second * (v * v))

    @property
    def moving(self) -> bool:
        """Whether the arm moves, has points to go to, or was told to rest for a time."""
        return (
            self._in_motion
            or self._next is not None
            or bool(self._ahead)
            or self._beside_rest
            or self._now < self._rest_until
        )

    @property
    def look_ahead(self) -> float:
        """How much is known ahead, s: commanded time, or time at full speed without one."""
        if self._course is None or self._stopping:
            rested = self._rest.clock + (self._rest.rest or 0.0)
            return max(self._last.clock - rested, 0.0) + max(self._rest_until - self._now, 0.0)
        return self._last.clock - self._course.clock(self._now)

    @property
    def waiting(self) -> int:
        """How many points lie ahead."""
        return len(self._ahead)

    # Planning.

    def request(self) -> Request | None:
        """Return what should be planned now, or None. `take` its plan before the next one."""
        if self._asked is not None or self._next is not None or not self._worth_planning():
            return None
        self._asked = self._ask()
        self._asked_at = self._now
        self._news = False
        return self._asked.request

    def take(self, answer: Plan | None) -> bool:
        """Take the plan for the last request; return whether it is used.

        One that comes too late, or None, changes nothing.
        """
        asked, self._asked = self._asked, None
        if asked is None:
            return False  # forgotten meanwhile
        if answer is None or (answer.start is not None and answer.start < self._now - SHORTEST):
            self._news = True
            if answer is None and self._paused and self._scale > 0.0 and self._course is not None:
                self._rest_between(self._course, self._course.timing.end)
            return False
        begin = self._now if answer.start is None else answer.start
        if answer.start is None and self._planner is not None:
            begin += self.latency
        count = len(answer.knots.u)
        route = asked.route[:count]
        clocks = asked.request.clock[:count]
        self._next = ActivePlan(
            Path(answer.knots), answer.timing, route, clocks, begin, asked.request.scale
        )
        short = count < len(asked.route) or answer.timing.end < answer.knots.u[-1]
        self._news = self._news or asked.more or short
        return True

    def _plan_here(self) -> None:
        if self._planner is not None:
            request = self.request()
            if request is not None:
                self.take(self._planned(self._planner, request))

    def _planned(self, planner: Planner, request: Request) -> Plan | None:
        """Return what the planner found; None too if it fails: the plan so far ends at rest."""
        try:
            return planner(request, self.limits)
        except Exception as error:
            self.planner_errors += 1
            if repr(error) != repr(self.planner_error):  # it may fail so again and again
                log.exception('the planner failed, and the motion goes on as planned before')
            self.planner_error = error
            return None

    def _worth_planning(self) -> bool:
        if self._joint_motion is not None or self._stopping:
            return False
        course = self._course
        if course is None:
            return self._worth_beginning()
        if self._now < self._asked_at + PERIOD:
            return False
        if course.scale != self._scale:
            return True
        left = course.end - self._now
        return (
            self._news
            and self._scale > 0.0
            and not course.finished
            and (self.latency < left < self._reserve + self.latency or self._paused)
        )

    def _worth_beginning(self) -> bool:
        """Whether to leave the rest now."""
        if self._scale == 0.0 or self._now < self._rest_until:
            return False
        patient = self._now >= self._arrival + PATIENCE
        if not self._ahead:
            if not patient or not self._beside_rest:
                return False
            self._add(self._rest.position, None, tiny=True)
        return patient or self._last.rest is not None or self.look_ahead > self._reserve / 2.0

    def _ask(self) -> PendingRequest:
        horizon = 2.0 * self._reserve
        course = self._course
        start: float | None = None
        older: Knots | None = None
        lag = 0.0
        urgent = True
        if course is None:
            zeros = np.zeros((1, len(self._position)))
            kept, route = Knots(np.zeros(1), self._position[None, :], zeros, zeros), [self._rest]
            state = (0.0, 0.0, 0.0)
        else:
            begin = self._now + self.latency
            if not self._paused:
                start = begin
                urgent = course.end - begin < URGENT * self._reserve
            state = course.timing.at(begin - course.begin)
            knots = course.path.knots
            first = course.path.segment(state[0])
            kept, route = knots[first : first + 2], course.route[first : first + 2]
            if len(knots.u) - first > 3:
                older = knots[first:-1]
            if self._departure is not None and route[-1].timed:
                lag = begin - self._departure - course.clock(begin)
            else:
                self._departure = None
        known = len(route)
        more = False
        if route[-1].rest is None or route[-1] is self._rest:
            for point in self._ahead:
                if point.index <= route[-1].index:
                    continue
                enough = len(route) >= known + FEWEST_POINTS
                if enough and point.clock - route[0].clock > horizon:
                    more = True
                    break
                route.append(point)
                if point.rest is not None:
                    break
        points = [point.position for point in route[known:]]
        clocks = np.array([point.clock for point in route])
        clocks[0] += route[0].rest or 0.0  # it has been rested there
        request = Request(
            start,
            state,
            kept,
            older,
            np.array(points).reshape(len(points), len(self._position)),
            clocks,
            np.array([point.timed for point in route]),
            lag,
            self._scale,
            horizon,
            urgent,
        )
        return PendingRequest(request, route, more)

    # The course of events.

    def _due(self) -> float:
        """Return when the next thing happens, s."""
        due = np.inf if self._next is None else self._next.begin
        if self._joint_motion is not None:
            return min(due, self._joint_begin + self._joint_motion.duration)
        if self._course is not None and not self._paused:
            return min(due, self._course.end)
        return due

    def _turn(self) -> None:
        """Let it happen."""
        course = self._course
        if self._next is not None and self._next.begin <= self._now:
            if course is None or self._departure is None:
                self._departure = self._next.begin - self._next.clock(self._next.begin)
            if self._scale != 1.0:
                self._departure = None
            self._course, self._next = self._next, None
            self._paused = False
        elif self._joint_motion is not None:
            self._arrive(self._joint_motion.end)
        elif course is not None and course.timing.end < course.path.end:
            if self._stopping:
                self._arrive(course.path.at(course.timing.end)[0])
            elif course.scale == 0.0:
                self._paused = True
                self._departure = None
            else:
                self._rest_between(course, course.timing.end)
        elif course is not None:
            self._arrive(
                course.path.knots.position[-1], None if self._stopping else course.route[-1]
            )

    def _arrive(self, position: Array, point: Point | None = None) -> None:
        """Come to rest at a position; at a point of the path, or where `_settle` said."""
        self._position = position
        if point is not None:
            self._rest = point
        while self._ahead and self._ahead[0].index <= self._rest.index:
            self._ahead.popleft()
        self._rest_until = self._now + (self._rest.rest or 0.0)
        self._course = self._joint_motion = None
        self._stopping = self._paused = False
        self._departure = None

    def _rest_between(self, course: ActivePlan, u: float) -> None:
        """Rest between two points of a path, free to go on to the next one by another."""
        position = course.path.at(u)[0]
        segment = course.path.segment(u)
        left = course.path.knots.position[segment + 1] - position
        if np.max(np.abs(left)) <= TELLABLE:
            segment += 1  # what is left is rounding, and no way
        if segment == len(course.route) - 1:
            self._arrive(position, course.route[segment])
            return
        index = course.route[segment].index
        self._rest = Point(index, position, position, course.clock(self._now))
        self._arrive(position)

    def _pass(self) -> None:
        """Take the points that were passed off the list."""
        course = self._course
        if course is None:
            return
        u, _, _ = course.timing.at(self._now - course.begin)
        passed = course.route[-1]
        if u < course.path.end:
            passed = course.route[course.path.segment(u)]
        while self._ahead and self._ahead[0].index <= passed.index:
            self._ahead.popleft()

    def _begin_joint_motion(self, motion: JointMotion) -> None:
        self._course = None
        self._paused = False
        self._joint_motion, self._joint_begin = motion, self._now
        self._settle(motion.end)


def _just_begun(course: ActivePlan, now: float) -> bool:
    """Return whether a course has only begun now, out of a rest."""
    at_rest = course.timing.velocities[0] == 0.0 == course.timing.accelerations[0]
    return bool(at_rest) and now - course.begin < INSTANT


def _check_duration(duration: float | None, what: str) -> None:
    if duration is not None and not 0.0 <= duration < np.inf:  # NaN too
        raise ValueError(f'{what}: duration = {duration} s must be a positive number')
