# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Announces a simulated controller to the other processes of this machine, by its remote port.

The panel connects only to announced addresses and ports. An address of this machine may be a
tunnel to a real controller, where a second client could take the place of the driver.

The announcement is an abstract Unix socket. It exists as long as the process that created it, and
is visible in the same network namespace only.
"""

import socket

ANY = ('0.0.0.0', '::')  # noqa: S104 - compared only


def _name(address: str, port: int) -> str:
    return f'\0epson_driver sim_controller, remote port {port} of {address}'


def announce(address: str, port: int) -> socket.socket:
    """Announce a simulated controller until the returned socket is closed.

    address: the IP address at which it listens. Raises OSError if another process has announced a
    controller at this address and port.
    """
    result = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        result.bind(_name(address, port))
    except OSError:
        result.close()
        raise
    return result


def is_announced(address: str, port: int) -> bool:
    names = [_name(address, port)]
    if _is_local(address):
        names += [_name(wildcard, port) for wildcard in ANY]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        return any(probe.connect_ex(name) == 0 for name in names)


def _is_local(address: str) -> bool:
    family = socket.AF_INET6 if ':' in address else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, 0))
        except OSError:
            return False
    return True
