# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks whether the controller can execute a plan at its speed, and whether it has done so.

Times are plan times: pauses and speed scaling do not change them.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.statements import FIXED_SPEED
from epson_driver.driver.delivery.trajectory_points import START_MARGIN_RAD
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.remedy import Remedy
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.profiles.profile_rules import FieldsUsed

MIN_DEVIATION_FRACTION = 0.2
"""Minimum difference between actual and planned time that counts as another speed, as a fraction
of the planned time."""

MIN_FASTER_S, MIN_SLOWER_S = 0.3, 0.5
"""Minimum difference between actual and planned time that counts as another speed, for faster and
for slower motions, s. The second is larger, because the start delay of the controller and the
detection of standstill add to the actual time."""

MAX_FASTER = 1.25
"""Maximum ratio of the controller's speed to the speed of a plan's fastest joint."""

REMEDY = "lower the controller's own speed (in its program, or by the override of its pendant)"

WHY = {
    FieldsUsed.NOTHING: 'this controller ignores point velocities and durations',
    FieldsUsed.VELOCITY: 'this controller ignores point durations and uses the velocities',
    FieldsUsed.DURATION: 'this controller did not keep the point durations',
    FieldsUsed.BOTH: 'this controller did not keep the point durations',
}


@dataclass(frozen=True, slots=True)
class Timing:
    """Planned duration of a goal, and actual duration until the arm was at rest at its end, s."""

    planned: float
    executed: float

    @property
    def deviates(self) -> bool:
        """Whether the goal ran at another speed than planned."""
        late = self.executed - self.planned
        minimum = MIN_SLOWER_S if late > 0.0 else MIN_FASTER_S
        return abs(late) > max(minimum, MIN_DEVIATION_FRACTION * self.planned)


class TimingMonitor:
    """Checks speed scaling, plans and streams against the speeds that the controller supports.

    Some controllers ignore the velocities of points, their durations, or both.
    """

    def __init__(self, rules: DeliveryRules, limits: JointLimits) -> None:
        points_have_times = rules.point_message == 'joint_traj_pt_full'
        uses = FieldsUsed.DURATION if points_have_times else rules.uses
        statements = rules.interface == 'statements'
        self.by_velocity = uses is not FieldsUsed.DURATION
        """Whether the controller may use the velocities of points."""
        self.unplanned = uses is FieldsUsed.NOTHING and not statements
        """Whether the controller ignores the velocities and durations of points."""
        self._downloads = rules.interface == 'download'
        self._why = WHY[uses]
        self._fixed = self._no_pause = ''
        if self.unplanned:
            self._fixed = f'{self._why}: {REMEDY}'
        if statements:
            self._why = f'the controller plans motions itself (power {rules.power})'
            self._fixed = self._no_pause = FIXED_SPEED
        elif self._downloads:
            self._no_pause = 'the controller has all points of a download: stop the arm instead'
        self._speed, self._slowest = rules.speed, rules.slowest
        self._limits = limits

    def deviation(self, timing: Timing) -> str:
        """Return a text with both times and the reason if they differ too much, or ''."""
        if not timing.deviates:
            return ''
        return f'took {timing.executed:.3g} s instead of {timing.planned:.3g} s: {self._why}'

    def check_factor(self, factor: float, running: Trajectory | None) -> None:
        """Raise ValueError if the controller cannot execute motions at the speed scaling `factor`.

        `running`: the trajectory being executed, or None.
        """
        why = self._no_pause if factor == 0.0 else self._fixed if factor < 1.0 else ''
        if running is not None and self._downloads and factor < 1.0:
            why = why or (
                'the controller has all points of the running motion, which keeps its speed: '
                'wait for its end, or stop the arm'
            )
        if running is not None and 0.0 < factor < 1.0:
            why = why or self._too_slow(self._fastest(running, running.positions[0]) * factor)
        if why:
            raise ValueError(f'factor = {factor:g}: {why}')

    def why_no_stream(self) -> str:
        """Return why the controller cannot execute setpoint streams at their speed, or ''."""
        return f'streams of setpoints have no speed here: {self._fixed}' if self.unplanned else ''

    def check(self, trajectory: Trajectory, start: Array, factor: float) -> None:
        """Raise GoalRejectedError if the controller would execute a plan faster than planned.

        `start`: position of the arm at rest, shape (n,), rad. `factor`: the speed scaling.
        """
        fastest = self._fastest(trajectory, start) * factor
        why = self._too_slow(fastest)
        if self.unplanned and self._speed > MAX_FASTER * fastest:
            why = (
                f'the plan moves at {fastest:.3g} of the velocity limits at most, the controller '
                f'at {self._speed:.3g}: {self._fixed}'
            )
        if why and np.max(np.abs(trajectory.positions - start)) > START_MARGIN_RAD:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, why, Remedy.ALLOW_OTHER_SPEED)

    def _too_slow(self, fastest: float) -> str:
        """Return why the controller cannot move as slowly as a plan, or ''.

        `fastest`: speed of the plan's fastest joint, as a fraction of its limit.
        """
        if self._slowest <= MAX_FASTER * fastest:
            return ''
        return (
            f'the plan moves at {fastest:.3g} of the velocity limits at most: the minimum of the '
            f'controller is {self._slowest:g}'
        )

    def _fastest(self, trajectory: Trajectory, start: Array) -> float:
        """Return the speed of a plan's fastest joint, as a fraction of its velocity limit."""
        steps = np.abs(np.diff(trajectory.positions, axis=0, prepend=start[None, :]))
        times = np.diff(trajectory.times, prepend=0.0)
        fractions = steps[times > 0.0] / times[times > 0.0][:, None] / self._limits.velocity
        if trajectory.velocities is not None:
            at_points = np.abs(trajectory.velocities) / self._limits.velocity
            fractions = np.vstack([fractions, at_points])
        return float(np.max(fractions, initial=0.0))
