# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's I/O without ROS: polling of all values, and access by address (docs/io.md).

I/O is independent of motion and state. Without I/O in the controller, or while its I/O server does
not run, requests fail with this reason.
"""

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from epson_driver.driver.io.message_io import MotomanIo, RealTimeIo, ServerIo
from epson_driver.driver.io.points import (
    GROUPS,
    WORD_GROUPS,
    Backend,
    IoUnavailableError,
    PointReply,
    packed,
    ranges_of,
    rejection,
    shown,
)
from epson_driver.driver.tasks import Notification, run_task_group
from epson_driver.link import Link
from epson_driver.link.rtmc_link import RtmcLink
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.client import (
    Ask,
    Login,
    RemoteError,
    RemoteErrorNumber,
    RemoteTurns,
    logged_in,
)
from epson_driver.simple_message import ByteOrder, IoAddress, IoRange, IoResult, IoSetting, IoType
from epson_driver.simple_message.io_messages import IoValues

NOT_READY = (
    'not ready (error 20): the controller accepts this only in AUTO, at rest, without running '
    'tasks and without an error'
)

HEXADECIMAL, DECIMAL = 16, 10

READ: dict[IoType, str] = {
    IoType.DIGITAL_INPUT: 'GetIO,{}',
    IoType.DIGITAL_OUTPUT: 'Execute,"Print Oport({})"',
    IoType.FLAG: 'GetMemIO,{}',
}

READ_GROUP = {  # groups of 8 bits, of 16 bits
    IoType.GROUP_INPUT: ('GetIOByte,{}', 'GetIOWord,{}'),
    IoType.GROUP_OUTPUT: ('Execute,"Print Out({})"', 'Execute,"Print OutW({})"'),
}

WRITE = {IoType.DIGITAL_OUTPUT: 'SetIO,{},{}', IoType.FLAG: 'SetMemIO,{},{}'}

WRITE_GROUP = ('SetIOByte,{},{:02X}', 'SetIOWord,{},{:04X}')  # 8 bits, 16 bits


class RemoteEthernetIo(Backend):
    shown = (IoType.DIGITAL_INPUT,)

    def __init__(
        self, host: str, port: int, turns: RemoteTurns, login: Login | None, profile: IoProfile
    ) -> None:
        self.ranges = ranges_of(profile, words=True, flags=True)
        self._address = f'{host}:{port}'
        self._login = login or partial(logged_in, host, port, max_logins=1)
        self._turns = turns

    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[PointReply]:
        return await self._execute([_reading(item) for item in addresses], timeout)

    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[PointReply]:
        return await self._execute([_writing(item) for item in settings], timeout)

    async def _execute(self, commands: Sequence[str], timeout: float) -> list[PointReply]:
        async def dialogue() -> list[PointReply]:
            async with self._login(timeout * (1 + len(commands))) as ask:
                return [await _reply(ask, command, timeout) for command in commands]

        try:
            return await self._turns.patient(dialogue)
        except (RemoteError, OSError, TimeoutError) as error:
            why = str(error) or f'no answer within {timeout:g} s'
            raise IoUnavailableError(f'remote port {self._address}: {why}', sent=True) from error


async def _reply(ask: Ask, command: str, timeout: float) -> PointReply:
    try:
        async with asyncio.timeout(timeout):
            answer = await ask(command)
    except RemoteError as error:
        if error.number == RemoteErrorNumber.NOT_READY:
            return PointReply(result=0, why=NOT_READY)
        passing = error.number == RemoteErrorNumber.EXECUTING
        return PointReply(result=0, why=str(error), passing=passing)
    base = DECIMAL if command.startswith('Execute') else HEXADECIMAL
    try:
        return PointReply(int(answer.strip('" '), base))
    except ValueError as error:
        raise ConnectionError(f"'{answer[:40]}' is not a reply to {command}") from error


def _reading(item: IoAddress) -> str:
    io_type = IoType(item.io_type)
    if io_type in READ:
        return READ[io_type].format(item.index)
    size, port = divmod(item.index, WORD_GROUPS)
    return READ_GROUP[io_type][size].format(port)


def _writing(item: IoSetting) -> str:
    io_type = IoType(item.io_type)
    if io_type in WRITE:
        return WRITE[io_type].format(item.index, item.value)
    size, port = divmod(item.index, WORD_GROUPS)
    return WRITE_GROUP[size].format(port, item.value)


MAX_POINTS = 1024  # maximum number of points in one request, from the protocol
MAX_POLLED = 60  # points per polling request: servers with a small buffer accept no more

RETRIES = (0.2, 0.5, 1.0, 2.0, 5.0)  # delays after successive failed polls, s

T = TypeVar('T', IoAddress, IoSetting)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class IoAnswer:
    """Result for one point. `result`: an IoResult, or 0 if `text` contains another error."""

    io_type: int
    index: int
    value: int
    result: int
    text: str


class Io:
    """Reads, writes and polls the I/O of one controller while `run` runs.

    * `states`: values of all points that can be read at any time, except flags. They are polled
      every `period` s and after each write. While they are unknown, `states` is ().
    * `reason`: why the values are unknown, or ''.
    * `on_states`: called in the event loop when `states` has changed. After it, `changed` is
      notified.
    * `place`: host and port, for diagnostics.
    * `timeout`: reply timeout, s, which may be changed at any time.
    * `missing`: why I/O is not available at all, or ''.
    """

    def __init__(
        self, backend: Backend, place: str, missing: str, period: float, timeout: float
    ) -> None:
        self.states: tuple[IoValues, ...] = ()
        self.reason = missing or 'connecting'
        self.on_states: Callable[[], None] = lambda: None
        self.changed = Notification()
        self.link = backend.link
        self.place = place
        self.timeout = timeout
        self.used = not missing
        self._backend = backend
        self._period = period
        self._reported = False
        self._passing = False
        self._wake = asyncio.Event()
        backend.wake = self._wake.set
        self.follow = backend.follow

    @property
    def ranges(self) -> tuple[IoRange, ...] | None:
        return self._backend.ranges

    async def run(self) -> None:
        if not self.used:
            self._lose(self.reason, logging.DEBUG)
            return

        async def nothing() -> None:
            """Do nothing, because reading causes no motion that must be stopped."""

        parts = {'querying the I/O': self._poll}
        if self.link is None:
            self._wake.set()
        else:
            parts['the I/O port'] = self.link.run
        try:
            await run_task_group(parts, nothing)
        finally:
            self._lose('the driver ended', logging.DEBUG)

    async def read(self, addresses: Sequence[IoAddress]) -> list[IoAnswer]:
        return await self._answers(addresses, [None] * len(addresses), self._backend.read)

    async def write(self, settings: Sequence[IoSetting]) -> list[IoAnswer]:
        """Set outputs, groups and flags in order, and return a result for each setting.

        Raises IoUnavailableError if the request fails. Its text contains a warning if points may
        have been written.
        """
        try:
            values = [item.value for item in settings]
            return await self._answers(settings, values, self._backend.write)
        except IoUnavailableError as error:
            if not error.sent:
                raise
            raise IoUnavailableError(f'{error}; the points may have been written') from error
        finally:
            self._wake.set()

    async def _answers(
        self,
        items: Sequence[T],
        values: Sequence[int | None],
        request: Callable[[Sequence[T], float], Awaitable[list[PointReply]]],
    ) -> list[IoAnswer]:
        """Send those items of a request that are valid. Return a result for every item."""
        if len(items) > MAX_POINTS:
            raise IoUnavailableError(f'{len(items)} points in one request: at most {MAX_POINTS}')
        if not self.used:
            raise IoUnavailableError(self.reason)
        ranges = self.ranges
        checks = [
            IoResult.SUCCESS
            if ranges is None
            else rejection(item.io_type, item.index, value, ranges)
            for item, value in zip(items, values, strict=True)
        ]
        valid = [
            item for item, check in zip(items, checks, strict=True) if check is IoResult.SUCCESS
        ]
        replies = iter(await request(valid, self.timeout) if valid else [])
        answers = []
        for item, value, check in zip(items, values, checks, strict=True):
            reply = next(replies) if check is IoResult.SUCCESS else PointReply(result=check)
            text = reply.text(item.io_type, item.index, value, self.ranges or ())
            result_value = reply.value if value is None else value
            answers.append(IoAnswer(item.io_type, item.index, result_value, reply.result, text))
        return answers

    async def _poll(self) -> None:
        """Poll the values every `period` s, after each write, and when the link changes.

        The connection stays open even without replies, because the controller may set its outputs
        to safe values when the connection closes.
        """
        await self._wake.wait()
        attempt = 0
        while True:
            self._wake.clear()
            try:
                self._publish(*await self._values())
                attempt, pause = 0, self._period
            except IoUnavailableError as error:
                self._passing = error.passing
                level = logging.WARNING if self.states else logging.INFO
                self._lose(str(error), logging.DEBUG if self._passing else level)
                pause = max(self._period, RETRIES[min(attempt, len(RETRIES) - 1)])
                attempt += 1
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self._wake.wait()

    async def _values(self) -> tuple[tuple[IoValues, ...], str]:
        """Read all ranges. Return the values, and the first error of an unreadable range or ''."""
        backend = self._backend
        await backend.find_ranges(self.timeout)
        ranges = backend.ranges or ()
        requested = list(shown(ranges, backend.shown, grouped=backend.grouped))
        points = [address for _, _, addresses in requested for address in addresses]
        replies: list[PointReply] = []
        for first in range(0, len(points), MAX_POLLED):
            replies += await backend.read(points[first : first + MAX_POLLED], self.timeout)
        values: dict[IoRange, tuple[int, ...]] = {}
        why, passing, first = '', False, 0
        for block, width, addresses in requested:
            part = replies[first : first + len(addresses)]
            first += len(addresses)
            texts = [
                reply.text(address.io_type, address.index, None, ranges)
                for reply, address in zip(part, addresses, strict=True)
            ]
            if any(texts):
                why = why or next(filter(None, texts))
                passing = any(reply.passing for reply in part)
                continue
            if width == 1:
                values[block] = tuple(reply.value for reply in part)
                continue
            bits = [reply.value >> bit & 1 for reply in part for bit in range(width)]
            values[block] = tuple(bits[: block.count])
            group = GROUPS[IoType(block.io_type)]
            for item in ranges:
                if item.io_type == group:
                    values[item] = packed(item, values[block])
        if not values:
            why = why or 'the controller has no readable I/O'
            raise IoUnavailableError(why, passing=passing)
        return tuple(
            IoValues(item.io_type, item.start, values[item]) for item in ranges if item in values
        ), why

    def _publish(self, states: tuple[IoValues, ...], missing: str) -> None:
        if states == self.states:
            return
        if not self.states and not self._passing:
            points = sum(len(item.values) for item in states)
            more = f', partly unreadable: {missing}' if missing else ''
            _log.info('I/O: %d points in %d ranges%s', points, len(states), more)
        self._passing = False
        self.states = states
        self.reason = ''
        self._reported = False
        self._notify()

    def _lose(self, why: str, level: int) -> None:
        """Record why the values are unknown. Log and publish this once, until they are known."""
        self.states = ()
        self.reason = why
        if not self._reported:
            self._reported = True
            _log.log(level, '%s', why)
            self._notify()

    def _notify(self) -> None:
        self.on_states()
        self.changed.notify_all()


def make_io(
    profile: IoProfile,
    host: str,
    ports: tuple[int, int],
    *,
    byte_order: ByteOrder | None,
    timeout: float,
    turns: RemoteTurns,
    login: Login | None = None,
    motion_link: Link | None = None,
) -> Io:
    """Return the I/O client for a profile. `ports`: I/O port and remote port, 0 if unused."""
    port, remote_port = ports
    missing = 'I/O is not used: its port is 0'
    backend: Backend
    if isinstance(motion_link, RtmcLink):
        port, backend = motion_link.port, RealTimeIo(motion_link, profile)
    elif profile.access == 'server':
        backend = ServerIo(host, port, byte_order)
    elif profile.access == 'motoman':
        backend = MotomanIo(host, port, byte_order, profile)
    else:
        port, missing = remote_port, 'I/O is not used: the port of Remote Ethernet is 0'
        backend = RemoteEthernetIo(host, port, turns, login, profile)
    place = f'{host}:{port}'
    return Io(backend, place, '' if port else missing, profile.publish_period, timeout)
