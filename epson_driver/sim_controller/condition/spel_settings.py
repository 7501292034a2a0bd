# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Settings of SPEL+ statements, and their values.

Speed, SpeedFactor and Accel affect point-to-point motion. SpeedS, AccelS, SpeedR, AccelR and
SpeedFactor affect the straight lines of a SPEL+ program. The others are stored and can be printed,
but the simulation has no motion that uses them.
"""

from epson_driver.sim_controller.condition.states import Event

SETTINGS: dict[str, tuple[float, ...]] = {
    'Speed': (),
    'Accel': (),
    'SpeedFactor': (100,),
    'SpeedS': (50,),
    'AccelS': (200,),
    'SpeedR': (),
    'AccelR': (),
    'Weight': (1,),
    'Inertia': (),
}
"""The manual's initial values. Those of Speed and Accel come from the driver program."""

DEFAULTS_AFTER = (Event.MOTORS_ON, Event.RESET, Event.STOP, Event.BOOT)
"""Events after which SPEL+ resets the settings."""


class SpelSettings:
    """The settings of one controller, and its home position.

    `speed` and `accel` of the driver program are fractions (0, 1] of the robot's limits.
    """

    def __init__(self, speed: float, accel: float) -> None:
        self._program = {'Speed': (speed * 100,), 'Accel': (accel * 100,) * 2}
        self._set: dict[str, tuple[float, ...]] = {}
        self.home: tuple[int, ...] | None = None
        """Home position set by HomeSet, encoder pulses, one per joint."""

    def values(self, name: str) -> tuple[float, ...]:
        """Return the numbers of a statement, or none if it has neither a setting nor a default."""
        return self._set.get(name) or self._program.get(name) or SETTINGS[name]

    def change(self, name: str, numbers: tuple[float, ...]) -> None:
        """Set the numbers of a statement, which must be in its range."""
        self._set[name] = numbers

    def forget(self) -> None:
        """Reset all numbers except the home position."""
        self._set.clear()

    @property
    def speed(self) -> float:
        """The joints' speed by Speed and SpeedFactor, a fraction (0, 1]."""
        factor = self.values('SpeedFactor')[0] / 100.0
        return self.values('Speed')[0] / 100.0 * factor

    @property
    def accel(self) -> float:
        """The joints' acceleration by Accel, a fraction (0, 1]: the smaller of its values.

        SPEL+ has one number for acceleration and one for deceleration.
        """
        return min(self.values('Accel')[:2]) / 100.0
