# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Identifies the controller at a remote port: its type, robot and address.

The simulated controller reports everything (`$Sim,identity`). A real one is queried for its type
and robot (`$GetContType`, `$GetRobotInfo`). An older one without these commands is identified by
its address.
"""

import re

from epson_driver.remote_ethernet.client import Ask
from epson_driver.remote_ethernet.hand import told

_SIMULATED = re.compile(r'controller=(.{1,64});robot=(.{1,64})')
_NAME = re.compile(r'(?=.*[A-Za-z])[A-Za-z0-9 ._+/-]{1,64}')


async def identity(ask: Ask, address: str) -> str:
    """Return the identity of a controller: `spel (simulated), c3_a601s, 127.0.0.1:5000`.

    Missing or malformed fields are omitted. `address` is always included. Raises the exceptions of
    `ask` except RemoteError.
    """
    found = _SIMULATED.fullmatch(await told(ask, 'Sim,identity'))
    if found:
        simulated = '' if found[1] == 'simulated' else ' (simulated)'
        return f'{found[1]}{simulated}, {found[2]}, {address}'
    controller = await told(ask, 'GetContType')
    robot = (await told(ask, 'GetRobotInfo')).rpartition(',')[2]
    return ', '.join([*filter(_NAME.fullmatch, (controller, robot)), address])
