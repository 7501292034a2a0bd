# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Starts the discovery server of Fast DDS, which comes with it: nothing of it is ours."""

import os
import shutil
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

from epson_driver.processes.processes import Process, RunError

PROGRAM = 'fast-discovery-server'
VARIABLE = 'ROS_DISCOVERY_SERVER'
"""Whoever has it in its environment, HOST:PORT, asks that server who is there."""

USUAL_PORT = 11811


def program() -> str:
    """Return the path of the program. Raises RunError that says where it comes from."""
    beside = Path(sys.executable).with_name(PROGRAM)  # in an environment made by pip
    found = str(beside) if beside.is_file() else shutil.which(PROGRAM)
    if found is None:
        raise RunError(
            f'no {PROGRAM}: it comes with Fast DDS (source a ROS 2 workspace; apt install '
            'ros-jazzy-fastrtps)'
        )
    return found


def free_port(address: str = '127.0.0.1') -> int:
    """Return a UDP port of this machine that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((address, 0))
        port: int = probe.getsockname()[1]
    return port


def discovery_server(
    log: Path, address: str, port: int = USUAL_PORT, *, run: Sequence[str] = ()
) -> Process:
    """Start a server on an address of this machine, with the words `run` before the command.

    Nobody has to wait for it: who asks it asks again. Raises RunError if there is no such program.
    """
    arguments = ['-i', '0', '-l', address, '-p', str(port)]
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    return Process(program(), arguments, log, environment, run)
