# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Velocities and accelerations from positions that arrive at uneven times.

Differences of neighbouring samples would turn the jitter of arrival times into spikes, so a
polynomial is fitted to a window around each sample.
"""

import math

import numpy as np

from epson_driver.motion import Array

HALF_WINDOW_S = 0.03
"""Half width of the window around a sample, s, against the jitter of arrival times."""

MIN_NEIGHBOURS, MAX_NEIGHBOURS = 2, 25
LATE_PERIODS = 5.0
"""Gap before a joint state, in periods, above which it counts as very late."""

UNLIKELY_SHARE = 0.3
"""Maximum deviation of a velocity from the fit to many samples, as a share of the fit."""

SHORTEST_SHARE = 0.9
"""Minimum time between two joint states at their sender, as a share of the median gap."""

CHUNK = 20_000
"""Number of samples fitted together. It bounds the memory."""


def likely_derivatives(sent: Array, came: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations from the times of sending, shape (k, m).

    A controller sends periodically, so joint states that arrive in a burst were delayed in
    transit. Around a very late joint state it is unknown whether it was delayed or sent late. A
    value there that deviates strongly from a fit to MAX_NEIGHBOURS samples on either side, by
    arrival times, is replaced by the fit.
    """
    if len(came) < 2 * MIN_NEIGHBOURS + 1:
        return derivatives(sent, positions)
    gaps = np.diff(came)
    shortest = SHORTEST_SHARE * float(np.median(gaps))
    sent, came = apart(sent, shortest), apart(came, shortest)
    velocities, accelerations = derivatives(sent, positions)
    late = np.flatnonzero(gaps > LATE_PERIODS * np.median(gaps))
    doubtful = np.zeros(len(came), dtype=bool)
    for at in late.tolist():
        doubtful[max(at - MAX_NEIGHBOURS, 0) : at + 1 + MAX_NEIGHBOURS] = True
    if not doubtful.any():
        return velocities, accelerations
    reach = min(MAX_NEIGHBOURS, (len(came) - 1) // 2)
    slopes, _ = _fitted(came, positions, reach, degree=1)
    _, bends = _fitted(came, positions, reach, degree=2)
    unlikely = np.abs(velocities - slopes) > UNLIKELY_SHARE * np.abs(slopes)
    unlikely &= doubtful[:, None]
    velocities[unlikely], accelerations[unlikely] = slopes[unlikely], bends[unlikely]
    return velocities, accelerations


def apart(times: Array, shortest: float) -> Array:
    """Return the times, ascending, moved earlier so that none are closer than `shortest` s."""
    steps = shortest * np.arange(len(times))
    return np.asarray(np.minimum.accumulate((times - steps)[::-1])[::-1] + steps)


def derivatives(times: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations, shape (k, m) each, from a parabola fitted in a window.

    times: shape (k,), s, ascending. The window contains the samples up to HALF_WINDOW_S around
    each sample, at least two on either side. Near the ends it is one-sided. With fewer than five
    samples both are 0.
    """
    count = len(times)
    if count < 2 * MIN_NEIGHBOURS + 1:
        return np.zeros_like(positions), np.zeros_like(positions)
    reach = math.ceil(HALF_WINDOW_S / max(float(np.median(np.diff(times))), 1e-6))
    reach = min(max(reach, MIN_NEIGHBOURS), MAX_NEIGHBOURS, (count - 1) // 2)
    return _fitted(times, positions, reach, degree=2)


def _fitted(times: Array, positions: Array, reach: int, degree: int) -> tuple[Array, Array]:
    """Return both derivatives of the polynomial of a degree through `reach` on either side."""
    count = len(times)
    velocities, accelerations = np.empty_like(positions), np.zeros_like(positions)
    offsets = np.arange(-reach, reach + 1)
    for begin in range(0, count, CHUNK):
        here = np.arange(begin, min(begin + CHUNK, count))
        window = np.clip(here, reach, count - 1 - reach)[:, None] + offsets
        since = times[window] - times[here, None]
        scale = np.abs(since).max(axis=1, keepdims=True)
        scale[scale == 0.0] = 1.0
        share = since / scale  # within ±2: the normal equations stay well conditioned
        powers = share[:, :, None] ** np.arange(degree + 1)
        normal = np.einsum('kwi,kwj->kij', powers, powers) + 1e-12 * np.eye(degree + 1)
        right = np.einsum('kwi,kwm->kim', powers, positions[window] - positions[here, None])
        fitted = np.linalg.solve(normal, right)
        velocities[here] = fitted[:, 1] / scale
        if degree > 1:
            accelerations[here] = 2.0 * fitted[:, 2] / scale**2
    return velocities, accelerations
