# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Queries over Remote Ethernet: status flags, device in control, identity, joint positions.

Sources: RC+ 5.0 user's guide, Remote Ethernet (ten flags), and EPSON's node for Node-RED (the
eleven flags of the RC700 generation, GetContDev).

The simulated controller reports its identity (`$Sim,identity`). A real controller is queried for
its type and its robot (`$GetContType`, `$GetRobotInfo`). A SPEL+ `Print` statement returns the
joint positions. The controller accepts this statement only in AUTO, while idle, without E-stop,
error or open door.
"""

import re
from collections.abc import Sequence
from math import radians

from epson_driver.inputs import decimal
from epson_driver.remote_ethernet.client import MAX_ERROR_DIGITS, Ask, RemoteError
from epson_driver.remote_ethernet.hand import value_or_empty

FLAGS = (
    'Test',
    'Teach',
    'Auto',
    'Warning',
    'SError',
    'Safeguard',
    'EStop',
    'Error',
    'Paused',
    'Running',
    'Ready',
)
"""Names of the flags in a GetStatus reply, from left to right."""

REMOTE_ETHERNET = 26  # as a control device, as in SPEL+'s CtrlInfo(5)

CONTROL_DEVICES = {
    20: 'the teach pendant',
    21: 'the PC with RC+',
    22: 'remote I/O',
    REMOTE_ETHERNET: 'Remote Ethernet',
    29: 'Remote RS-232C',
}


async def ask_flags(ask: Ask) -> tuple[tuple[str, ...], int]:
    """Return the names of the flags set in GetStatus, and the error number.

    A controller of RC+ 5 omits the first flag, Test.
    """
    value = await ask('GetStatus')
    bits, _, number = value.partition(',')
    known = number.isdecimal() and len(number) <= MAX_ERROR_DIGITS
    if not known or not 0 < len(bits) <= len(FLAGS) or set(bits) - {'0', '1'}:
        raise ConnectionError(f"'{value[:40]}' is not a status")
    named = zip(FLAGS[-len(bits) :], bits, strict=True)
    return tuple(name for name, bit in named if bit == '1'), int(number)


async def ask_control_device(ask: Ask) -> int | None:
    """Return the number of the device in control, a key of CONTROL_DEVICES, or None.

    GetContDev is assumed to use the numbers of CtrlInfo(5), which is unconfirmed.
    """
    try:
        value = (await ask('GetContDev')).strip()
    except RemoteError:
        return None
    return int(value) if value in map(str, CONTROL_DEVICES) else None


_SIMULATED = re.compile(r'controller=(.{1,64});robot=(.{1,64})')
_NAME = re.compile(r'(?=.*[A-Za-z])[A-Za-z0-9 ._+/-]{1,64}')


async def identity(ask: Ask, address: str) -> str:
    """Return a controller's identity, such as `spel (simulated), c3_a601s, 127.0.0.1:5000`."""
    controller, robot, simulated = await ask_identity(ask)
    if simulated and controller != 'simulated':
        controller += ' (simulated)'
    return ', '.join([*filter(None, (controller, robot)), address])


async def ask_identity(ask: Ask) -> tuple[str, str, bool]:
    """Return the type of the controller, its robot model, and whether it is simulated.

    An unknown robot model is returned as ''.
    """
    if result := _SIMULATED.fullmatch(await value_or_empty(ask, 'Sim,identity')):
        return result[1], result[2], True
    controller = await value_or_empty(ask, 'GetContType')
    robot = (await value_or_empty(ask, 'GetRobotInfo')).rpartition(',')[2]
    names = [name if _NAME.fullmatch(name) else '' for name in (controller, robot)]
    return names[0], names[1], False


_SI_UNITS = {'rad': radians(1.0), 'm': 1e-3}  # from degrees or mm

_SHOWN_CHARACTERS = 60


async def ask_positions(ask: Ask, units: Sequence[str]) -> tuple[tuple[float, ...], bool]:
    """Return the joint positions, rad or m, and whether the motors are on.

    `units`: rad or m for each joint.
    """
    angles = ', '.join(f'Agl({joint})' for joint in range(1, len(units) + 1))
    command = f'Execute,"Print {angles}, Motor"'
    value = await ask(command)
    try:
        numbers = [decimal(word) for word in value.strip('" ').split()]
        positions = [n * _SI_UNITS[unit] for n, unit in zip(numbers[:-1], units, strict=True)]
    except ValueError as error:
        shown = value[:_SHOWN_CHARACTERS]
        raise ConnectionError(f"'{shown}' is not a reply to {command}") from error
    return tuple(positions), bool(numbers[-1])
