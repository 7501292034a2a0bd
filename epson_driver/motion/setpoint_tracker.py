# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Follows a stream smoothly within every limit, each joint independently.

The control law is linear with a triple pole: position, velocity and acceleration converge to the
stream like the output of a critically damped filter, by a jerk that is constant over a step. The
velocity and acceleration of the stream are fed forward, so a steady motion needs no jerk and has
no lag.

The limits do not depend on the law. The executed motion is always a complete motion: a step of
constant jerk, followed by the fastest stop. Its jerk is as close to the law's jerk, and lasts as
long, as this stop permits: the stop must stay within the range and must not pass the positions
that the stream has shown. The exact extrema of the motion are checked before it is accepted. If
the check fails, the previous motion continues, which is a stop from then on. So no later check is
needed, and the arm stops safely without any action if the setpoints end.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from epson_driver.motion.joint_motion import JointMotion, State, fastest_move, fastest_stop
from epson_driver.motion.limits import Array, JointLimits

RANGE_MARGIN = 1e-9
"""Minimum distance of a target from the end of a joint's range, rad or m, against rounding."""

ROUNDING = 1e-10
"""A joint at rest ignores a target closer than this, rad or m."""

MIN_SPEED_SHARE = 1e-4
"""A velocity below this share of a joint's velocity limit counts as zero."""

POLE = 25.0
"""Pole of the law, 1/s: the rate of convergence to the stream. Noise costs jerk with its cube."""

VELOCITY_POLE = 40.0
"""Pole for following a velocity. It may be faster, as no position noise is fed back."""

BISECTIONS = 12
"""Bisection steps when a limit restricts the law."""

RETURN_S = 0.3
"""Maximum extra time over a stop for an end at the last setpoint, s: the return from where the
lead over the setpoints takes the arm, up to the fastest streams."""

LANDING_SHARE = 0.2
"""Share of the acceleration and jerk limits for the final motion to a constant setpoint. It is
gentle, since it ends there."""

LANDING_S = 0.15
"""Maximum duration of this final motion, s."""


def servo_limits(limits: JointLimits, share: float, stop_within: float) -> JointLimits:
    """Return the limits for setpoints: a share (0, 1] of velocity, acceleration and jerk.

    The velocity is also bounded so that a stop with the full limits takes at most `stop_within` s,
    because the controller that executes the setpoints knows them only this far ahead.
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
    """Return the signed stopping distance from velocities, shape (n,)."""
    speed = np.abs(velocity)
    a, j = limits.acceleration, limits.jerk
    time = np.where(speed <= a * a / j, 2.0 * np.sqrt(speed / j), speed / a + a / j)
    way: Array = velocity * time / 2.0
    return way


_State = tuple[float, float, float]
"""Position, velocity and acceleration of one joint."""


@dataclass(frozen=True, slots=True, eq=False)
class ServoTarget:
    """Target state of the joints at the end of a step, shapes (n,).

    low, high: bounds that the joints must not pass, if they can still stop before them. A target
    beyond the range is clipped to its end.
    """

    position: Array
    velocity: Array
    acceleration: Array
    low: Array
    high: Array

    def before(self, time: float) -> 'ServoTarget':
        """Return the stream's target `time` s earlier."""
        a = self.acceleration
        position = self.position - time * (self.velocity - time * a / 2.0)
        return replace(self, position=position, velocity=self.velocity - time * a)

    @property
    def is_at_rest(self) -> bool:
        """Whether the target is at rest."""
        return not (np.any(self.velocity) or np.any(self.acceleration))


class SetpointTracker:
    """The motion of n joints after setpoints, from rest at `position`, shape (n,), rad or m.

    `follow`, `move` and `brake` set the motion of the next step. Only `step` advances time. The
    arm comes to rest without a further call. Raises ValueError if the start is not n finite
    numbers within the range.
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
        """The executed motion, which started `time` s ago."""
        self.time = 0.0
        self._ending = True
        """Whether the motion is final: a stop, or a motion to a constant setpoint."""

    @property
    def state(self) -> State:
        """Position, velocity and acceleration now, shapes (n,)."""
        return self.motion.at(self.time)

    @property
    def remaining(self) -> float:
        """Time until rest without further commands, s."""
        return max(self.motion.duration - self.time, 0.0)

    @property
    def at_rest(self) -> bool:
        """Whether the executed motion has ended."""
        return self.time >= self.motion.duration

    def step(self, dt: float) -> State:
        """Advance time by `dt` ≥ 0 s and return the new state."""
        self.time += dt
        return self.state

    def follow(self, dt: float, aim: ServoTarget, speed: float | Array = 1.0) -> None:
        """Move towards a finite aim in the next `dt` > 0 s.

        `speed`: share (0, 1] of the velocity limits, for all joints or per joint, shape (n,).
        """
        target = np.clip(aim.position, self._low, self._high)
        if aim.is_at_rest and self._lands(target, aim):
            return
        fastest = self.limits.velocity * speed
        state = position, velocity, acceleration = self.state
        wanted = np.clip(aim.velocity, -fastest, fastest)
        # errors relative to the stream's state at the start of the step
        faster = acceleration - aim.acceleration
        ahead = velocity - (wanted - dt * aim.acceleration)
        beyond = position - (target - dt * (wanted - dt * aim.acceleration / 2.0))
        fraction = -math.expm1(-POLE * dt)
        jerk = -(
            beyond * (fraction / dt) ** 3
            + ahead * fraction**2 * (3.0 - fraction) / dt**2
            + faster * fraction * (18.0 - fraction * (9.0 - 2.0 * fraction)) / (6.0 * dt)
        )
        # a joint that is already past a bound must only not move farther
        low, high = np.minimum(aim.low, position), np.maximum(aim.high, position)
        # a joint beyond its jerk limit would oscillate, so it moves with full jerk to the position
        # at which a stop from the stream would end
        rest = target + stopping_way(self.limits, wanted)
        upper = np.where(rest > self.motion.end, self.limits.jerk, -self.limits.jerk)
        hard = np.abs(jerk) > self.limits.jerk
        jerk = np.where(hard, upper, jerk)
        low = np.where(hard & (upper < 0.0), np.maximum(low, np.minimum(rest, position)), low)
        high = np.where(hard & (upper > 0.0), np.minimum(high, np.maximum(rest, position)), high)
        low, high = np.maximum(low, self._low), np.minimum(high, self._high)
        jerk = np.clip(jerk, _towards(-fastest, state, dt), _towards(fastest, state, dt))
        self._take(self._stepped(state, dt, jerk, fastest, low, high), ending=False)

    def move(self, dt: float, velocities: Array) -> None:
        """Move with finite velocities, shape (n,), within the range, for `dt` > 0 s."""
        fastest = self.limits.velocity
        wanted = np.clip(velocities, -fastest, fastest)
        if np.all(np.abs(wanted) < MIN_SPEED_SHARE * fastest):
            self.brake()
            return
        state = self.state
        jerk = _towards(wanted, state, dt)
        self._take(self._stepped(state, dt, jerk, fastest, self._low, self._high), ending=False)

    def brake(self, target: Array | None = None, speed: float = 1.0) -> None:
        """Come to rest: at a target, shape (n,), unless a plain stop is faster by over RETURN_S.

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

    def _lands(self, target: Array, aim: ServoTarget) -> bool:
        """Return whether it rests at a target, or has started the final motion to it."""
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
        """Return a step with jerks as close as possible to `jerks`, shape (n,), and the stop."""
        durations, used = [], []
        rows = (*state, self.limits.acceleration, self.limits.jerk, fastest, low, high, jerks)
        for p, v, a, most_a, most_j, speed, lowest, highest, wanted in zip(
            *(row.tolist() for row in rows), strict=True
        ):
            joint = _Joint(dt, most_a, most_j, speed)
            jerk, time = joint.step((p, v, a), wanted, lowest, highest)
            stop = joint.stop(v + time * (a + time * jerk / 2.0), a + time * jerk)
            durations.append([time, *(item for item, _ in stop)])
            used.append([jerk, *(item for _, item in stop)])
        return JointMotion(state, np.array(durations), np.array(used))

    def _take(self, motion: JointMotion, *, ending: bool) -> bool:
        """Execute a motion from now on if it respects every limit and ends at rest."""
        if not motion.within(self.limits):
            return False
        self.motion, self.time, self._ending = motion, 0.0, ending
        return True


def _towards(wanted: Array, state: State, dt: float) -> Array:
    """Return the jerks of a step that makes the velocities converge to `wanted`, shape (n,)."""
    _, velocity, acceleration = state
    fraction = -math.expm1(-VELOCITY_POLE * dt)
    jerk: Array = -(
        (velocity - wanted) * (fraction / dt) ** 2
        + acceleration * fraction * (4.0 - fraction) / (2.0 * dt)
    )
    return jerk


@dataclass(frozen=True, slots=True)
class _Joint:
    """One joint in a step of `dt` s with constant jerk: how long it may last before a stop.

    acceleration, jerk, speed: its limits.
    """

    dt: float
    acceleration: float
    jerk: float
    speed: float

    def step(self, state: _State, jerk: float, low: float, high: float) -> tuple[float, float]:
        """Return the allowed jerk nearest to `jerk` and its duration, s.

        The duration is the whole step, or shorter if the joint must start to stop earlier.
        """
        a = state[2]
        minimum = max(-self.jerk, (-self.acceleration - a) / self.dt)
        maximum = min(self.jerk, (self.acceleration - a) / self.dt)
        jerk = min(max(jerk, minimum), maximum)
        if self._keeps(self.dt, jerk, state, low, high):
            return jerk, self.dt
        for good in (minimum, maximum):
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
            break  # with this jerk for a whole step the joint would have to turn back
        if not self._keeps(0.0, 0.0, state, low, high) and jerk * self._side(*state[1:]) < 0.0:
            return jerk, self.dt  # it passes the bound in any case and already returns
        short, long = 0.0, self.dt
        for _ in range(BISECTIONS):
            middle = (short + long) / 2.0
            if self._keeps(middle, jerk, state, low, high):
                short = middle
            else:
                long = middle
        return jerk, short

    def _keeps(self, time: float, jerk: float, state: _State, low: float, high: float) -> bool:
        """Return whether this jerk and the stop after it respect the speed and position limits."""
        p, v, a = state
        _, v1, a1 = _after(p, v, a, time, jerk)
        speeds = [v1, v1 + a1 * abs(a1) / (2.0 * self.jerk)]
        if a * a1 < 0.0:
            speeds.append(v - a * a / (2.0 * jerk))
        if max(speeds) > self.speed or min(speeds) < -self.speed:
            return False
        for span, item in ((time, jerk), *self.stop(v1, a1)):
            if span > 0.0:
                before = p, v, a
                p, v, a = _after(p, v, a, span, item)
                if not low <= p <= high:
                    return False
                if before[1] * v < 0.0 and not low <= _turn(*before, item) <= high:
                    return False
        return True

    def _side(self, velocity: float, acceleration: float) -> float:
        """Return the direction of a stop, 1 or -1."""
        return math.copysign(1.0, velocity + acceleration * abs(acceleration) / (2.0 * self.jerk))

    def stop(self, velocity: float, acceleration: float) -> tuple[tuple[float, float], ...]:
        """Return the fastest stop: three (duration in s, jerk) pairs."""
        jerk = self.jerk
        side = self._side(velocity, acceleration)
        v, a = side * velocity, side * acceleration
        brake, hold = math.sqrt(max(jerk * v + a * a / 2.0, 0.0)), 0.0
        if brake > self.acceleration:
            brake = self.acceleration
            hold = (v + a * abs(a) / (2.0 * jerk)) / brake - brake / jerk
        return (max(a + brake, 0.0) / jerk, -side * jerk), (hold, 0.0), (brake / jerk, side * jerk)


def _after(p: float, v: float, a: float, t: float, j: float) -> tuple[float, float, float]:
    """Return the state after time `t` with constant jerk."""
    return p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j


def _turn(p: float, v: float, a: float, j: float) -> float:
    """Return the position at the next standstill of a joint that reverses there."""
    root = math.copysign(math.sqrt(max(a * a - 2.0 * j * v, 0.0)), v)
    # use the form of the root without cancellation
    time = -(a + root) / j if a * v > 0.0 else 2.0 * v / (root - a)
    return _after(p, v, a, time, j)[0]
