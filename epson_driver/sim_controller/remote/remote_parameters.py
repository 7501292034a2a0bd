# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of remote commands and SPEL+ statements, checked."""

import math
from collections.abc import Sequence

from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.sim_controller.remote.remote_acceptance import CommandError

_MAX_CHARACTERS = 20
"""A number with more characters is rejected; none here needs so many."""


def expect(parameters: Sequence[str], least: int, most: int | None = None) -> None:
    """Raise CommandError (format) if there are fewer or more parameters."""
    most = least if most is None else most
    if not least <= len(parameters) <= most:
        count = str(least) if least == most else f'{least} to {most}'
        text = f'{len(parameters)} parameter(s): must be {count}'
        raise CommandError(RemoteErrorNumber.FORMAT, text)


def wrong(name: str, value: object, rule: str) -> CommandError:
    """Return the error for a parameter that does not fit."""
    return CommandError(RemoteErrorNumber.PARAMETER, f'{name} {value}: {rule}')


def whole(name: str, text: str, low: int, high: int) -> int:
    """Read a whole decimal number from `low` to `high`. Raises CommandError (parameter)."""
    digits = text.removeprefix('-')
    if digits.isascii() and digits.isdecimal() and len(text) <= _MAX_CHARACTERS:
        value = int(text)
        if low <= value <= high:
            return value
    raise wrong(name, text, f'must be a whole number from {low} to {high}')


def hexadecimal(name: str, text: str, high: int) -> int:
    """Read a hexadecimal number from 0 to `high`. Raises CommandError (parameter)."""
    if text and len(text) <= _MAX_CHARACTERS and not set(text.lower()) - set('0123456789abcdef'):
        value = int(text, 16)
        if value <= high:
            return value
    raise wrong(name, text, f'must be a hexadecimal number from 0 to {high:X}')


def real(name: str, text: str, low: float, high: float) -> float:
    """Read a number from `low` to `high`. Raises CommandError (parameter)."""
    try:
        value = float(text) if len(text) <= _MAX_CHARACTERS and '_' not in text else math.nan
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise wrong(name, text, f'must be a number from {low:g} to {high:g}')
    return value


def switch(name: str, text: str) -> bool:
    """Read 0 or 1. Raises CommandError (parameter)."""
    if text not in ('0', '1'):
        raise wrong(name, text, 'must be 0 or 1')
    return text == '1'


def robot(parameters: Sequence[str], all_robots: bool = True) -> None:
    """Check that the one robot is named 1, or where allowed 0, all, or not at all."""
    expect(parameters, 0 if all_robots else 1, 1)
    if parameters and parameters[0] not in (('', '0', '1') if all_robots else ('1',)):
        raise wrong('robot', parameters[0], 'there is only robot 1')
