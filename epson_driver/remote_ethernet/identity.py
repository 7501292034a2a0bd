# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whom one talks to over the remote port: what kind of controller, which robot, where.

The simulated controller says all of it (`$Sim,identity`). A real one is asked what it is called
(`$GetContType`, `$GetRobotInfo`); an older one that does not know these is known by its address.
"""

import re

from epson_driver.remote_ethernet.client import Ask, RemoteError

_SIMULATED = re.compile(r'controller=(.{1,64});robot=(.{1,64})')
_NAME = re.compile(r'(?=.*[A-Za-z])[A-Za-z0-9 ._+/-]{1,64}')


async def identity(ask: Ask, address: str) -> str:
    """Return who answers, such as `spel (simulated), c3_a601s, 127.0.0.1:5000`.

    What it does not tell, or what cannot be a name, is left out; `address` is always there.
    Raises what `ask` does, but for RemoteError.
    """
    found = _SIMULATED.fullmatch(await _told(ask, 'Sim,identity'))
    if found:
        simulated = '' if found[1] == 'simulated' else ' (simulated)'
        return f'{found[1]}{simulated}, {found[2]}, {address}'
    controller = await _told(ask, 'GetContType')
    robot = (await _told(ask, 'GetRobotInfo')).rpartition(',')[2]
    return ', '.join([*filter(_NAME.fullmatch, (controller, robot)), address])


async def _told(ask: Ask, command: str) -> str:
    """Return the value of the answer, or '' if the controller refuses the command."""
    try:
        return await ask(command)
    except RemoteError:
        return ''
