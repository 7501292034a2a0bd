# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Polynomials from values and derivatives at both ends: linear, cubic and quintic segments.

Trajectories are interpolated between two points like in ros2_control's
joint_trajectory_controller: linear with positions only, cubic with velocities, and quintic with
accelerations.
"""

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array

_FROM_ENDS = {
    2: np.array([[1.0, 0.0], [-1.0, 1.0]]),
    4: np.array(
        [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [-3.0, -2.0, 3.0, -1.0],
            [2.0, 1.0, -2.0, 1.0],
        ]
    ),
    6: np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
            [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
            [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
            [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
        ]
    ),
}
"""Matrices from the values at both ends to the coefficients of s⁰, s¹ …, by number of values."""


_POWERS = np.arange(6)
_FACTORS = np.array(
    [np.ones(6), _POWERS, _POWERS * (_POWERS - 1), _POWERS * (_POWERS - 1) * (_POWERS - 2)]
)
"""Factors of a quintic's terms, by the order of the derivative."""

_ORDERS = np.arange(3)[:, None]
"""Orders of the derivatives: position, velocity, acceleration."""


Ends = tuple[Array, Array]
"""A value and its slope at one end of a segment."""


def hermite(begin: tuple[Array, ...], end: tuple[Array, ...]) -> Array:
    """Return the polynomials of s ∈ [0, 1] with given values and derivatives at both ends.

    begin, end: the value, its first and its second derivative by s, or fewer of them, each of
    shape (…, n). The result, shape (…, 2, 4 or 6, n), has the coefficients of s⁰, s¹ ….
    """
    # the distance instead of the end, so that short segments lose no digits
    relative = (np.zeros_like(begin[0]), *begin[1:], end[0] - begin[0], *end[1:])
    coefficients: Array = _FROM_ENDS[len(relative)] @ np.stack(relative, axis=-2)
    coefficients[..., 0, :] = begin[0]
    return coefficients


def polynomial(coefficients: Array, s: Array, order: int = 0) -> Array:
    """Return a polynomial of six coefficients, shape (6, n), or one of its derivatives.

    s: positions, shape (m,). order: order of the derivative, up to 3. The result has shape (m, n).
    """
    powers = s[:, None] ** np.maximum(_POWERS - order, 0)
    return np.asarray((_FACTORS[order] * powers) @ coefficients)


def cubic(s: Array, h: Array | float, begin: Ends, end: Ends) -> Array:
    """Return the cubic with values and slopes at both ends of a segment, at s ∈ [0, 1] of it.

    h: the length of the segment, the unit of the slopes. Shapes are broadcast by numpy.
    """
    value: Array = (
        (1 + 2 * s) * (1 - s) ** 2 * begin[0]
        + s * (1 - s) ** 2 * h * begin[1]
        + s**2 * (3 - 2 * s) * end[0]
        + s**2 * (s - 1) * h * end[1]
    )
    return value


class Interpolation:
    """Points of n joints as a function of time. times: shape (k,), s, strictly increasing, k ≥ 2.

    positions and, if the points have them, velocities and accelerations: shape (k, n).
    Accelerations are used only with velocities.
    """

    def __init__(
        self,
        times: Array,
        positions: Array,
        velocities: Array | None = None,
        accelerations: Array | None = None,
    ) -> None:
        self.times = times
        parts = [positions]
        if velocities is not None:
            parts.append(velocities)
            if accelerations is not None:
                parts.append(accelerations)
        self._parts = parts
        k = np.arange(2 * len(parts))
        self._exponents = np.maximum(k - _ORDERS, 0)
        self._factors = np.vstack([np.ones(len(k)), k, k * (k - 1.0)])

    def at(self, times: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return positions, velocities, accelerations at times within, shape (…) to (…, n)."""
        times = np.asarray(times, dtype=float)
        segment = self.times.searchsorted(times, side='right') - 1
        segment = np.clip(segment, 0, len(self.times) - 2)
        h = (self.times[segment + 1] - self.times[segment])[..., None]
        coefficients = hermite(
            tuple(part[segment] * h**order for order, part in enumerate(self._parts)),
            tuple(part[segment + 1] * h**order for order, part in enumerate(self._parts)),
        )
        # s^k and its derivatives by time, shape (…, 3, k)
        s = (times - self.times[segment])[..., None, None] / h[..., None]
        powers = self._factors * s**self._exponents / h[..., None] ** _ORDERS
        position, velocity, acceleration = np.moveaxis(powers @ coefficients, -2, 0)
        return position, velocity, acceleration


def central_differences(times: Array, values: Array) -> Array:
    """Return derivatives of values, shape (k, n), at times, shape (k,), 0 at both ends."""
    result = np.zeros_like(values)
    result[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, None]
    return result
