# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a person does at a simulated controller, in the words of `pendant`, without its process."""

import asyncio

from epson_driver.cli.pendant_words import request
from epson_driver.remote_ethernet.client import execute
from support.ros_peer import PATIENCE


def do(port: int, *words: str) -> None:
    """Do it over the remote port. Raises RemoteError if the controller refuses."""
    command = request(words).commands[0]
    asyncio.run(execute('127.0.0.1', port, [command], PATIENCE))
