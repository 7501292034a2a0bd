# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Check whether reported joint values are plausible.

Plausible values are inside the joints' ranges, and consistent with the velocity limits.
Implausible values come from a wrong robot model, wrong units, a lost encoder or a damaged message.
The arm's position is then unknown, so the arm must not move.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import ge, le, sub

from epson_driver.motion import JointLimits

MIN_JUMP = 0.05  # always plausible, rad or m: the motion in a time error of a few ms


@dataclass(frozen=True, slots=True)
class Margins:
    """Tolerances for reported joint values beyond the joint limits."""

    position: float = 0.1  # rad or m: by hand a joint reaches its mechanical stops
    velocity: float = 1.5  # maximum velocity, as a multiple of the velocity limit


DEFAULT_MARGINS = Margins()


class JointBounds:
    """Checks whether reported joint values are plausible. Without `limits`, all values are.

    A check runs 200 times a second, so it tests all joints together first. Only if this test fails
    does it test each joint.
    """

    def __init__(self, joints: int, limits: JointLimits | None, margins: Margins) -> None:
        if limits is None:
            self.names = tuple(f'joint {joint}' for joint in range(1, joints + 1))
            self.units = ('rad',) * joints
            self._low, self._high = [float('-inf')] * joints, [float('inf')] * joints
            self.fastest: list[float] = [float('inf')] * joints
            return
        self.names, self.units = limits.names, limits.units
        self._low = (limits.position_min - margins.position).tolist()
        self._high = (limits.position_max + margins.position).tolist()
        self.fastest = (limits.velocity * margins.velocity).tolist()

    def bounded(self, velocities: Sequence[float]) -> list[float]:
        pairs = zip(velocities, self.fastest, strict=True)
        return [min(max(value, -fastest), fastest) for value, fastest in pairs]

    def why_not_there(self, positions: Sequence[float]) -> str | None:
        """Return which position is outside its range plus the margin, or None."""
        if all(map(le, self._low, positions)) and all(map(ge, self._high, positions)):
            return None
        joint, low, value, high = next(
            (joint, low, value, high)
            for joint, (low, value, high) in enumerate(
                zip(self._low, positions, self._high, strict=True)
            )
            if not low <= value <= high
        )
        return (
            f'{self.names[joint]} is reported at {value:.6g} {self.units[joint]}, '
            f'outside its range with margin, {low:.6g} … {high:.6g}'
        )

    def why_not_from(
        self, before: Sequence[float], positions: Sequence[float], elapsed: float
    ) -> str | None:
        """Return why the joints cannot have moved so far in `elapsed` s, or None."""
        if max(map(abs, map(sub, positions, before))) <= MIN_JUMP:
            return None
        for joint, value in enumerate(positions):
            farthest = self.fastest[joint] * elapsed + MIN_JUMP
            if abs(value - before[joint]) > farthest:
                unit = self.units[joint]
                return (
                    f'{self.names[joint]} is reported to have jumped by '
                    f'{value - before[joint]:.6g} {unit} in {elapsed:.3g} s: the '
                    f'maximum is {farthest:.3g} {unit}'
                )
        return None

    def why_not_so_fast(self, velocities: Sequence[float]) -> str | None:
        if all(map(ge, self.fastest, map(abs, velocities))):
            return None
        for joint, value in enumerate(velocities):
            if abs(value) > self.fastest[joint]:
                return (
                    f'{self.names[joint]} is reported to move at {value:.6g} '
                    f'{self.units[joint]}/s: the maximum with margin is '
                    f'{self.fastest[joint]:.3g}'
                )
        return None
