# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ statements that set a number, as a table of ranges: SPEL+ language reference.

Speed, SpeedFactor and Accel act on point-to-point motion. The others are kept and can be printed:
there is no motion here that they would act on.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.remote.remote_parameters import expect, real, whole, wrong

if TYPE_CHECKING:
    from epson_driver.sim_controller.core import Controller


class Setting(NamedTuple):
    """How many numbers, from where to where; `default` where the manual gives one."""

    least: int
    most: int
    low: float
    high: float
    unit: str
    default: tuple[float, ...] = ()


SETTINGS: dict[str, Setting] = {
    'Speed': Setting(1, 3, 1, 100, '%'),
    'Accel': Setting(2, 6, 1, 100, '%'),
    'SpeedFactor': Setting(1, 1, 1, 100, '%', (100,)),
    'SpeedS': Setting(1, 3, 0.1, 2000, 'mm/s', (50,)),
    'AccelS': Setting(1, 6, 0.1, 25000, 'mm/s²', (200,)),
    'SpeedR': Setting(1, 1, 0.1, 1000, 'deg/s'),
    'AccelR': Setting(1, 2, 0.1, 5000, 'deg/s²'),
    'Weight': Setting(1, 2, 0, 100, 'kg', (1,)),
    'Inertia': Setting(1, 2, 0, 100, 'kgm²'),
}
"""Speed and Accel are the driver program's own until something sets them."""

DEFAULTS_AFTER = (Event.MOTORS_ON, Event.RESET, Event.STOP, Event.BOOT)
"""After these events SPEL+ forgets what was set."""


def defaults(controller: 'Controller') -> None:
    """Forget what was set."""
    controller.spel.settings.clear()
    _act(controller)


def values(controller: 'Controller', name: str) -> tuple[float, ...]:
    """Return what is set; nothing if nothing was, and there is no default."""
    motion = controller.profile.motion
    program = {'Speed': (motion.speed * 100,), 'Accel': (motion.accel * 100,) * 2}
    held = controller.spel.settings.get(name)
    return held or program.get(name) or SETTINGS[name].default


def change(controller: 'Controller', name: str, texts: Sequence[str]) -> None:
    """Set the numbers of a statement. Raises CommandError, and nothing is changed."""
    setting = SETTINGS[name]
    expect(texts, setting.least, setting.most)
    numbers = tuple(real(name, text, setting.low, setting.high) for text in texts)
    controller.spel.settings[name] = numbers
    _act(controller)


def show(controller: 'Controller', name: str, arguments: Sequence[str]) -> str:
    """Return one number of a statement, the first one by default. Raises CommandError."""
    held = values(controller, name)
    if not held:
        raise wrong(name, '()', 'was not set')
    number = whole(name, arguments[0], 1, len(held)) if arguments else 1
    return f'{held[number - 1]:g}'


def _act(controller: 'Controller') -> None:
    """Let the arm move as it is set. Of acceleration and deceleration the smaller one counts."""
    factor = values(controller, 'SpeedFactor')[0] / 100.0
    controller.speed = values(controller, 'Speed')[0] / 100.0 * factor
    controller.accel = min(values(controller, 'Accel')[:2]) / 100.0
