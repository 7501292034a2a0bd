# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The delay of an arm behind a sine of setpoints."""

from collections.abc import Callable

import numpy as np

from epson_driver.motion import Array

AMPLITUDE, FREQUENCY = 0.2, 0.25
SETTLED_S = 2.0
"""Time after the start that is ignored, s."""


def policy(passed: float | Array, frequency: float = FREQUENCY) -> Array:
    """Return joint 1, rad, at times since the start, s."""
    return np.asarray(AMPLITUDE * np.sin(2.0 * np.pi * frequency * np.asarray(passed)))


def behind(times: Array, path: Array, wave: Callable[[Array], Array]) -> tuple[float, float]:
    """Return the delay, s, with the smallest rms error to the measured path, and that error."""
    chosen = times > SETTLED_S
    lags = np.arange(-0.1, 1.5, 0.002)
    off = [path[chosen] - wave(times[chosen] - lag) for lag in lags.tolist()]
    rms = np.sqrt(np.mean(np.square(off), axis=1))
    return float(lags[rms.argmin()]), float(rms.min())
