# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Follows a stream quietly, inside every limit, each joint by itself.

The law is a linear one with its three poles in one place: the jerk, constant over a step, that
lets position, velocity and acceleration come to those of the stream as a critically damped filter
would. Velocity and acceleration of the stream are fed forward, so a steady motion needs no jerk
and costs no lag.

Limits do not rest on the law. What is executed at any moment is a whole motion: a step of
constant jerk, and the fastest stop after it. The jerk is so near to the law's, or lasts so long,
that this stop keeps within the range, and does not pass what the stream has shown. The motion is
checked by its exact extrema before it counts; if it fails, the one before goes on, which is a
stop by then. So there is nothing to verify later, and nothing to do when no setpoint comes any
more.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from epson_driver.motion.joint_motion import JointMotion, State, fastest_move, fastest_stop
from epson_driver.motion.limits import Array, JointLimits

RANGE_MARGIN = 1e-9
"""Nothing is aimed nearer than this to the end of a joint's range, rad or m: for rounding."""

ROUNDING = 1e-10
"""Where it rests it does not go so little further, rad or m."""

MIN_SPEED_SHARE = 1e-4
"""A smaller share of a joint's velocity limit is standing still."""

POLE = 25.0
"""Of the law, 1/s: how fast it comes back to the stream. Noise costs jerk with its third power."""

VELOCITY_POLE = 40.0
"""The same where a velocity is followed: there is no position to be noisy."""

BISECTIONS = 12
"""Halvings, where a limit holds the law back."""

RETURN_S = 0.3
"""Maximum extra time over a stop for an end at the last setpoint, s: the return from where the
lead over the setpoints takes the arm, up to the fastest streams."""

LANDING_SHARE = 0.2
"""Of the jerk: the last bit to a standing setpoint is a motion that ends there, so gentle."""

LANDING_S = 0.15
"""And not longer than this, s."""


def servo_limits(limits: JointLimits, share: float, stop_within: float) -> JointLimits:
    """Return the limits for setpoints: a share (0, 1] of velocity, acceleration and jerk.

    Joints are never so fast that a stop with the whole limits would take more than `stop_within`
    s: whoever executes the setpoints knows only so much ahead.
    """
    a, j = limits.acceleration, limits.jerk
    ramps = a / j
    stoppable = np.where(
        stop_within <= 2.0 * ramps, j * stop_within**2 / 4.0, a * (stop_within - ramps)
    )
    return replace(
        limits,
        velocity=np.minimum(share * limits.velocity, stoppable),
        acceleration=share * a,
        jerk=share * j,
    )


def stopping_way(limits: JointLimits, velocity: Array) -> Array:
    """Return the way of a stop from velocities, with their sign, shape (n,)."""
    speed = np.abs(velocity)
    a, j = limits.acceleration, limits.jerk
    time = np.where(speed <= a * a / j, 2.0 * np.sqrt(speed / j), speed / a + a / j)
    way: Array = velocity * time / 2.0
    return way


_State = tuple[float, float, float]
"""Position, velocity and acceleration of one joint."""


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Where a stream has the joints be at the end of a step, shapes (n,).

    position, velocity, acceleration: there. low, high: what the joints do not pass, where they can
    still stop before it. Beyond the range, its end is meant.
    """

    position: Array
    velocity: Array
    acceleration: Array
    low: Array
    high: Array

    def before(self, time: float) -> 'Aim':
        """Return where the stream has them be so long before, s."""
        a = self.acceleration
        position = self.position - time * (self.velocity - time * a / 2.0)
        return replace(self, position=position, velocity=self.velocity - time * a)

    @property
    def stands(self) -> bool:
        """Whether it asks to rest at the position."""
        return not (np.any(self.velocity) or np.any(self.acceleration))


class SetpointTracker:
    """The motion of n joints after setpoints, from rest at `position`, shape (n,), rad or m.

    `follow`, `move` and `brake` say where to in the next step; time passes with `step` only.
    Without a word it comes to rest. Raises ValueError for a start that is not n finite numbers
    within the range.
    """

    def __init__(self, limits: JointLimits, position: Array) -> None:
        self.limits = limits
        self._low = limits.position_min + RANGE_MARGIN
        self._high = limits.position_max - RANGE_MARGIN
        start = np.array(position, dtype=float)
        inside = start.shape == self._low.shape and bool(
            np.all((start >= limits.position_min) & (start <= limits.position_max))
        )
        if not inside:
            raise ValueError(f'start = {position}: must be within the range of each joint')
        self._gentle = replace(
            limits,
            acceleration=LANDING_SHARE * limits.acceleration,
            jerk=LANDING_SHARE * limits.jerk,
        )
        rest = np.zeros_like(start)
        none = np.zeros((len(start), 1))
        self.motion = JointMotion((start, rest, rest), none, none)
        """What is executed, since `time` s."""
        self.time = 0.0
        self._ending = True
        """Whether the motion is one to rest for good: a stop, or to a standing setpoint."""

    @property
    def state(self) -> State:
        """Position, velocity and acceleration now, shapes (n,)."""
        return self.motion.at(self.time)

    @property
    def remaining(self) -> float:
        """In how many s it rests if nothing else is asked for."""
        return max(self.motion.duration - self.time, 0.0)

    @property
    def at_rest(self) -> bool:
        """Whether it rests."""
        return self.time >= self.motion.duration

    def step(self, dt: float) -> State:
        """Let `dt` ≥ 0 s pass and return the state then."""
        self.time += dt
        return self.state

    def follow(self, dt: float, aim: Aim, speed: float | Array = 1.0) -> None:
        """Go towards a finite aim in the next `dt` > 0 s.

        `speed`: the share (0, 1] of the velocity limits that may be used, of all joints or of
        each, shape (n,).
        """
        target = np.clip(aim.position, self._low, self._high)
        if aim.stands and self._lands(target, aim):
            return
        fastest = self.limits.velocity * speed
        state = position, velocity, acceleration = self.state
        wanted = np.clip(aim.velocity, -fastest, fastest)
        # how far it is from the stream, as that was when the step begins
        faster = acceleration - aim.acceleration
        ahead = velocity - (wanted - dt * aim.acceleration)
        beyond = position - (target - dt * (wanted - dt * aim.acceleration / 2.0))
        share = -math.expm1(-POLE * dt)
        jerk = -(
            beyond * (share / dt) ** 3
            + ahead * share**2 * (3.0 - share) / dt**2
            + faster * share * (18.0 - share * (9.0 - 2.0 * share)) / (6.0 * dt)
        )
        # a joint that is beyond what it should not pass only goes no farther
        low, high = np.minimum(aim.low, position), np.maximum(aim.high, position)
        # one that needs more jerk than it may have would swing: it goes as fast as it can to where
        # a stop from the stream would end
        rest = target + stopping_way(self.limits, wanted)
        most = np.where(rest > self.motion.end, self.limits.jerk, -self.limits.jerk)
        hard = np.abs(jerk) > self.limits.jerk
        jerk = np.where(hard, most, jerk)
        low = np.where(hard & (most < 0.0), np.maximum(low, np.minimum(rest, position)), low)
        high = np.where(hard & (most > 0.0), np.minimum(high, np.maximum(rest, position)), high)
        low, high = np.maximum(low, self._low), np.minimum(high, self._high)
        jerk = np.clip(jerk, _towards(-fastest, state, dt), _towards(fastest, state, dt))
        self._take(self._stepped(state, dt, jerk, fastest, low, high), ending=False)

    def move(self, dt: float, velocities: Array) -> None:
        """Move with finite velocities, shape (n,), up to the end of the range, for `dt` > 0 s."""
        fastest = self.limits.velocity
        wanted = np.clip(velocities, -fastest, fastest)
        if np.all(np.abs(wanted) < MIN_SPEED_SHARE * fastest):
            self.brake()
            return
        state = self.state
        jerk = _towards(wanted, state, dt)
        self._take(self._stepped(state, dt, jerk, fastest, self._low, self._high), ending=False)

    def brake(self, target: Array | None = None, speed: float = 1.0) -> None:
        """Come to rest: at a target, shape (n,), unless a stop is faster by more than RETURN_S.

        `speed`: share (0, 1] of the velocity limits for the motion to the target.
        """
        if self._ending:
            return
        motion = fastest_stop(self.limits, self.state)
        if target is not None:
            target = np.clip(target, self._low, self._high)
            fastest = np.maximum(speed * self.limits.velocity, np.abs(self.state[1]))
            limits = replace(self.limits, velocity=fastest)
            there = fastest_move(limits, self.state, target)
            if there is not None and there.duration <= motion.duration + RETURN_S:
                motion = there
        self._take(motion, ending=True)

    def _lands(self, target: Array, aim: Aim) -> bool:
        """Return whether it rests at a target, or is on its last bit to it."""
        if self._ending and float(np.abs(target - self.motion.end).max()) < ROUNDING:
            return True
        motion = fastest_move(self._gentle, self.state, target)
        if motion is None or motion.duration > LANDING_S:
            return False
        low, high = motion.extent
        here = self.state[0]
        if np.any((low < aim.low) & (low < here)) or np.any((high > aim.high) & (high > here)):
            return False
        return self._take(motion, ending=True)

    def _stepped(
        self, state: State, dt: float, jerks: Array, fastest: Array, low: Array, high: Array
    ) -> JointMotion:
        """Return a step with jerks as near to these as may be, shape (n,), and the stop after."""
        durations, used = [], []
        rows = (*state, self.limits.acceleration, self.limits.jerk, fastest, low, high, jerks)
        for p, v, a, most_a, most_j, speed, lowest, highest, wanted in zip(
            *(row.tolist() for row in rows), strict=True
        ):
            joint = _Joint(dt, most_a, most_j, speed)
            jerk, time = joint.step((p, v, a), wanted, lowest, highest)
            stop = joint.stop(v + time * (a + time * jerk / 2.0), a + time * jerk)
            durations.append([time, *(each for each, _ in stop)])
            used.append([jerk, *(each for _, each in stop)])
        return JointMotion(state, np.array(durations), np.array(used))

    def _take(self, motion: JointMotion, *, ending: bool) -> bool:
        """Execute a motion from now on if it keeps every limit and ends at rest."""
        if not motion.within(self.limits):
            return False
        self.motion, self.time, self._ending = motion, 0.0, ending
        return True


def _towards(wanted: Array, state: State, dt: float) -> Array:
    """Return the jerks of a step that let the velocities come to others, shape (n,)."""
    _, velocity, acceleration = state
    share = -math.expm1(-VELOCITY_POLE * dt)
    jerk: Array = -(
        (velocity - wanted) * (share / dt) ** 2 + acceleration * share * (4.0 - share) / (2.0 * dt)
    )
    return jerk


@dataclass(frozen=True, slots=True)
class _Joint:
    """One joint in a step of `dt` s with constant jerk: how long it may last before a stop.

    acceleration, jerk, speed: how much it may have of each.
    """

    dt: float
    acceleration: float
    jerk: float
    speed: float

    def step(self, state: _State, jerk: float, low: float, high: float) -> tuple[float, float]:
        """Return the jerk nearest to one that it may have, and how long, s.

        For a whole step, or else as long as there is time for a stop.
        """
        a = state[2]
        least = max(-self.jerk, (-self.acceleration - a) / self.dt)
        most = min(self.jerk, (self.acceleration - a) / self.dt)
        jerk = min(max(jerk, least), most)
        if self._keeps(self.dt, jerk, state, low, high):
            return jerk, self.dt
        for good in (least, most):
            if not self._keeps(self.dt, good, state, low, high):
                continue
            bad = jerk
            for _ in range(BISECTIONS):
                middle = (good + bad) / 2.0
                if self._keeps(self.dt, middle, state, low, high):
                    good = middle
                else:
                    bad = middle
            if self._side(*_after(*state, self.dt, good)[1:]) == self._side(*state[1:]):
                return good, self.dt
            break  # so long a step would have to turn back
        if not self._keeps(0.0, 0.0, state, low, high) and jerk * self._side(*state[1:]) < 0.0:
            return jerk, self.dt  # it goes too far anyway, and is on its way back
        short, long = 0.0, self.dt
        for _ in range(BISECTIONS):
            middle = (short + long) / 2.0
            if self._keeps(middle, jerk, state, low, high):
                short = middle
            else:
                long = middle
        return jerk, short

    def _keeps(self, time: float, jerk: float, state: _State, low: float, high: float) -> bool:
        """Return whether speed and place are allowed with such a jerk, and a stop after it."""
        p, v, a = state
        _, v1, a1 = _after(p, v, a, time, jerk)
        speeds = [v1, v1 + a1 * abs(a1) / (2.0 * self.jerk)]
        if a * a1 < 0.0:
            speeds.append(v - a * a / (2.0 * jerk))
        if max(speeds) > self.speed or min(speeds) < -self.speed:
            return False
        for span, each in ((time, jerk), *self.stop(v1, a1)):
            if span > 0.0:
                before = p, v, a
                p, v, a = _after(p, v, a, span, each)
                if not low <= p <= high:
                    return False
                if before[1] * v < 0.0 and not low <= _turn(*before, each) <= high:
                    return False
        return True

    def _side(self, velocity: float, acceleration: float) -> float:
        """Return to which side a stop goes, 1 or -1."""
        return math.copysign(1.0, velocity + acceleration * abs(acceleration) / (2.0 * self.jerk))

    def stop(self, velocity: float, acceleration: float) -> tuple[tuple[float, float], ...]:
        """Return the fastest stop: three times, s, each with its jerk."""
        most = self.jerk
        side = self._side(velocity, acceleration)
        v, a = side * velocity, side * acceleration
        brake, hold = math.sqrt(max(most * v + a * a / 2.0, 0.0)), 0.0
        if brake > self.acceleration:
            brake = self.acceleration
            hold = (v + a * abs(a) / (2.0 * most)) / brake - brake / most
        return (max(a + brake, 0.0) / most, -side * most), (hold, 0.0), (brake / most, side * most)


def _after(p: float, v: float, a: float, t: float, j: float) -> tuple[float, float, float]:
    """Return the state a time after another, with constant jerk."""
    return p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j


def _turn(p: float, v: float, a: float, j: float) -> float:
    """Return where a joint turns that does so at its next standstill."""
    root = math.copysign(math.sqrt(max(a * a - 2.0 * j * v, 0.0)), v)
    # of the two forms of the root that which takes no difference
    time = -(a + root) / j if a * v > 0.0 else 2.0 * v / (root - a)
    return _after(p, v, a, time, j)[0]
