# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated controller as a process of its own, for Robot.simulated()."""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Sequence

from epson_driver.api.errors import RobotError
from epson_driver.api.settings import Ports

START_TIMEOUT_S = 60.0
"""How long it may take to listen, s: it loads numpy, and starts a planner."""

END_TIMEOUT_S = 5.0
"""How long it may take to end before it is killed, s."""

_WORDS = {'motion', 'state', 'io', 'remote'}


class SimulatedController:
    """Runs `sim_controller` on free ports of this machine, with these arguments.

    It has a session of its own: Ctrl-C is for the program that drives it. It ends with `close`,
    and when this process ends, however that happens, as it watches its standard input.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self._arguments = arguments
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> Ports:
        """Start it; return its ports when it listens. Raises RobotError with what it said."""
        words = [f'--{name}-port=0' for name in sorted(_WORDS)]
        process = self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            '-m',
            'epson_driver.cli',
            'sim_controller',
            '--until-stdin-ends',
            *words,
            *self._arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            env=os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
        )
        assert process.stdout is not None  # noqa: S101 - for the type checker
        try:
            async with asyncio.timeout(START_TIMEOUT_S):
                line = (await process.stdout.readline()).decode(errors='replace')
        except TimeoutError as error:
            raise RobotError(
                f'the simulated controller did not listen within {START_TIMEOUT_S:g} s'
            ) from error
        if not line.startswith('listening '):
            raise RobotError(
                'the simulated controller did not start; this shows why: epson_driver '
                f'sim_controller {" ".join(self._arguments)}'
            )
        numbers = dict(word.split('=') for word in line.split()[1:])
        return Ports(**{name: int(numbers[name]) for name in _WORDS})

    async def close(self) -> None:
        """End it."""
        process, self._process = self._process, None
        if process is None:
            return
        if process.stdin is not None:
            process.stdin.close()
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
        try:
            async with asyncio.timeout(END_TIMEOUT_S):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
