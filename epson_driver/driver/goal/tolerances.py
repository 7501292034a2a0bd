# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tolerances per joint, and what violates them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array


@dataclass(frozen=True, slots=True, eq=False)
class Tolerances:
    """How far each joint may be from where it should be: shape (n,), inf where not checked.

    position: rad. velocity: rad/s.
    """

    position: Array
    velocity: Array

    @property
    def checked(self) -> bool:
        """Whether any joint has a limit."""
        return bool(np.isfinite(self.position).any() or np.isfinite(self.velocity).any())

    def violation(
        self,
        names: Sequence[str],
        position_error: Array,
        velocity_error: Array,
        unit: Callable[[int], str] = lambda _: 'rad',
    ) -> str | None:
        """Return a clause with joint, error and limit for the worst violation; None if none.

        `unit` tells that of a joint, by its index.
        """
        for quantity, errors, limits, per in (
            ('position', position_error, self.position, ''),
            ('velocity', velocity_error, self.velocity, '/s'),
        ):
            excess = np.abs(errors) - limits
            worst = int(np.argmax(excess))
            if excess[worst] > 0.0:
                return (
                    f'{names[worst]}: the {quantity} error is '
                    f'{abs(errors[worst]):.6g} {unit(worst)}{per}, '
                    f'the tolerance is {limits[worst]:.6g} {unit(worst)}{per}'
                )
        return None
