# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Values of SPEL+ settings such as Speed and Accel.

Speed, SpeedFactor and Accel affect point-to-point motion. SpeedS, AccelS, SpeedR, AccelR and
SpeedFactor affect the straight lines of a SPEL+ program. The other settings can only be read back.
The simulation has no motion that uses them.
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
"""Setting → initial values in the SPEL+ manual. `SpelSettings` adds Speed and Accel."""

DEFAULTS_AFTER = (Event.MOTORS_ON, Event.RESET, Event.STOP, Event.BOOT)
"""Events after which SPEL+ resets the settings."""


class SpelSettings:
    """The settings of one controller, and its home position.

    `speed` and `accel` are the initial Speed and Accel, fractions (0, 1] of the robot's limits.
    """

    def __init__(self, speed: float, accel: float) -> None:
        self._program = {'Speed': (speed * 100,), 'Accel': (accel * 100,) * 2}
        self._set: dict[str, tuple[float, ...]] = {}
        self.home: tuple[int, ...] | None = None
        """Home position set by HomeSet, encoder pulses, one per joint."""

    def values(self, name: str) -> tuple[float, ...]:
        """Return the numbers of a setting, or () if it is not set and has no default."""
        return self._set.get(name) or self._program.get(name) or SETTINGS[name]

    def change(self, name: str, numbers: tuple[float, ...]) -> None:
        """Set a setting to `numbers`, which must be within its range."""
        self._set[name] = numbers

    def reset(self) -> None:
        """Reset all settings to their initial values. The home position remains."""
        self._set.clear()

    @property
    def speed(self) -> float:
        """Fraction (0, 1] of the joints' speed, according to Speed and SpeedFactor."""
        factor = self.values('SpeedFactor')[0] / 100.0
        return self.values('Speed')[0] / 100.0 * factor

    @property
    def accel(self) -> float:
        """Fraction (0, 1] of the joints' acceleration: the smaller of the two values of Accel.

        One value is for the acceleration and one for the deceleration.
        """
        return min(self.values('Accel')[:2]) / 100.0
