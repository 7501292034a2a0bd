# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Interpolation of trajectories by linear, cubic or quintic polynomials.

As in ros2_control's joint_trajectory_controller, the segment between two points is linear if they
have only positions, cubic with velocities, and quintic with accelerations.
"""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array

_FROM_ENDS = {
    2: np.array([[1.0, 0.0], [-1.0, 1.0]]),
    4: np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-3, -2, 3, -1], [2, 1, -2, 1]], dtype=float),
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
"""Matrices from values and derivatives at both ends to the coefficients of s⁰, s¹ …, by size."""


_POWERS = np.arange(6)
_FACTORS = np.array(
    [np.ones(6), _POWERS, _POWERS * (_POWERS - 1), _POWERS * (_POWERS - 1) * (_POWERS - 2)]
)

_ORDERS = np.arange(3)[:, None]


ValueAndSlope = tuple[Array, Array]


Value = TypeVar('Value', float, Array)


def after(t: Value, p: Value, v: Value, a: Value, j: Value) -> tuple[Value, Value, Value]:
    """Return position, velocity and acceleration after a time t of constant jerk j."""
    return p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j


def hermite(start: tuple[Array, ...], end: tuple[Array, ...]) -> Array:
    """Return the coefficients of polynomials from values and derivatives at s = 0 and s = 1.

    start, end: the value and up to two derivatives with respect to s, each (…, n). The result has
    the coefficients of s⁰, s¹ …, shape (…, 2 to 6, n).
    """
    # the distance instead of the end value, so that short segments lose no digits
    relative = (np.zeros_like(start[0]), *start[1:], end[0] - start[0], *end[1:])
    coefficients: Array = _FROM_ENDS[len(relative)] @ np.stack(relative, axis=-2)
    coefficients[..., 0, :] = start[0]
    return coefficients


def polynomial(coefficients: Array, s: Array, order: int = 0) -> Array:
    """Return the values of n quintic polynomials, or of a derivative, at s, shape (m, n).

    coefficients: the coefficients of s⁰ … s⁵, shape (6, n). s: shape (m,). order: order of the
    derivative, 0 to 3.
    """
    powers = s[:, None] ** np.maximum(_POWERS - order, 0)
    return np.asarray((_FACTORS[order] * powers) @ coefficients)


def cubic(s: Array, h: Array | float, start: ValueAndSlope, end: ValueAndSlope) -> Array:
    """Return the values of a cubic of length h at fractions s of the length.

    start, end: value and slope of the cubic at its two ends.
    """
    value: Array = (
        (1 + 2 * s) * (1 - s) ** 2 * start[0]
        + s * (1 - s) ** 2 * h * start[1]
        + s**2 * (3 - 2 * s) * end[0]
        + s**2 * (s - 1) * h * end[1]
    )
    return value


class Interpolation:
    """Interpolation of a trajectory's points by time.

    times: shape (k,), s, strictly increasing, k ≥ 2. The other arrays have shape (k, n), or are
    None. Accelerations without velocities are ignored.
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
        """Return positions, velocities and accelerations at times between the first and the last.

        The results have the shape (…, n).
        """
        times = np.asarray(times, dtype=float)
        segment = self.times.searchsorted(times, side='right') - 1
        segment = np.clip(segment, 0, len(self.times) - 2)
        h = (self.times[segment + 1] - self.times[segment])[..., None]
        coefficients = hermite(
            tuple(part[segment] * h**order for order, part in enumerate(self._parts)),
            tuple(part[segment + 1] * h**order for order, part in enumerate(self._parts)),
        )
        # s^k and its time derivatives, shape (…, 3, k)
        s = (times - self.times[segment])[..., None, None] / h[..., None]
        powers = self._factors * s**self._exponents / h[..., None] ** _ORDERS
        position, velocity, acceleration = np.moveaxis(powers @ coefficients, -2, 0)
        return position, velocity, acceleration


def central_differences(times: Array, values: Array) -> Array:
    """Return the time derivatives of values, shape (k, n). They are 0 at both ends."""
    result = np.zeros_like(values)
    result[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, None]
    return result
