# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint positions from a controller without a program: `$Execute,"Print Agl(1), …, Motor"`.

The controller only accepts statements in AUTO, while it executes nothing, without E-stop, error or
open door.
"""

from collections.abc import Sequence
from math import radians

from epson_driver.inputs import decimal

_SHOWN_CHARACTERS = 60


def joints_question(count: int) -> str:
    """Return the command that prints joints and motors, without its `$`."""
    angles = ', '.join(f'Agl({joint})' for joint in range(1, count + 1))
    return f'Execute,"Print {angles}, Motor"'


def joints_of(value: str, count: int) -> list[float]:
    """Return the printed numbers: degrees and mm, then the motors. Raises ConnectionError."""
    try:
        numbers = [decimal(word) for word in value.strip('" ').split()]
    except ValueError:
        numbers = []
    if len(numbers) != count + 1:
        shown = value[:_SHOWN_CHARACTERS]
        raise ConnectionError(f"'{shown}' is no answer to {joints_question(count)}")
    return numbers


def joints_in_si(values: Sequence[float], units: Sequence[str]) -> tuple[float, ...]:
    """Convert joint positions from degrees or mm to rad or m, by their units."""
    scales = {'rad': radians(1.0), 'm': 1e-3}
    return tuple(value * scales[unit] for value, unit in zip(values, units, strict=True))
