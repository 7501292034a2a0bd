# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""I/O of controllers that publish nothing: the driver asks for single points or bytes.

Which points there are is in the controller's profile, as no such controller tells it. What is out
of that is refused here, with the sentences of every other way to the I/O.
"""

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Protocol, TypeVar

from epson_driver.driver.io.io_driver import (
    MAX_POINTS,
    RETRIES,
    Io,
    IoAnswer,
    IoUnavailableError,
)
from epson_driver.driver.io.io_results import INPUTS, WORD_GROUPS, address, sentence
from epson_driver.driver.tasks import run_task_group
from epson_driver.link import Link
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.simple_message import (
    Dialect,
    IoAddress,
    IoRange,
    IoResult,
    IoSetting,
    IoType,
    IoValues,
)

BYTE_BITS = 8
WORD_BITS = 16

_log = logging.getLogger(__name__)


class RefusedPointError(Exception):
    """The controller did not do what was asked for one point, with the reason as its text.

    `passing`: it will again by itself, as when the arm stands.
    """

    def __init__(self, text: str, *, passing: bool = False) -> None:
        super().__init__(text)
        self.passing = passing


T = TypeVar('T', IoAddress, IoSetting)

Told = int | RefusedPointError
"""The value of a point, or why there is none."""


class Points(Protocol):
    """Reads and writes points within the ranges that are there, for PolledIo.

    `words`, `flags`: whether it knows groups of 16, and flags. `outputs_shown`: whether outputs
    can be read at any time.
    """

    words: bool
    flags: bool
    outputs_shown: bool
    timeout: float

    @property
    def missing(self) -> str:
        """Why it cannot be used at all, or '' if it can."""

    @property
    def place(self) -> str:
        """Host and port."""

    @property
    def link(self) -> Link | None:
        """The link of simple messages, if it is by them."""

    def follow(self, dialect: Dialect) -> None:
        """Write in the byte order and real width of the state server."""

    async def run(self, came: Callable[[], None], lost: Callable[[str], None]) -> None:
        """Serve until cancelled, reporting when the controller can be asked and when not."""

    async def read(self, addresses: Sequence[IoAddress]) -> list[Told]:
        """Return a value per address, or why there is none. Raises IoUnavailableError."""

    async def write(self, settings: Sequence[IoSetting]) -> list[Told]:
        """Set points in their order. Raises IoUnavailableError, which says which may be set."""


class PolledIo(Io):
    """The I/O of a controller that publishes nothing.

    `states` are the digital inputs and, where they can be read at any time, the digital outputs:
    asked for every `publish_period` of the profile, and after each write.
    """

    def __init__(self, points: Points, profile: IoProfile, timeout: float) -> None:
        super().__init__(points.missing or 'connecting')
        self.ranges = ranges_of(profile, words=points.words, flags=points.flags)
        self.link = points.link
        self._points = points
        self._period = profile.publish_period
        self._passing = False
        self._wake = asyncio.Event()
        shown = [IoType.DIGITAL_INPUT, *[IoType.DIGITAL_OUTPUT] * points.outputs_shown]
        self._shown = [held for held in self.ranges if held.io_type in shown]
        self.timeout = timeout

    @property
    def timeout(self) -> float:
        """How long one question may take, s."""
        return self._points.timeout

    @timeout.setter
    def timeout(self, value: float) -> None:
        self._points.timeout = value

    @property
    def used(self) -> bool:
        """Whether there is a port to connect to."""
        return not self._points.missing

    @property
    def place(self) -> str:
        """Host and port, as diagnostics name them."""
        return self._points.place

    def follow(self, dialect: Dialect) -> None:
        """Write in the byte order and real width of the state server."""
        self._points.follow(dialect)

    async def run(self) -> None:
        """Ask for the values until cancelled."""
        if not self.used:
            self._lose(self._points.missing, logging.DEBUG)
            return

        async def serve() -> None:
            await self._points.run(self._wake.set, lambda why: self._lost(IoUnavailableError(why)))

        async def nothing() -> None:
            """Do nothing, as reading moves nothing."""

        try:
            await run_task_group({'the I/O port': serve, 'asking for the I/O': self._ask}, nothing)
        finally:
            self._lose('the driver ended', logging.DEBUG)

    async def read(self, addresses: Sequence[IoAddress]) -> list[IoAnswer]:
        """Return an answer per address, in their order. Raises IoUnavailableError."""
        return await self._answers(addresses, [None] * len(addresses), self._points.read)

    async def write(self, settings: Sequence[IoSetting]) -> list[IoAnswer]:
        """Set outputs, groups and flags in order, and return one answer per setting.

        Raises IoUnavailableError, which also says if the points may have been written.
        """
        try:
            return await self._answers(
                settings, [item.value for item in settings], self._points.write
            )
        finally:
            self._wake.set()

    async def _answers(
        self,
        items: Sequence[T],
        written: Sequence[int | None],
        ask: Callable[[Sequence[T]], Awaitable[list[Told]]],
    ) -> list[IoAnswer]:
        if len(items) > MAX_POINTS:
            raise IoUnavailableError(f'{len(items)} points in one request: at most {MAX_POINTS}')
        if not self.used:
            raise IoUnavailableError(self.reason)
        results = [
            rejection(item.io_type, item.index, value, self.ranges)
            for item, value in zip(items, written, strict=True)
        ]
        good = [
            item for item, result in zip(items, results, strict=True) if result is IoResult.SUCCESS
        ]
        done = iter(await ask(good) if good else [])
        answers = []
        for item, value, result in zip(items, written, results, strict=True):
            got: Told = 0
            number = int(result)
            text = sentence(number, item.io_type, item.index, value, self.ranges)
            if result is IoResult.SUCCESS:
                got = next(done)
            if isinstance(got, RefusedPointError):
                where = address(item.io_type, item.index, value)
                number, text, got = 0, f'{where}: {got}', 0
            answers.append(
                IoAnswer(item.io_type, item.index, got if value is None else value, number, text)
            )
        return answers

    async def _ask(self) -> None:
        """Ask for the values every `publish_period`, and when woken, until cancelled."""
        await self._wake.wait()
        attempt = 0
        while True:
            try:
                self._publish(await self._values(), announce=not self._passing)
                attempt, pause = 0, self._period
            except IoUnavailableError as error:
                self._lost(error)
                pause = max(self._period, RETRIES[min(attempt, len(RETRIES) - 1)])
                attempt += 1
            self._wake.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self._wake.wait()

    async def _values(self) -> tuple[IoValues, ...]:
        """Return the values of the published ranges. Raises IoUnavailableError."""
        found = []
        for held in self._shown:
            group = IoType.GROUP_INPUT
            if held.io_type == IoType.DIGITAL_OUTPUT:
                group = IoType.GROUP_OUTPUT
            width, first = (WORD_BITS, WORD_GROUPS) if self._points.words else (BYTE_BITS, 0)
            groups = [IoAddress(group, first + k) for k in range(-(-held.count // width))]
            bits: list[int] = []
            for value in await self._points.read(groups):
                if isinstance(value, RefusedPointError):
                    raise IoUnavailableError(str(value)) from value
                bits += (value >> bit & 1 for bit in range(width))
            found.append(IoValues(held.io_type, 0, tuple(bits[: held.count])))
        return tuple(found)

    def _lost(self, error: IoUnavailableError) -> None:
        cause = error.__cause__
        self._passing = isinstance(cause, RefusedPointError) and cause.passing
        level = logging.WARNING if self.states else logging.INFO
        self._lose(str(error), logging.DEBUG if self._passing else level)


def ranges_of(profile: IoProfile, *, words: bool, flags: bool) -> tuple[IoRange, ...]:
    """Return the points of a profile that can be reached without an I/O server."""
    ranges = []
    for io_type, group, count in (
        (IoType.DIGITAL_INPUT, IoType.GROUP_INPUT, profile.digital_inputs),
        (IoType.DIGITAL_OUTPUT, IoType.GROUP_OUTPUT, profile.digital_outputs),
    ):
        ranges.append(IoRange(io_type, 0, count, 0))
        ranges.append(IoRange(group, 0, -(-count // BYTE_BITS), 0))
        if words:
            ranges.append(IoRange(group, WORD_GROUPS, -(-count // WORD_BITS), 0))
    if flags:
        ranges.append(IoRange(IoType.FLAG, 0, profile.flags, 0))
    return tuple(held for held in ranges if held.count)


def rejection(io_type: int, index: int, value: int | None, ranges: Sequence[IoRange]) -> IoResult:
    """Return SUCCESS, or why a point is not read, or not written with `value`."""
    held = [each for each in ranges if each.io_type == io_type]
    if not held:
        return IoResult.TYPE_UNSUPPORTED
    if not any(each.start <= index < each.start + each.count for each in held):
        return IoResult.INDEX_OUT_OF_RANGE
    if value is None:
        return IoResult.SUCCESS
    if io_type in INPUTS:
        return IoResult.TYPE_FEATURE_UNSUPPORTED
    most = 1 if io_type != IoType.GROUP_OUTPUT else _most(index, ranges)
    return IoResult.SUCCESS if 0 <= value <= most else IoResult.VALUE_OUT_OF_RANGE


def _most(group: int, ranges: Sequence[IoRange]) -> int:
    """Return the largest value of a group of outputs: of the points that there are."""
    width = WORD_BITS if group >= WORD_GROUPS else BYTE_BITS
    first = group % WORD_GROUPS * width
    (outputs,) = (held.count for held in ranges if held.io_type == IoType.DIGITAL_OUTPUT)
    return int((1 << min(width, outputs - first)) - 1)
