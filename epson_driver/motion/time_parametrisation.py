# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Time parametrisations, called timings: the path parameter u(t) over time.

A timing consists of pieces of constant jerk, which is the third derivative of u.
"""

from dataclasses import dataclass

import numpy as np
from ruckig import Trajectory as RuckigTrajectory

from epson_driver.motion.interpolation import after
from epson_driver.motion.limits import Array

State = tuple[float, float, float]
"""Path parameter u, and its velocity u̇ and acceleration ü."""

MIN_PIECE_S = 1e-9
"""Duration below which a piece of a Ruckig trajectory is ignored as rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeParametrisation:
    """A timing of k pieces of constant jerk, which usually ends at rest.

    times: start times of the pieces, and the end time, shape (k + 1,), s. The first one is 0.
    positions, velocities, accelerations: u, u̇ and ü at these times.
    """

    times: Array
    positions: Array
    velocities: Array
    accelerations: Array
    jerks: Array

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    @property
    def end(self) -> float:
        """Path parameter u at the end."""
        return float(self.positions[-1])

    def at(self, time: float) -> State:
        """Return the state at a time, s.

        It is the initial state before the start, and a rest after the end.
        """
        if time >= self.times[-1]:
            return self.end, 0.0, 0.0
        piece = max(int(self.times.searchsorted(time, side='right')) - 1, 0)
        t = max(time - float(self.times[piece]), 0.0)
        u, v = float(self.positions[piece]), float(self.velocities[piece])
        a, j = float(self.accelerations[piece]), float(self.jerks[piece])
        return after(t, u, v, a, j)

    def sample(self, times: Array) -> tuple[Array, Array, Array, Array]:
        """Return u and three derivatives at times within the timing, in the shape of `times`."""
        piece = np.clip(self.times.searchsorted(times, side='right') - 1, 0, len(self.jerks) - 1)
        t = times - self.times[piece]
        u, v = self.positions[piece], self.velocities[piece]
        a, j = self.accelerations[piece], self.jerks[piece]
        return *after(t, u, v, a, j), j

    def part(self, start: float, end: float = np.inf) -> 'TimeParametrisation | None':
        """Return the part of the timing between two times, s, or None if it has no duration.

        The part may end in motion.
        """
        start, end = max(start, 0.0), min(end, self.duration)
        if not start < end:
            return None
        first = int(self.times.searchsorted(start, side='right')) - 1
        last = int(self.times.searchsorted(end, side='left'))
        inner = slice(first + 1, last)
        (u, v, a), (end_u, end_v, end_a) = self.at(start), self.at(end)
        return TimeParametrisation(
            np.concatenate(([0.0], self.times[inner] - start, [end - start])),
            np.concatenate(([u], self.positions[inner], [end_u])),
            np.concatenate(([v], self.velocities[inner], [end_v])),
            np.concatenate(([a], self.accelerations[inner], [end_a])),
            self.jerks[first:last],
        )

    def then(self, next_: 'TimeParametrisation') -> 'TimeParametrisation':
        return TimeParametrisation(
            np.concatenate((self.times, self.duration + next_.times[1:])),
            np.concatenate((self.positions, next_.positions[1:])),
            np.concatenate((self.velocities, next_.velocities[1:])),
            np.concatenate((self.accelerations, next_.accelerations[1:])),
            np.concatenate((self.jerks, next_.jerks)),
        )


def as_commanded(start: float, end: float, rests: bool) -> TimeParametrisation:
    """Return the timing on a path whose parameter is the time, s: u̇ = 1.

    rests: whether the path itself ends at rest.
    """
    zeros = np.zeros(2)
    speeds = np.array([1.0, 0.0 if rests else 1.0])
    return TimeParametrisation(
        np.array([0.0, end - start]), np.array([start, end]), speeds, zeros, zeros[:1]
    )


def from_ruckig(trajectory: RuckigTrajectory) -> TimeParametrisation:
    profile = trajectory.profiles[0][0]
    brake = profile.brake
    pieces = [
        (t, j)
        for t, j in zip([*brake.t, *profile.t], [*brake.j, *profile.j], strict=True)
        if t > MIN_PIECE_S
    ]
    (u,), (v,), (a,) = trajectory.at_time(0.0)
    return from_pieces(
        (u, v, a), np.array([t for t, _ in pieces]), np.array([j for _, j in pieces])
    )


def from_pieces(
    start: State, durations: Array, jerks: Array, end: float | None = None
) -> TimeParametrisation:
    """Return the timing of pieces from a state to rest, at u = `end` if this is known."""
    times = np.append(0.0, np.cumsum(durations))
    a = start[2] + np.append(0.0, np.cumsum(durations * jerks))
    v = start[1] + np.append(0.0, np.cumsum(durations * (a[:-1] + durations * jerks / 2.0)))
    steps = durations * (v[:-1] + durations * (a[:-1] / 2.0 + durations * jerks / 6.0))
    u = start[0] + np.append(0.0, np.cumsum(steps))
    if end is not None:
        u[-1] = end
    v[-1] = a[-1] = 0.0
    return TimeParametrisation(times, u, v, a, jerks)


# matrix from the jerk's first three integrals over three equal times to the three jerks
_THIRDS = np.array([[1.0, -9.0, 27.0], [-3.5, 27.0, -54.0], [5.5, -18.0, 27.0]])


def through_states(times: Array, u: Array, v: Array, a: Array) -> TimeParametrisation:
    """Return the timing through k + 1 states, with three pieces of equal duration between two."""
    t = np.diff(times)
    integrals = np.stack(
        [
            np.diff(a) / t,
            (np.diff(v) - a[:-1] * t) / t**2,
            (np.diff(u) - v[:-1] * t - a[:-1] * t**2 / 2.0) / t**3,
        ]
    )
    jerks, third = _THIRDS @ integrals, t / 3.0
    states = [np.stack([times[:-1], u[:-1], v[:-1], a[:-1]])]
    for jerk in jerks[:2]:
        time, u0, v0, a0 = states[-1]
        states.append(np.stack([time + third, *after(third, u0, v0, a0, jerk)]))
    columns = np.stack(states, axis=2).reshape(4, -1)
    end = np.array([[times[-1]], [u[-1]], [v[-1]], [a[-1]]])
    since, us, vs, accelerations = np.append(columns, end, axis=1)
    return TimeParametrisation(since, us, vs, accelerations, jerks.T.ravel())
