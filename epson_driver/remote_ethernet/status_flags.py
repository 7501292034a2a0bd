# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Controller status over Remote Ethernet: GetStatus, and the device that has control.

Sources: RC+ 5.0 user's guide, Remote Ethernet (ten flags); EPSON's node for Node-RED (the eleven
flags of the RC700 generation, GetContDev).
"""

from epson_driver.remote_ethernet.client import MAX_ERROR_DIGITS, Ask, RemoteError

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
"""The flags of GetStatus, from left to right."""

REMOTE_ETHERNET = 26
"""Number of Remote Ethernet as a control device, as returned by SPEL+'s CtrlInfo(5)."""

CONTROL_DEVICES = {
    20: 'the teach pendant',
    21: 'the PC with RC+',
    22: 'remote I/O',
    REMOTE_ETHERNET: 'Remote Ethernet',
    29: 'Remote RS-232C',
}


async def ask_flags(ask: Ask) -> tuple[tuple[str, ...], int]:
    """Return the names of the set flags, and the error number.

    RC+ 5 sends ten flags, without Test. Flags are therefore aligned at the end. Raises
    ConnectionError for a reply that is not a status.
    """
    value = await ask('GetStatus')
    bits, _, number = value.partition(',')
    known = number.isdecimal() and len(number) <= MAX_ERROR_DIGITS
    if not known or not 0 < len(bits) <= len(FLAGS) or set(bits) - {'0', '1'}:
        raise ConnectionError(f"'{value[:40]}' is no status")
    named = zip(FLAGS[-len(bits) :], bits, strict=True)
    return tuple(name for name, bit in named if bit == '1'), int(number)


async def ask_control_device(ask: Ask) -> int | None:
    """Return the number of the device that has control, or None if it is unknown.

    It is unconfirmed that GetContDev uses the numbers of CtrlInfo(5). Other numbers become None.
    """
    try:
        value = (await ask('GetContDev')).strip()
    except RemoteError:
        return None
    return int(value) if value in map(str, CONTROL_DEVICES) else None
