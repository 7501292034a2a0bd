# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller of a Robot, in a separate process, and operator actions on it."""

import asyncio
import contextlib
import signal
from collections.abc import Callable, Sequence
from typing import TextIO

from epson_driver.api.errors import RobotError, checked_arguments
from epson_driver.api.ownership import Unique
from epson_driver.inputs import Rule, choice, count
from epson_driver.processes.command import module_command
from epson_driver.remote_ethernet.client import connected
from epson_driver.remote_ethernet.hand import RefusedError, action, do

START_TIMEOUT_S = 60.0
"""Timeout for the start of the process, s. The process loads numpy and starts a planner."""

END_TIMEOUT_S = 5.0
"""Timeout for the end of the process, s. After it, the process is killed."""

MAX_CHARACTERS = 4096
"""Number of characters of the controller's output that are stored for error messages."""

ANSWER_TIMEOUT_S = 5.0
"""Reply timeout for an operator action, s."""

_WORDS = {'motion', 'state', 'io', 'remote'}


class SimulatedController:
    """Runs `sim_controller` as a separate process, on free ports of this machine.

    The process runs in a separate session, so Ctrl-C does not reach it. It ends together with this
    process, because it watches its standard input. `log`: where to write its stderr.
    """

    def __init__(self, arguments: Sequence[str], log: TextIO | None = None) -> None:
        self._arguments = arguments
        self._log = log
        self._process: asyncio.subprocess.Process | None = None
        self._reported = ''
        self._listening: asyncio.Task[None] | None = None

    @property
    def files(self) -> list[int]:
        """File descriptor of the pipe that keeps the process alive, or [] if no process runs."""
        stdin = None if self._process is None else self._process.stdin
        return [] if stdin is None else [stdin.get_extra_info('pipe').fileno()]

    async def start(self) -> dict[str, int]:
        """Start the process and return its ports by argument name, such as `motion_port`."""
        words = [f'--{name}-port=0' for name in sorted({*_WORDS, 'rtmc'})]
        process = self._process = await asyncio.create_subprocess_exec(
            *module_command('epson_driver.cli', 'sim_controller', '--until-stdin-ends'),
            *words,
            *self._arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdout is not None  # noqa: S101 - for the type checker
        assert process.stderr is not None  # noqa: S101 - for the type checker
        self._reported = ''
        self._listening = asyncio.create_task(self._listen(process.stderr))
        try:
            async with asyncio.timeout(START_TIMEOUT_S):
                line = (await process.stdout.readline()).decode(errors='replace')
        except TimeoutError as error:
            raise RobotError(
                f'the simulated controller did not listen within {START_TIMEOUT_S:g} s'
            ) from error
        if not line.startswith('listening '):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(END_TIMEOUT_S):
                    await asyncio.shield(self._listening)
            message = self._reported.strip().rpartition('\n')[2] or 'no output'
            why = message.removeprefix('epson_driver sim_controller: ').removeprefix('error: ')
            raise RobotError(f'the simulated controller did not start: {why}')
        numbers = dict(word.split('=') for word in line.split()[1:])
        return {f'{name}_port': int(numbers[name]) for name in _WORDS}

    async def _listen(self, stream: asyncio.StreamReader) -> None:
        """Read the process's stderr, so that it never blocks on a full pipe."""
        while block := await stream.read(2**16):
            text = block.decode(errors='replace')
            self._reported = (self._reported + text)[-MAX_CHARACTERS:]
            if self._log is not None:
                self._log.write(text)

    async def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None:
            return
        if self._listening is not None:
            self._listening.cancel()
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


INPUT = choice('DI', 'AI')
INDEX = count(0, 65_535)
VALUE = count(-(2**31), 2**31 - 1)
WORDS = Rule(str.split, "must be a string, such as 'cut for=0.5'")


class Simulation(Unique):
    """Operator actions at a simulated controller. At a real one, they raise RobotError."""

    def __init__(self, port: Callable[[], int]) -> None:
        self._port = port

    @checked_arguments
    async def estop(self, pressed: bool = True) -> None:
        """Press or release the E-stop button. The E-stop stays active until `Robot.reset`."""
        await self._do(f'estop {"press" if pressed else "release"}')

    @checked_arguments
    async def door(self, is_open: bool = True) -> None:
        """Open or close the safeguard door.

        `go_on` resumes the tasks that an open door has paused.
        """
        await self._do(f'door {"open" if is_open else "close"}')

    async def go_on(self) -> None:
        """Continue the paused tasks, like Continue at the controller."""
        await self._do('continue')

    @checked_arguments
    async def input(self, index: int, value: int = 1, *, kind: str = 'DI') -> None:
        """Set an input of the controller: DI to 0 or 1, or AI to a value in mV."""
        number = VALUE.checked(int(value) if isinstance(value, bool) else value, 'value')
        point = f'{INPUT.checked(str(kind).upper(), "kind")} {INDEX.checked(index, "index")}'
        await self._do(f'io {point} {number}')

    @checked_arguments
    async def fault(self, text: str) -> None:
        """Start a fault, such as 'cut for=0.5', or end all faults with 'clear'.

        docs/controller.md lists the faults.
        """
        await self._do(' '.join(['fault', *WORDS.checked(text, 'text')]))

    async def _do(self, words: str) -> None:
        port = self._port()
        try:
            async with connected('127.0.0.1', port, ANSWER_TIMEOUT_S) as ask:
                await do(ask, action(words))
        except RefusedError as error:
            raise RobotError(str(error)) from error
        except (ConnectionError, TimeoutError, ValueError) as error:
            raise RobotError(f'the simulated controller does not answer: {error}') from error
