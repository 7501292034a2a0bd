# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A sampled motion, and its interpolation between the samples."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion import Array
from epson_driver.motion.interpolation import cubic

Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Record:
    """Samples at equal steps of `dt` s. The first one is at rest at time 0.

    positions, velocities, accelerations: shape (k, n). costs: wall time of each step in s, shape
    (k − 1,). planned: whether the step included new points or planning, as far as known. Both may
    be empty.
    """

    dt: float
    positions: Array
    velocities: Array
    accelerations: Array
    costs: Array
    planned: Mask

    def between(self, samples: Index, shares: Array) -> Array:
        """Return positions at `shares` of the steps that start at `samples`: (m,) to (m, n).

        Cubic Hermite: exact for constant jerk, and within 1e-8 rad where the jerk jumps.
        """
        start, end = ((self.positions[i], self.velocities[i]) for i in (samples, samples + 1))
        return cubic(shares[:, None], self.dt, start, end)
