# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Interpolation reproduces the polynomial from which its points were sampled."""

import numpy as np
import pytest

from epson_driver.motion.interpolation import (
    Interpolation,
    central_differences,
    cubic,
    hermite,
)

TIMES = np.array([0.0, 0.3, 0.35, 1.0])


def sampled(degree: int, orders: int) -> tuple[list[np.poly1d], list[np.ndarray]]:
    """Return polynomials of two joints, and their first derivatives at TIMES, shape (4, 2)."""
    joints = [np.poly1d(np.random.default_rng(seed).normal(size=degree + 1)) for seed in (1, 2)]
    parts = [
        np.stack([joint.deriv(order)(TIMES) for joint in joints], axis=1)
        for order in range(orders)
    ]
    return joints, parts


@pytest.mark.parametrize(('degree', 'orders'), [(1, 1), (3, 2), (5, 3)])
def test_polynomial_and_derivatives_are_reproduced(degree, orders):
    joints, parts = sampled(degree, orders)
    times = np.linspace(0.0, 1.0, 41)
    result = Interpolation(TIMES, *parts).at(times)
    for order, values in enumerate(result):
        expected = np.stack([joint.deriv(order)(times) for joint in joints], axis=1)
        np.testing.assert_allclose(values, expected, atol=1e-9)


@pytest.mark.parametrize('orders', [1, 2, 3])
def test_scalar_and_array_times_give_equal_values(orders):
    _, parts = sampled(6, orders)
    spline = Interpolation(TIMES, *parts)
    times = np.linspace(0.0, 1.0, 12)
    many = spline.at(times)
    for index, time in enumerate(times):
        for values, value in zip(many, spline.at(time), strict=True):
            np.testing.assert_allclose(value, values[index], rtol=1e-12, atol=1e-12)


def test_cubic_polynomial_equals_the_interpolated_segment():
    _, (positions, velocities) = sampled(6, 2)
    fraction, h = np.linspace(0.0, 1.0, 9), TIMES[3] - TIMES[2]
    start, end = ((positions[i], velocities[i]) for i in (2, 3))
    expected, _, _ = Interpolation(TIMES, positions, velocities).at(TIMES[2] + fraction * h)
    np.testing.assert_allclose(cubic(fraction[:, None], h, start, end), expected, atol=1e-12)


def test_short_segment_at_a_large_value_loses_no_digits():
    far = np.array([1e6])
    coefficients = hermite((far, np.zeros(1)), (far + 1e-9, np.zeros(1)))
    assert coefficients[0] == far
    assert np.all(np.abs(coefficients[1:]) <= 1e-8)


def test_accelerations_without_velocities_are_ignored():
    _, (positions, _, accelerations) = sampled(5, 3)
    position, _, _ = Interpolation(TIMES, positions, None, accelerations).at(0.15)
    np.testing.assert_allclose(position, positions[:2].mean(axis=0))


def test_central_differences_are_zero_at_both_ends():
    values = (TIMES**2)[:, None]
    slopes = central_differences(TIMES, values)
    assert slopes[[0, -1]].tolist() == [[0.0], [0.0]]
    assert slopes[1, 0] == pytest.approx((0.35**2 - 0.0) / 0.35)
