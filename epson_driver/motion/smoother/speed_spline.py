# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The square of the speed along a path, x(u) = u̇², as a quadratic B-spline between two ramps.

u is the path parameter. Because ü = x′/2 and u⃛ = x″√x/2, a joint's limit at one u constrains
three coefficients. Near rest, x is proportional to u^(4/3), which is no polynomial. Therefore a
timing starts and ends with a ramp of constant jerk.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array
from epson_driver.motion.time_parametrisation import (
    State,
    TimeParametrisation,
    from_pieces,
    through_states,
)

_GAUSS, _GAUSS_WEIGHTS = (values / 2.0 for values in np.polynomial.legendre.leggauss(5))
_GAUSS = _GAUSS + 0.5


@dataclass(frozen=True, slots=True)
class Ramp:
    """A ramp of constant jerk that starts or ends at rest. Without a ramp, both values are 0."""

    jerk: float
    time: float

    @property
    def length(self) -> float:
        return self.jerk * self.time**3 / 6.0

    @property
    def speed(self) -> float:
        """Speed u̇ at the faster end of the ramp."""
        return self.jerk * self.time**2 / 2.0

    @property
    def acceleration(self) -> float:
        return self.jerk * self.time


@dataclass(frozen=True, slots=True, eq=False)
class SpeedSpline:
    """Square of the speed, x(u), on N intervals between two ramps.

    The spline has N + 2 coefficients. On interval i, x depends on the coefficients i to i + 2.
    """

    start_ramp: Ramp
    end_ramp: Ramp
    nodes: Array
    coefficients: Array

    @property
    def lengths(self) -> Array:
        return np.diff(self.nodes)

    def timing(self, start: State, end: float) -> TimeParametrisation | None:
        """Return a timing with the spline's u, u̇ and ü at the nodes.

        Return None if the sampled spline is not positive everywhere.

        Between two nodes, it has three pieces of constant jerk and equal duration.
        """
        h = self.lengths
        count = len(h)
        interval = np.repeat(np.arange(count), len(_GAUSS))
        inside = basis(h, interval, np.tile(_GAUSS, count))[:, 0]
        x = (inside * self.coefficients[interval[:, None] + np.arange(3)]).sum(axis=1)
        interval, part = np.append(np.arange(count), count - 1), np.append(np.zeros(count), 1.0)
        three = self.coefficients[interval[:, None] + np.arange(3)]
        x_nodes, slopes, _ = (basis(h, interval, part) @ three[:, :, None])[:, :, 0].T
        if min(x.min(), x_nodes.min()) <= 0.0:
            return None
        t = h * ((1.0 / np.sqrt(x)).reshape(count, -1) @ _GAUSS_WEIGHTS)
        times = np.append(0.0, np.cumsum(t))
        between = through_states(times, self.nodes, np.sqrt(x_nodes), slopes / 2.0)
        durations, jerks = np.diff(between.times), between.jerks
        if self.start_ramp.time > 0.0:
            durations = np.append(self.start_ramp.time, durations)
            jerks = np.append(self.start_ramp.jerk, jerks)
        durations = np.append(durations, self.end_ramp.time)
        return from_pieces(start, durations, np.append(jerks, self.end_ramp.jerk), end)


def basis(h: Array, interval: npt.NDArray[np.intp], part: Array) -> Array:
    """Return the matrix from spline coefficients to x, x′ and x″ for each of m samples, (m, 3, 3).

    A matrix applies to the three coefficients of the sample's interval. h: lengths of the N
    intervals. part: position of each sample in its interval, [0, 1].
    """
    before = np.append(0.0, h[:-1])[interval]
    after = np.append(h[1:], 0.0)[interval]
    h = h[interval]
    s = h * part
    falling, rising = 1.0 / (h * (before + h)), 1.0 / (h * (h + after))
    result = np.empty((len(h), 3, 3))
    result[:, 0, 0], result[:, 0, 2] = falling * (h - s) ** 2, rising * s**2
    result[:, 1, 0], result[:, 1, 2] = -2.0 * falling * (h - s), 2.0 * rising * s
    result[:, 2, 0], result[:, 2, 2] = 2.0 * falling, 2.0 * rising
    result[:, :, 1] = -result[:, :, 0] - result[:, :, 2]
    result[:, 0, 1] += 1.0
    return result
