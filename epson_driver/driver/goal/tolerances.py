# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tolerances per joint: the configured ones, and what a goal says instead.

Names and meaning are joint_trajectory_controller's: 0 takes the default, negative switches the
check off. The controllers report no accelerations, so a goal that limits their error is refused.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
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
        """Whether any of them limits anything."""
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


def tolerances(
    message: Iterable[Any], field: str, joint_names: Sequence[str], defaults: Array
) -> Tolerances:
    """Return the tolerances of a goal's JointTolerance[], the goal's `field`.

    `defaults` (shape (n,), rad; 0: not checked) hold for positions; velocities have none. Raises
    GoalRejectedError for a joint that is not there, a number that is not finite, and a limit of
    the acceleration.
    """
    values = {
        'position': np.where(defaults > 0.0, defaults, np.inf),
        'velocity': np.full(len(joint_names), np.inf),
    }
    for entry in message:
        if entry.name not in joint_names:
            raise GoalRejectedError(
                ErrorCode.INVALID_JOINTS, f'{field} names the unknown joint {entry.name!r}'
            )
        for quantity in ('position', 'velocity', 'acceleration'):
            value = getattr(entry, quantity)
            if not np.isfinite(value):
                raise GoalRejectedError(
                    ErrorCode.INVALID_GOAL,
                    f'{field}, {entry.name}: {quantity} = {value} is not finite',
                )
            if quantity in values:
                if value != 0.0:
                    index = joint_names.index(entry.name)
                    values[quantity][index] = value if value > 0.0 else np.inf
            elif value > 0.0:
                raise GoalRejectedError(
                    ErrorCode.INVALID_GOAL,
                    f'{field}, {entry.name}: {quantity} = {value:g} cannot be checked: the '
                    f'controller reports no accelerations; leave it at 0',
                )
    return Tolerances(values['position'], values['velocity'])
