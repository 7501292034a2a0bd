# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's I/O without ROS: a link of its own, requests by address, and the newest values.

Nothing here touches the motion or the state: a controller without I/O, or one whose I/O server
does not run at the moment, is a reason that requests are answered with. docs/io.md has the rules.
"""

import asyncio
import contextlib
import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from epson_driver.driver.io.io_results import sentence
from epson_driver.driver.tasks import Notification, report_task_error
from epson_driver.link import Link, LinkState
from epson_driver.simple_message import (
    ByteOrder,
    CommType,
    Dialect,
    IoAddress,
    IoFeature,
    IoInfo,
    IoInfoReply,
    IoPublish,
    IoRange,
    IoRead,
    IoReadReply,
    IoResult,
    IoSetting,
    IoSpan,
    IoSubscribe,
    IoSubscribeReply,
    IoValues,
    IoWrite,
    IoWriteReply,
    Message,
    Packet,
    ReplyCode,
)

MAX_POINTS = 1024
"""Points in one request: the limit of the protocol."""

RETRIES = (0.2, 0.5, 1.0, 2.0, 5.0)
"""Pauses before subscribing is tried again on one connection, s; the last one from then on."""

MAX_MESSAGE_ID = 2**31 - 1

NOT_USED = 'I/O is not used: its port is 0'
REFUSED = (
    'the controller refused the I/O request: its I/O server does not run now (E-stop, stop or '
    'pause), or it does not know I/O requests'
)

Key = tuple[int, int]
"""Type and first index of a range."""

R = TypeVar('R', IoInfoReply, IoReadReply, IoWriteReply, IoSubscribeReply)

_log = logging.getLogger(__name__)


class IoUnavailableError(RuntimeError):
    """A request without any answer, with the reason as its text."""


@dataclass(frozen=True, slots=True)
class IoAnswer:
    """One point of a request: `result` is an IoResult's number, `text` '' or why not."""

    io_type: int
    index: int
    value: int
    result: int
    text: str


class Io(ABC):
    """Reads, writes and watches the I/O of one controller. `run` until cancelled.

    `states` are the values of all ranges that the controller publishes, () while they are not
    known; `reason` then says why, and is '' otherwise. `ranges` are the points that there are.
    `on_states` is called (in the event loop) after `states` changed, and once when they are not
    known any more; `changed` is notified then, too.
    """

    timeout: float
    """How long an answer may take, s. It may be changed at any time."""

    def __init__(self, reason: str) -> None:
        self.states: tuple[IoValues, ...] = ()
        self.reason = reason
        self.ranges: tuple[IoRange, ...] = ()
        self.on_states: Callable[[], None] = lambda: None
        self.changed = Notification()
        self._told = False

    @property
    @abstractmethod
    def used(self) -> bool:
        """Whether there is a port to connect to."""

    @property
    @abstractmethod
    def place(self) -> str:
        """Host and port, as diagnostics name them."""

    link: Link | None
    """The link of simple messages, if it is by them."""

    @abstractmethod
    async def run(self) -> None:
        """Serve until cancelled."""

    @abstractmethod
    def follow(self, dialect: Dialect) -> None:
        """Write in the byte order and real width of the state server."""

    @abstractmethod
    async def read(self, addresses: Sequence[IoAddress]) -> list[IoAnswer]:
        """Return an answer per address, in their order. Raises IoUnavailableError."""

    @abstractmethod
    async def write(self, settings: Sequence[IoSetting]) -> list[IoAnswer]:
        """Set outputs, groups and flags in order, and return one answer per setting.

        Raises IoUnavailableError, which also says if the points may have been written.
        """

    def _publish(self, states: tuple[IoValues, ...], *, announce: bool = True) -> None:
        """Publish new values. `announce`: log how many there are, if they were not known."""
        if states == self.states:
            return
        if not self.states and announce:
            points = sum(len(item.values) for item in states)
            _log.info('I/O: %d points in %d ranges', points, len(states))
        self.states = states
        self.reason = ''
        self._told = False
        self._notify()

    def _lose(self, why: str, level: int = logging.INFO) -> None:
        """Take note that the values are not known, and log it once until they are known again."""
        self.states = ()
        self.reason = why
        if not self._told:
            self._told = True
            _log.log(level, '%s', why)
            self._notify()

    def _notify(self) -> None:
        self.on_states()
        self.changed.notify_all()


class IoDriver(Io):
    """The I/O of a controller with an I/O server. A port of 0 is not used.

    `timeout`: also how old published values may become, s.
    """

    link: Link

    def __init__(
        self, host: str, port: int, *, byte_order: ByteOrder | None, timeout: float
    ) -> None:
        super().__init__('connecting' if port else NOT_USED)
        self.timeout = timeout
        self.link = Link(
            'io',
            host,
            port,
            on_packet=self._on_packet,
            on_state=self._on_link,
            byte_order=byte_order,
            quiet=True,
        )
        self._dialect_known = asyncio.Event()
        if byte_order is not None:
            self._dialect_known.set()
        self._last_id = 0
        self._asked: dict[asyncio.Future[Packet], None] = {}
        self._subscribed: dict[Key, int] = {}
        self._values: dict[Key, IoValues] = {}
        self._published = -math.inf
        self._watch: asyncio.Task[None] | None = None

    @property
    def used(self) -> bool:
        """Whether there is a port to connect to."""
        return bool(self.link.port)

    @property
    def place(self) -> str:
        """Host and port, as diagnostics name them."""
        return f'{self.link.host}:{self.link.port}'

    async def run(self) -> None:
        """Keep the link and the subscription alive until cancelled."""
        if not self.used:
            self._lose(NOT_USED, logging.DEBUG)
            return
        try:
            await self.link.run()
        finally:
            if self._watch is not None:
                await asyncio.gather(self._watch, return_exceptions=True)

    def follow(self, dialect: Dialect) -> None:
        """Write in the state server's byte order: the I/O port shows its own only in a reply."""
        self.link.follow(dialect)
        self._dialect_known.set()

    async def read(self, addresses: Sequence[IoAddress]) -> list[IoAnswer]:
        """Return an answer per address, in their order. Raises IoUnavailableError."""
        _check_number(len(addresses))
        reply = await self._ask(IoRead(self._next_id(), tuple(addresses)), IoReadReply)
        _check_addresses(reply.items, [(item.io_type, item.index) for item in addresses])
        return [
            self._answer(item.io_type, item.index, item.value, item.result, None)
            for item in reply.items
        ]

    async def write(self, settings: Sequence[IoSetting]) -> list[IoAnswer]:
        """Set outputs, groups and flags in order, and return one answer per setting.

        Raises IoUnavailableError, which also says if the points may have been written.
        """
        _check_number(len(settings))
        message = IoWrite(self._next_id(), tuple(settings))
        reply = await self._ask(message, IoWriteReply, '; the points may have been written')
        _check_addresses(reply.items, [(item.io_type, item.index) for item in settings])
        return [
            self._answer(item.io_type, item.index, item.value, outcome.result, item.value)
            for item, outcome in zip(settings, reply.items, strict=True)
        ]

    def _answer(
        self, io_type: int, index: int, value: int, result: int, written: int | None
    ) -> IoAnswer:
        text = sentence(result, io_type, index, written, self.ranges)
        return IoAnswer(io_type, index, value, result, text)

    def _next_id(self) -> int:
        """Return 1, 2, … and 1 again. Not an itertools.cycle: that keeps all it has returned."""
        self._last_id = self._last_id % (MAX_MESSAGE_ID - 1) + 1
        return self._last_id

    async def _ask(self, message: Message, kind: type[R], unsure: str = '') -> R:
        """Return the reply to a request. Raises IoUnavailableError, with `unsure` if it was sent.

        A FAILURE carries no message_id, so it is taken for the oldest request of its type; one
        that was waited for long enough is given up, so that it takes no later one's place.
        """
        if not self.link.connected:
            raise IoUnavailableError(self.reason)
        answer: asyncio.Future[Packet] = asyncio.get_running_loop().create_future()

        def on_reply(packet: Packet, _now: float) -> None:
            if not answer.done():
                answer.set_result(packet)

        try:
            waiting = self.link.post(message, on_reply)
        except ConnectionError as error:
            raise IoUnavailableError(f'the I/O request could not be sent: {error}') from error
        self._asked[answer] = None
        try:
            async with asyncio.timeout(self.timeout):
                packet = await answer
        except TimeoutError as error:
            self.link.give_up(waiting)
            text = f'no reply from the I/O server within {self.timeout:g} s{unsure}'
            raise IoUnavailableError(text) from error
        except ConnectionError as error:
            raise IoUnavailableError(f'{error}{unsure}') from error
        finally:
            del self._asked[answer]
        if packet.reply_code is not ReplyCode.SUCCESS:
            raise IoUnavailableError(REFUSED)
        reply = packet.message
        if not isinstance(reply, kind):
            raise IoUnavailableError(f'the reply of the I/O server makes no sense{unsure}')
        return reply

    # --- the values -------------------------------------------------------------------------

    async def _keep_subscribed(self) -> None:
        """Subscribe on a new connection, and again after each silence, until cancelled.

        A connection is kept even when nothing comes: the controller's outputs may fall to their
        safe values with it, and only the controller knows why it is silent (E-stop, pause).
        """
        if not self._dialect_known.is_set():
            with contextlib.suppress(TimeoutError):  # no state message: then as it is
                async with asyncio.timeout(self.timeout):
                    await self._dialect_known.wait()
        attempt = 0
        while True:
            try:
                if self._left() <= 0.0:
                    await self._subscribe()
                attempt = 0
                while (left := self._left()) > 0.0:  # noqa: ASYNC110 - until it is too old
                    await asyncio.sleep(left)
                raise IoUnavailableError(f'no values from the I/O server for {self.timeout:g} s')
            except IoUnavailableError as error:
                self._lose(str(error), logging.WARNING if self.states else logging.INFO)
            await asyncio.sleep(RETRIES[min(attempt, len(RETRIES) - 1)])
            attempt += 1

    def _left(self) -> float:
        """Return for how long the newest publication still holds, s."""
        return self._published + self.timeout - asyncio.get_running_loop().time()

    async def _subscribe(self) -> None:
        """Ask for all that the controller can publish. Raises IoUnavailableError."""
        info = await self._ask(IoInfo(self._next_id()), IoInfoReply)
        self.ranges = info.items
        spans = tuple(
            IoSpan(held.io_type, held.start, held.count)
            for held in info.items
            if held.features & IoFeature.STREAMING and held.count > 0
        )
        if not spans:
            raise IoUnavailableError('the controller has no I/O that it publishes')
        self._subscribed = {(span.io_type, span.start): span.count for span in spans}
        self._values.clear()
        reply = await self._ask(IoSubscribe(self._next_id(), spans), IoSubscribeReply)
        _check_addresses(reply.items, [(span.io_type, span.start) for span in spans])
        refused = [item for item in reply.items if item.result != IoResult.SUCCESS]
        for item in refused:
            self._subscribed.pop((item.io_type, item.index), None)
        if refused:
            first = refused[0]
            why = sentence(first.result, first.io_type, first.index, None, self.ranges)
            if not self._subscribed:
                raise IoUnavailableError(f'the controller publishes no I/O: {why}')
            _log.info('I/O: %d of %d ranges are not published: %s', len(refused), len(spans), why)
        self._published = asyncio.get_running_loop().time()
        self._take()

    def _on_packet(self, packet: Packet) -> None:
        """Take a publication, dropping and counting ranges that were not subscribed to."""
        message = packet.message
        if packet.comm_type is not CommType.TOPIC or not isinstance(message, IoPublish):
            return
        changed = False
        for item in message.items:
            key = (item.io_type, item.start)
            if self._subscribed.get(key) != len(item.values):
                self.link.statistics.bad_frames['range'] += 1
                continue
            self._published = asyncio.get_running_loop().time()
            changed = changed or self._values.get(key) != item
            self._values[key] = item
        if changed or not self.states:
            self._take()

    def _take(self) -> None:
        """Publish the values, as soon as there are some of every range."""
        if not self._subscribed or any(key not in self._values for key in self._subscribed):
            return
        self._publish(tuple(self._values[key] for key in self._subscribed))

    def _lose(self, why: str, level: int = logging.INFO) -> None:
        self._values.clear()
        super()._lose(why, level)

    def _on_link(self, state: LinkState, why: str) -> None:
        if state is LinkState.CONNECTED:
            self._published = -math.inf
            self.reason = 'connected; no values yet'
            self._watch = asyncio.get_running_loop().create_task(self._keep_subscribed())
            self._watch.add_done_callback(report_task_error)
            return
        if self._watch is not None:
            self._watch.cancel()
        self._subscribed = {}
        for answer in self._asked:
            if not answer.done():
                answer.set_exception(ConnectionError(f'the I/O link was lost: {why}'))
        if state is LinkState.BACKING_OFF:
            self._lose(f'no I/O link: {why}', logging.WARNING if self.states else logging.INFO)
        elif state is LinkState.DISCONNECTED:
            self._lose('the driver ended', logging.DEBUG)


def _check_number(points: int) -> None:
    if points > MAX_POINTS:
        raise IoUnavailableError(f'{points} points in one request: at most {MAX_POINTS}')


def _check_addresses(items: Sequence[object], asked: list[Key]) -> None:
    """Raise IoUnavailableError unless the reply's items are those that were asked for."""
    answered = [(item.io_type, item.index) for item in items]  # type: ignore[attr-defined]
    if answered != asked:
        raise IoUnavailableError('the reply of the I/O server is about other points')
