# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Follows a stream of setpoints smoothly within every limit, each joint independently.

The control law is linear with a triple pole. Position, velocity and acceleration converge to those
of the stream like the output of a critically damped filter. The jerk is constant over a step. The
velocity and acceleration of the stream are fed forward, so a steady motion has no lag.

The limits are respected by another mechanism. Each step starts a complete motion: the constant
jerk of the step, followed by the fastest stop. The jerk of the control law is reduced or shortened
until this stop stays within the joint's range and the bounds of the stream. The exact extrema of
the motion are checked before it is accepted. If the check fails, the previous motion continues
with its stop. Therefore the arm also stops within its limits if the setpoints end.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from epson_driver.motion.interpolation import after
from epson_driver.motion.joint_motion import JointMotion, State, fastest_move, fastest_stop
from epson_driver.motion.limits import Array, JointLimits

RANGE_MARGIN = 1e-9
"""Minimum distance of targets from the ends of a joint's range, rad or m, because of rounding."""

ROUNDING = 1e-10
"""Change of a constant target below which no new motion starts, rad or m."""

MIN_SPEED_SHARE = 1e-4
"""Fraction of a joint's velocity limit below which a commanded velocity counts as zero."""

POLE = 25.0
"""Rate of convergence to the stream, 1/s. The jerk caused by noise grows with its cube."""

VELOCITY_POLE = 40.0
"""Rate of convergence to a commanded velocity, 1/s. It is higher than POLE, because noise of the
positions has no effect."""

BISECTIONS = 12

RETURN_S = 0.3
"""Maximum time to come to rest at the last setpoint, in addition to the time of a plain stop, s.
It is enough to return after an overshoot of the fastest streams."""

LANDING_SHARE = 0.2
"""Fraction of the acceleration and jerk limits for the final motion to a constant setpoint."""

LANDING_S = 0.15
"""Maximum duration of the final motion to a constant setpoint, s."""


def servo_limits(limits: JointLimits, fraction: float, stop_within: float) -> JointLimits:
    """Return the limits for following setpoints: a fraction (0, 1] of the joint limits.

    A velocity is reduced further if a stop from it with the full limits would take more than
    `stop_within` s, because the controller receives setpoints only this long in advance.
    """
    a, j = limits.acceleration, limits.jerk
    ramps = a / j
    stoppable = np.where(
        stop_within <= 2.0 * ramps, j * stop_within**2 / 4.0, a * (stop_within - ramps)
    )
    return replace(
        limits,
        velocity=np.minimum(fraction * limits.velocity, stoppable),
        acceleration=fraction * a,
        jerk=fraction * j,
    )


def stopping_distance(limits: JointLimits, velocity: Array) -> Array:
    """Return the signed distance of the fastest stop from each joint's velocity, shape (n,)."""
    speed = np.abs(velocity)
    a, j = limits.acceleration, limits.jerk
    time = np.where(speed <= a * a / j, 2.0 * np.sqrt(speed / j), speed / a + a / j)
    distance: Array = velocity * time / 2.0
    return distance


_State = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ServoTarget:
    """State of the stream at the end of a step, shapes (n,).

    low, high: position bounds. A joint that can still stop before its bound does not pass it. A
    target outside a joint's range is clipped.
    """

    position: Array
    velocity: Array
    acceleration: Array
    low: Array
    high: Array

    def before(self, time: float) -> 'ServoTarget':
        """Return the target `time` s earlier, extrapolated with constant acceleration."""
        a = self.acceleration
        position = self.position - time * (self.velocity - time * a / 2.0)
        return replace(self, position=position, velocity=self.velocity - time * a)

    @property
    def is_at_rest(self) -> bool:
        return not (np.any(self.velocity) or np.any(self.acceleration))


class SetpointTracker:
    """The motion of n joints that follow setpoints, from rest at `position`, shape (n,), rad or m.

    `follow`, `move` and `brake` set the motion of the next step. If none of them is called again,
    the motion ends at rest. Only `step` advances time. Raises ValueError if `position` is invalid
    or outside the range.
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
        self._final = True
        """Whether the motion is final: a stop, or a motion to a constant setpoint."""

    @property
    def state(self) -> State:
        return self.motion.at(self.time)

    @property
    def remaining(self) -> float:
        """Time until rest without further commands, s."""
        return max(self.motion.duration - self.time, 0.0)

    @property
    def at_rest(self) -> bool:
        return self.time >= self.motion.duration

    def step(self, dt: float) -> State:
        self.time += dt
        return self.state

    def follow(self, dt: float, aim: ServoTarget, speed: float | Array = 1.0) -> None:
        """Set the next step, of `dt` > 0 s, to follow the stream.

        `aim`: state of the stream at the end of this step. `speed`: fraction (0, 1] of the
        velocity limits, one number for all joints, or one per joint, shape (n,).
        """
        target = np.clip(aim.position, self._low, self._high)
        if aim.is_at_rest and self._moves_to_constant(target, aim):
            return
        fastest = self.limits.velocity * speed
        state = position, velocity, acceleration = self.state
        speeds = np.clip(aim.velocity, -fastest, fastest)
        # errors relative to the stream's state at the start of the step
        faster = acceleration - aim.acceleration
        ahead = velocity - (speeds - dt * aim.acceleration)
        beyond = position - (target - dt * (speeds - dt * aim.acceleration / 2.0))
        fraction = -math.expm1(-POLE * dt)
        jerk = -(
            beyond * (fraction / dt) ** 3
            + ahead * fraction**2 * (3.0 - fraction) / dt**2
            + faster * fraction * (18.0 - fraction * (9.0 - 2.0 * fraction)) / (6.0 * dt)
        )
        # a joint that has passed a bound must not move farther
        low, high = np.minimum(aim.low, position), np.maximum(aim.high, position)
        # with a clipped jerk the law would oscillate, so the joint moves with full jerk to the
        # position at which a stop from the stream would end
        rest = target + stopping_distance(self.limits, speeds)
        upper = np.where(rest > self.motion.end, self.limits.jerk, -self.limits.jerk)
        hard = np.abs(jerk) > self.limits.jerk
        jerk = np.where(hard, upper, jerk)
        low = np.where(hard & (upper < 0.0), np.maximum(low, np.minimum(rest, position)), low)
        high = np.where(hard & (upper > 0.0), np.minimum(high, np.maximum(rest, position)), high)
        low, high = np.maximum(low, self._low), np.minimum(high, self._high)
        jerk = np.clip(jerk, _towards(-fastest, state, dt), _towards(fastest, state, dt))
        self._execute(self._stepped(state, dt, jerk, fastest, low, high), final=False)

    def move(self, dt: float, velocities: Array) -> None:
        """Follow commanded velocities, shape (n,), for a step of `dt` > 0 s."""
        fastest = self.limits.velocity
        target = np.clip(velocities, -fastest, fastest)
        if np.all(np.abs(target) < MIN_SPEED_SHARE * fastest):
            self.brake()
            return
        state = self.state
        jerk = _towards(target, state, dt)
        self._execute(self._stepped(state, dt, jerk, fastest, self._low, self._high), final=False)

    def brake(self, target: Array | None = None, speed: float | Array = 1.0) -> None:
        """Come to rest, at `target` if this takes at most RETURN_S longer than a plain stop.

        `target`: shape (n,). `speed`: fraction (0, 1] of the velocity limits for the motion to it.
        """
        if self._final:
            return
        motion = fastest_stop(self.limits, self.state)
        if target is not None:
            target = np.clip(target, self._low, self._high)
            fastest = np.maximum(speed * self.limits.velocity, np.abs(self.state[1]))
            limits = replace(self.limits, velocity=fastest)
            to_target = fastest_move(limits, self.state, target)
            if to_target is not None and to_target.duration <= motion.duration + RETURN_S:
                motion = to_target
        self._execute(motion, final=True)

    def land(self, target: Array, margin: float) -> None:
        """Come to rest at `target`, shape (n,), if a move there respects the limits.

        The move only uses LANDING_SHARE of the limits if it then takes at most LANDING_S and
        overshoots by at most `margin`.
        """
        rest = np.zeros_like(target)
        aim = ServoTarget(target, rest, rest, target - margin, target + margin)
        if not self._moves_to_constant(target, aim):
            motion = fastest_move(self.limits, self.state, target)
            if motion is not None:
                self._execute(motion, final=True)

    def _moves_to_constant(self, target: Array, aim: ServoTarget) -> bool:
        """Start a short final motion to a constant target. Return whether one is executed."""
        if self._final and float(np.abs(target - self.motion.end).max()) < ROUNDING:
            return True
        motion = fastest_move(self._gentle, self.state, target)
        if motion is None or motion.duration > LANDING_S:
            return False
        low, high = motion.extent
        position = self.state[0]
        if np.any(low < np.minimum(aim.low, position)) or np.any(
            high > np.maximum(aim.high, position)
        ):
            return False
        return self._execute(motion, final=True)

    def _stepped(
        self, state: State, dt: float, jerks: Array, fastest: Array, low: Array, high: Array
    ) -> JointMotion:
        """Return a step of `dt` s with the allowed jerks nearest to `jerks`, and then a stop."""
        durations, used = [], []
        rows = (*state, self.limits.acceleration, self.limits.jerk, fastest, low, high, jerks)
        for p, v, a, max_acceleration, max_jerk, speed, lowest, highest, desired in zip(
            *(row.tolist() for row in rows), strict=True
        ):
            joint = _Joint(dt, max_acceleration, max_jerk, speed)
            jerk, time = joint.step((p, v, a), desired, lowest, highest)
            stop = joint.stop(*after(time, p, v, a, jerk)[1:])
            durations.append([time, *(item for item, _ in stop)])
            used.append([jerk, *(item for _, item in stop)])
        return JointMotion(state, np.array(durations), np.array(used))

    def _execute(self, motion: JointMotion, *, final: bool) -> bool:
        """Execute a motion if it respects all limits and ends at rest. Return whether it does."""
        if not motion.within(self.limits):
            return False
        self.motion, self.time, self._final = motion, 0.0, final
        return True


def _towards(target: Array, state: State, dt: float) -> Array:
    """Return jerks with which the velocities converge to `target` in a step, shapes (n,)."""
    _, velocity, acceleration = state
    fraction = -math.expm1(-VELOCITY_POLE * dt)
    jerk: Array = -(
        (velocity - target) * (fraction / dt) ** 2
        + acceleration * fraction * (4.0 - fraction) / (2.0 * dt)
    )
    return jerk


@dataclass(frozen=True, slots=True)
class _Joint:
    """The limits of one joint during a step of `dt` s, and the jerks that they allow."""

    dt: float
    acceleration: float
    jerk: float
    speed: float

    def step(self, state: _State, jerk: float, low: float, high: float) -> tuple[float, float]:
        """Return the allowed jerk nearest to `jerk`, and its duration, s.

        The duration is less than `dt` if the joint must start its stop before the step ends.
        """
        a = state[2]
        minimum = max(-self.jerk, (-self.acceleration - a) / self.dt)
        maximum = min(self.jerk, (self.acceleration - a) / self.dt)
        jerk = min(max(jerk, minimum), maximum)
        if self._respects(self.dt, jerk, state, low, high):
            return jerk, self.dt
        for good in (minimum, maximum):
            if not self._respects(self.dt, good, state, low, high):
                continue
            bad = jerk
            for _ in range(BISECTIONS):
                middle = (good + bad) / 2.0
                if self._respects(self.dt, middle, state, low, high):
                    good = middle
                else:
                    bad = middle
            if self._direction(*after(self.dt, *state, good)[1:]) == self._direction(*state[1:]):
                return good, self.dt
            break  # after a whole step with this jerk, the stop would reverse the joint
        returns = jerk * self._direction(*state[1:]) < 0.0
        if returns and not self._respects(0.0, 0.0, state, low, high):
            return jerk, self.dt  # the joint cannot stop before the bound, and already returns
        short, long = 0.0, self.dt
        for _ in range(BISECTIONS):
            middle = (short + long) / 2.0
            if self._respects(middle, jerk, state, low, high):
                short = middle
            else:
                long = middle
        return jerk, short

    def _respects(self, time: float, jerk: float, state: _State, low: float, high: float) -> bool:
        """Return whether constant jerk for `time` s, followed by a stop, respects all limits."""
        p, v, a = state
        _, v1, a1 = after(time, p, v, a, jerk)
        speeds = [v1, v1 + a1 * abs(a1) / (2.0 * self.jerk)]
        if a * a1 < 0.0:
            speeds.append(v - a * a / (2.0 * jerk))
        if max(speeds) > self.speed or min(speeds) < -self.speed:
            return False
        for span, item in ((time, jerk), *self.stop(v1, a1)):
            if span > 0.0:
                before = p, v, a
                p, v, a = after(span, p, v, a, item)
                if not low <= p <= high:
                    return False
                if before[1] * v < 0.0 and not low <= _turn(*before, item) <= high:
                    return False
        return True

    def _direction(self, velocity: float, acceleration: float) -> float:
        """Return the sign of the velocity that remains when the acceleration is reduced to 0."""
        return math.copysign(1.0, velocity + acceleration * abs(acceleration) / (2.0 * self.jerk))

    def stop(self, velocity: float, acceleration: float) -> tuple[tuple[float, float], ...]:
        """Return the fastest stop as three pairs of a duration, s, and a jerk."""
        jerk = self.jerk
        direction = self._direction(velocity, acceleration)
        v, a = direction * velocity, direction * acceleration
        brake, hold = math.sqrt(max(jerk * v + a * a / 2.0, 0.0)), 0.0
        if brake > self.acceleration:
            brake = self.acceleration
            hold = (v + a * abs(a) / (2.0 * jerk)) / brake - brake / jerk
        rise, full = (max(a + brake, 0.0) / jerk, -direction * jerk), (hold, 0.0)
        return rise, full, (brake / jerk, direction * jerk)


def _turn(p: float, v: float, a: float, j: float) -> float:
    """Return the position at which a joint with constant jerk reverses next."""
    root = math.copysign(math.sqrt(max(a * a - 2.0 * j * v, 0.0)), v)
    # use the form of the root without cancellation
    time = -(a + root) / j if a * v > 0.0 else 2.0 * v / (root - a)
    return after(time, p, v, a, j)[0]
