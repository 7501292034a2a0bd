# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Follows setpoints that come one by one, inside every limit, each joint by itself.

What is executed at any moment is a whole motion that ends at rest within the joints' range, and
that was checked by its exact extrema before it counted. A setpoint that comes replaces it by
another such motion, from the state of that moment, or changes nothing if there is none. So there
is nothing to verify later, and nothing to do when no setpoint comes any more.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from ruckig import InputParameter
from ruckig import Trajectory as RuckigTrajectory

from epson_driver.motion.joint_motion import (
    JointMotion,
    State,
    fastest_stop,
    motion_of,
)
from epson_driver.motion.joint_stop import stop_joints
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.point_to_point import solve

RANGE_MARGIN = 1e-9
"""Nothing is aimed nearer than this to the end of a joint's range, rad or m: for rounding."""

ROUNDING = 1e-10
"""Where it rests it does not go so little further, rad or m."""

HORIZON_S = 1.0
"""A velocity is a motion to where it would lead in so much time beyond a stop, at that speed, s.
It is asked for again long before."""

MIN_SPEED_SHARE = 1e-4
"""A smaller share of a joint's velocity limit is standing still."""

FEED_FORWARD = 1.0
"""How much of the way of a stop a setpoint's velocity puts the aim ahead of it. With 1 the joints
pass a setpoint when it holds; with 0 they could rest there."""

NEARLY_THERE_SHARE = 1.25
"""A motion that ends within so many times the duration of a stop is as good as one."""


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
    """Return the braking distance of each joint without acceleration, shape (n,)."""
    speed = np.abs(velocity)
    a, j = limits.acceleration, limits.jerk
    time = np.where(speed <= a * a / j, 2.0 * np.sqrt(speed / j), speed / a + a / j)
    way: Array = velocity * time / 2.0
    return way


class SetpointTracker:
    """The motion of n joints after setpoints, from rest at `position`, shape (n,), rad or m.

    `follow`, `move` and `brake` say where to; time passes with `step` only. Raises ValueError for
    a start that is not n finite numbers within the range.
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
        rest = np.zeros_like(start)
        none = np.zeros((len(start), 1))
        self.motion = JointMotion((start, rest, rest), none, none)
        """What is executed, since `time` s."""
        self.time = 0.0

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

    def follow(
        self,
        positions: Array,
        velocities: Array | None = None,
        speed: float | Array = 1.0,
        lead: float = np.inf,
    ) -> bool:
        """Go to finite positions, shape (n,), which move on with `velocities` if there are any.

        Beyond the range, its end is meant. `speed`: the share (0, 1] of the velocity limits that
        may be used, of all joints or of each, shape (n,). `lead`: how far ahead of the positions
        the velocities may put the aim, s: what they would go in that time. Return whether a motion
        there was found; if not, the one so far goes on.
        """
        ahead = np.zeros_like(self._low)
        fastest = self.limits.velocity * speed
        if velocities is not None:
            wanted = np.clip(velocities, -fastest, fastest)
            ahead = FEED_FORWARD * stopping_way(self.limits, wanted)
            if lead < np.inf:
                most = np.abs(wanted) * lead
                ahead = np.clip(ahead, -most, most)
        aim = np.clip(positions + ahead, self._low, self._high)
        if self.at_rest and float(np.abs(aim - self.motion.end).max()) < ROUNDING:
            return True
        return self._replaced(lambda joint, _stop: (float(aim[joint]), float(fastest[joint])))

    def move(self, velocities: Array) -> bool:
        """Move as `follow` does with finite velocities, shape (n,), up to the end of the range."""
        fastest = self.limits.velocity
        wanted = np.clip(velocities, -fastest, fastest)
        standing = np.abs(wanted) < MIN_SPEED_SHARE * fastest

        def aim(joint: int, stop: float) -> tuple[float, float] | None:
            if standing[joint]:
                return None
            target = stop + float(wanted[joint]) * HORIZON_S
            return (
                min(max(target, float(self._low[joint])), float(self._high[joint])),
                abs(float(wanted[joint])),
            )

        return self._replaced(aim)

    def brake(self) -> bool:
        """Come to rest soon: by a stop, unless the motion ends about as soon by itself.

        Return whether it does; if not, the motion so far goes on.
        """
        stop = fastest_stop(self.limits, self.state)
        if self.remaining <= NEARLY_THERE_SHARE * stop.duration:
            return True
        return self._take(stop)

    def _replaced(self, aim: Callable[[int, float], tuple[float, float] | None]) -> bool:
        """Go where `aim` says for each joint.

        aim(joint, stop): the target and the greatest speed; None: stop. `stop` is where the
        fastest stop ends.
        """
        state = self.state
        stops = stop_joints(self.limits, *state)
        trajectories = list(stops.trajectories)
        try:
            for joint, stop in enumerate(stops.end.tolist()):
                aimed = aim(joint, stop)
                if aimed is not None:
                    trajectories[joint] = self._move(joint, state, *aimed)
        except RuntimeError:  # no trajectory
            return False
        return self._take(motion_of(state, trajectories))

    def _move(self, joint: int, state: State, target: float, speed: float) -> RuckigTrajectory:
        position, velocity, acceleration = (float(each[joint]) for each in state)
        inp = InputParameter(1)
        inp.current_position = [position]
        inp.current_velocity = [velocity]
        inp.current_acceleration = [acceleration]
        inp.target_position = [target]
        inp.max_velocity = [speed]
        inp.max_acceleration = [max(float(self.limits.acceleration[joint]), abs(acceleration))]
        inp.max_jerk = [float(self.limits.jerk[joint])]
        return solve(inp)

    def _take(self, motion: JointMotion) -> bool:
        """Execute a motion from now on if it keeps every limit and ends at rest."""
        if not motion.within(self.limits):
            return False
        self.motion, self.time = motion, 0.0
        return True
