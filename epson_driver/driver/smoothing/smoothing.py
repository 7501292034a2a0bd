# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How a plan is changed before it is sent."""

from dataclasses import dataclass

import numpy as np

from epson_driver.profiles.profile import ProgramProfile


@dataclass(frozen=True, slots=True)
class Smoothing:
    """Which motion is sent instead of a plan.

    resample_period: time between two points of the smooth motion, s; None for the plan's own
    points. time_optimal: as fast as the limits allow, whatever the plan's times. thin: few points,
    resample_period apart or more, of the plan's own where they are; straight ways between them are
    at most deviation rad (or m) off the smooth motion, in any joint. longest: time between two
    points of a time-optimal plan at most, s.
    """

    resample_period: float | None = None
    time_optimal: bool = False
    thin: bool = False
    deviation: float = np.inf
    longest: float = np.inf

    @property
    def wanted(self) -> bool:
        """Whether a plan is changed before it is sent."""
        return self.time_optimal or self.resample_period is not None


def usual_smoothing(program: ProgramProfile) -> Smoothing:
    """Return what suits a controller unless somebody wants something else."""
    return Smoothing(
        None if program.smoothing == 'none' else program.resample_period,
        thin=program.smoothing == 'thin',
        deviation=program.thin_deviation,
    )
