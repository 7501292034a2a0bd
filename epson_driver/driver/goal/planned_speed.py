# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the controller keeps the planned speed of a goal.

Times are those of the plan: what pauses and the speed scaling add does not count.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.statements import FIXED_SPEED
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.profiles.profile_rules import FieldsUsed

MIN_DEVIATION_SHARE = 0.2
"""A plan that takes this much longer or shorter, as a share of its time, runs at another speed."""

MIN_DEVIATION_S = 0.3
"""And by at least so much, s: seeing that the arm stands takes some of it."""

WHY = {
    FieldsUsed.NOTHING: 'this kind of controller ignores the velocities and durations of points',
    FieldsUsed.VELOCITY: 'this kind of controller ignores durations and goes by the velocities',
    FieldsUsed.DURATION: 'the controller took another time than its points say',
    FieldsUsed.BOTH: 'the controller took another time than its points say',
}


@dataclass(frozen=True, slots=True)
class Timing:
    """How long a goal was planned to take, and how long it took until the arm stood there, s."""

    planned: float
    executed: float

    @property
    def deviates(self) -> bool:
        """Whether it ran at another speed than planned."""
        limit = max(MIN_DEVIATION_S, MIN_DEVIATION_SHARE * self.planned)
        return abs(self.executed - self.planned) > limit


class PlannedSpeed:
    """Whether the controller follows the timing of a trajectory."""

    def __init__(self, rules: DeliveryRules, limits: JointLimits) -> None:
        points_have_times = rules.point_message == 'joint_traj_pt_full'
        self._uses = FieldsUsed.DURATION if points_have_times else rules.uses
        self.by_velocity = self._uses is not FieldsUsed.DURATION
        """Whether it may go by the velocities of points."""
        statements = rules.interface == 'statements'
        self.fixed = FIXED_SPEED if statements else ''
        """Why the speed of a motion cannot be changed any more, or ''."""
        self._why = WHY[self._uses]
        if statements:
            self._why = f'the controller plans motions by itself (power {rules.power})'
        self._speed = rules.speed
        self._limits = limits

    def deviation(self, timing: Timing) -> str:
        """Return a clause with both times and why they differ, or '' if they hardly do."""
        if not timing.deviates:
            return ''
        return f'executed in {timing.executed:.3g} s, planned {timing.planned:.3g} s: {self._why}'

    def check(self, trajectory: Trajectory, start: Array) -> None:
        """Raise GoalRejectedError for a plan that is known to run at another speed.

        `start`: shape (n,), rad, where the arm stands.
        """
        if self._uses is not FieldsUsed.NOTHING:
            return
        steps = np.abs(np.diff(trajectory.positions, axis=0, prepend=start[None, :]))
        expected = float(np.sum(np.max(steps / self._limits.velocity, axis=1))) / self._speed
        timing = Timing(trajectory.duration, expected)
        if timing.deviates:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'the plan takes {timing.planned:.3g} s, but {self._why}: it would take '
                f'about {expected:.3g} s, and the planned speed is required',
            )
