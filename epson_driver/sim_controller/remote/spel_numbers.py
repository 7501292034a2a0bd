# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ statements that set a number, and the functions that tell it."""

from collections.abc import Sequence

from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.remote.controller_interface import ControllerInterface
from epson_driver.sim_controller.remote.remote_parameters import expect, real, whole, wrong


def change(controller: ControllerInterface, name: str, texts: Sequence[str]) -> None:
    """Set the numbers of a statement. Raises CommandError, and nothing is changed."""
    setting = SETTINGS[name]
    expect(texts, setting.least, setting.most)
    numbers = tuple(real(name, text, setting.low, setting.high) for text in texts)
    controller.change_setting(name, numbers)


def show(controller: ControllerInterface, name: str, arguments: Sequence[str]) -> str:
    """Return one number of a statement, the first one by default. Raises CommandError."""
    held = controller.spel.values(name)
    if not held:
        raise wrong(name, '()', 'was not set')
    number = whole(name, arguments[0], 1, len(held)) if arguments else 1
    return f'{held[number - 1]:g}'
