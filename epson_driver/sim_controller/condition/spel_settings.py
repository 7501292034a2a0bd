# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Values of SPEL+ settings such as Speed and Accel.

Speed, SpeedFactor and Accel affect point-to-point motion. SpeedS, AccelS, SpeedR, AccelR and
SpeedFactor affect the straight lines of a SPEL+ program. The other settings affect no motion of
the simulation, and can only be read back.
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


class SpelSettings:
    """Current values of the SPEL+ settings.

    speed, accel: initial values of Speed and Accel, fractions (0, 1] of the limits.
    """

    def __init__(self, speed: float, accel: float) -> None:
        self._program = {'Speed': (speed * 100,), 'Accel': (accel * 100,) * 2}
        self._set: dict[str, tuple[float, ...]] = {}
        self.home: tuple[int, ...] | None = None  # set by HomeSet, encoder pulses per joint

    def values(self, name: str) -> tuple[float, ...]:
        """Return the numbers of a setting, or () if it has neither a value nor a default."""
        return self._set.get(name) or self._program.get(name) or SETTINGS[name]

    def change(self, name: str, numbers: tuple[float, ...]) -> None:
        self._set[name] = numbers

    def reset(self) -> None:
        """Reset all settings to their initial values, except the home position."""
        self._set.clear()

    @property
    def speed(self) -> float:
        factor = self.values('SpeedFactor')[0] / 100.0
        return self.values('Speed')[0] / 100.0 * factor

    @property
    def accel(self) -> float:
        """The smaller of the two values of Accel, for acceleration and for deceleration."""
        return min(self.values('Accel')[:2]) / 100.0
