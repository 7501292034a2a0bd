# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner in a separate process, so that planning never delays the motion cycle.

If the process dies or stalls, the pending request gets no plan, the controller is notified, and
the process is restarted.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import PASSED_TYPES, Request
from epson_driver.processes.worker import (
    end_worker,
    ending,
    next_value,
    packed,
    start_worker,
)
from epson_driver.sim_controller.arm.streaming import Answer

START_TIMEOUT_S = 60.0  # the start takes about 0.5 s on an idle machine
PLAN_TIMEOUT_S = 5.0  # the process is then killed
RESTART_DELAY_S = 1.0
EXIT_TIMEOUT_S = 0.5  # maximum time from the end of its pipe to its exit, s
WORKER = 'epson_driver.sim_controller.arm.planner_worker'

_log = logging.getLogger(__name__)


class PlannerError(RuntimeError):
    """The planner could not be started, or has ended. The text gives the reason."""


class PlannerProcess:
    """Planner in a child process, used from the event loop."""

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._child: _Child | None = None
        self._answer: Answer | None = None
        self._watchdog: asyncio.TimerHandle | None = None

    @property
    def ready(self) -> bool:
        return self._child is not None

    @property
    def pid(self) -> int | None:
        return None if self._child is None else self._child.pid

    async def start(self) -> None:
        """Start the process and wait until it is ready. Raises PlannerError if this fails."""
        child = await _Child.started()
        try:
            async with asyncio.timeout(START_TIMEOUT_S):
                child.send(self._limits)
                await child.receive()
        except TimeoutError:
            raise PlannerError(
                f'the motion planner did not start within {START_TIMEOUT_S:g} s'
            ) from None
        except PlannerError as error:
            raise PlannerError(f'the motion planner {error}') from None
        else:
            self._child = child
        finally:
            if self._child is not child:
                await child.end()

    def ask(self, request: Request, limits: JointLimits, answer: Answer) -> None:
        """Request a plan, with which `answer` is called later, or with None if planning fails.

        Raises RuntimeError if another request is pending or the planner is not ready.
        """
        if self._answer is not None:
            raise RuntimeError('the planner already has a request')
        if self._child is None:
            raise RuntimeError('the planner is not ready')
        self._answer = answer
        self._watchdog = asyncio.get_running_loop().call_later(
            PLAN_TIMEOUT_S, self._child.kill_hung
        )
        previous, self._limits = self._limits, limits
        self._child.send((request, None if limits is previous else limits))

    async def run(
        self,
        failed: Callable[[str], None],
        present: Callable[[], AbstractContextManager[object]] = nullcontext,
    ) -> None:
        """Pass each plan to the caller of `ask`. Restart the process whenever it ends.

        `failed` is called with the reason after each end of the process. All calls are made within
        `present()`, which first advances the controller to the current time.
        """
        while True:
            if self._child is None:
                await self._restart()
            else:
                try:
                    plan = await self._child.receive()
                except PlannerError as error:
                    await self.close()
                    with present():
                        self._deliver(None)
                        failed(str(error))
                else:
                    with present():
                        self._deliver(plan)

    async def close(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            await child.end()

    async def _restart(self) -> None:
        await asyncio.sleep(RESTART_DELAY_S)
        try:
            await self.start()
        except PlannerError as error:
            _log.error('%s', error)
        else:
            _log.info('the motion planner has recovered')

    def _deliver(self, plan: Any) -> None:
        answer, self._answer = self._answer, None
        if self._watchdog is not None:
            self._watchdog.cancel()
        if answer is not None:
            answer(plan)


class _Child:
    def __init__(self, process: asyncio.subprocess.Process) -> None:
        if process.stdin is None or process.stdout is None or process.stderr is None:
            raise ValueError('the planner process was started without pipes')
        self._process = process
        self._requests = process.stdin
        self._answers = process.stdout
        self._log_task = asyncio.create_task(_log_lines(process.stderr))
        self._timed_out = False

    @classmethod
    async def started(cls) -> '_Child':
        try:
            process = await start_worker(WORKER, asyncio.subprocess.PIPE)
        except OSError as error:
            raise PlannerError(f'the motion planner cannot be started: {error}') from error
        return cls(process)

    @property
    def pid(self) -> int:
        return self._process.pid

    def send(self, value: object) -> None:
        self._requests.write(packed(value))

    async def receive(self) -> Any:
        """Return the next plan. Raises PlannerError if the process exits or sends bad bytes."""
        try:
            return await next_value(self._answers, PASSED_TYPES)
        except (OSError, EOFError):
            raise PlannerError(await self._exit_reason()) from None
        except ValueError as error:
            raise PlannerError(f'sent {error}') from error

    def kill_hung(self) -> None:
        self._timed_out = True
        self._kill()

    async def end(self) -> None:
        await end_worker(self._process)
        await self._log_task

    async def _exit_reason(self) -> str:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(EXIT_TIMEOUT_S):
                await self._process.wait()
        code = self._process.returncode
        if self._timed_out:
            return f'did not reply within {PLAN_TIMEOUT_S:g} s'
        if code is None:
            return 'closed its pipe'
        return ending(code)

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()


async def _log_lines(stream: asyncio.StreamReader) -> None:
    with contextlib.suppress(OSError, ValueError):
        while line := await stream.readline():
            _log.warning('planner: %s', line.decode(errors='replace').rstrip())
