# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The session of one client of the I/O port: answers to requests, and published ranges of points.

Every item of a request has a separate result. An invalid item does not affect the others.
docs/io.md describes the messages.
"""

import logging
import math
from collections.abc import Callable, Mapping
from typing import Any

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.io.io_points import IoError, IoPoints
from epson_driver.sim_controller.ports import Send, answer, answer_frame, failure
from epson_driver.simple_message import (
    BodyError,
    CommType,
    Dialect,
    Frame,
    Framer,
    HeaderError,
    IoAddress,
    IoResult,
    IoType,
    Message,
    Packet,
    ReplyCode,
    decode,
    encode,
    reply,
    topic,
)
from epson_driver.simple_message.io_messages import (
    ALL,
    ControllerFeature,
    IoInfo,
    IoInfoReply,
    IoOutcome,
    IoPublish,
    IoRead,
    IoReading,
    IoReadReply,
    IoReset,
    IoResetReply,
    IoSpan,
    IoSubscribe,
    IoSubscribeReply,
    IoUnsubscribe,
    IoUnsubscribeReply,
    IoValues,
    IoWrite,
    IoWriteReply,
)

MAX_CATCH_UP_PUBLICATIONS = 3  # maximum number of missed publications to send, besides the newest
MAX_RANGES = 64
MAX_VALUES = 4096
"""Maximum number of ranges to which one client subscribes, and of values in all of them."""

TIMESTAMP_MASK = 2**31 - 1


def timestamp(clock: Clock) -> int:
    """Return the controller's time in ms, modulo 24.8 days."""
    return int(clock.now * 1000.0) & TIMESTAMP_MASK


class IoStream:
    """Publishes the subscribed ranges every `publish_period` of the profile, and after a change.

    Changes are collected until the clock next advances, and are then published together. Two
    publications are at least `publish_interval` apart. Nothing is published while `paused()` is
    True.
    """

    def __init__(
        self,
        points: IoPoints,
        clock: Clock,
        publish: Callable[[IoPublish], None],
        paused: Callable[[], bool],
    ) -> None:
        self._points = points
        self._clock = clock
        self._publish = publish
        self._paused = paused
        self._ranges: dict[tuple[int, int], int] = {}
        self._sent: tuple[IoValues, ...] = ()
        self._sent_at = -math.inf
        self._timer: Timer | None = None
        self._change: Timer | None = None
        self._stop_listening = points.listen(self._changed)

    def subscribe(self, span: IoSpan) -> None:
        """Add a range, or replace the range with the same start."""
        self._points.check_range(span.io_type, span.start, span.count)
        key = (span.io_type, span.start)
        ranges = {**self._ranges, key: span.count}
        values = sum(ranges.values())
        if len(ranges) > MAX_RANGES or values > MAX_VALUES:
            raise IoError(
                IoResult.TOO_MUCH,
                f'{len(ranges)} ranges with {values} values: at most {MAX_RANGES} with '
                f'{MAX_VALUES} in total',
            )
        self._ranges = ranges
        self._sent = ()
        self._changed()
        if self._timer is None:
            self._start_timer()

    def unsubscribe(self, address: IoAddress) -> None:
        key = (address.io_type, address.index)
        if key not in self._ranges:
            self._points.check_range(*key, 1)
            text = f'type {key[0]}, start {key[1]}: no subscription starts there'
            raise IoError(IoResult.NO_SUBSCRIPTION, text)
        del self._ranges[key]
        if not self._ranges:
            self._cancel()

    def close(self) -> None:
        self._stop_listening()
        self._ranges = {}
        self._cancel()

    def _cancel(self) -> None:
        for timer in (self._timer, self._change):
            if timer is not None:
                timer.cancel()
        self._timer = self._change = None

    def _start_timer(self) -> None:
        period = self._points.profile.publish_period
        self._timer = self._clock.every(
            period,
            lambda: self._send(self._values()),
            first=period,
            catch_up=MAX_CATCH_UP_PUBLICATIONS,
        )

    def _changed(self) -> None:
        if not self._ranges or self._change is not None:
            return
        earliest = self._sent_at + self._points.profile.publish_interval
        delay = max(earliest - self._clock.now, 0.0)
        self._change = self._clock.after(delay, self._send_change)

    def _send_change(self) -> None:
        self._change = None
        values = self._values()
        if values != self._sent:
            self._send(values)

    def _values(self) -> tuple[IoValues, ...]:
        return tuple(
            IoValues(io_type, start, self._points.read_range(io_type, start, count))
            for (io_type, start), count in self._ranges.items()
        )

    def _send(self, values: tuple[IoValues, ...]) -> None:
        if self._paused():
            return
        self._sent = values
        self._sent_at = self._clock.now
        self._publish(IoPublish(timestamp(self._clock), values))


_OUTPUTS = (IoType.DIGITAL_OUTPUT, IoType.ANALOG_OUTPUT, IoType.GROUP_OUTPUT)
_RESETTABLE = (IoType.DIGITAL_OUTPUT, IoType.ANALOG_OUTPUT, IoType.FLAG)
"""Types of points that a reset of ALL types resets.

Groups are missing, because they consist of the same points.
"""

_log = logging.getLogger(__name__)


class IoSession:
    """The session of one client of the I/O port.

    `available` returns why requests are currently refused, or None.
    """

    def __init__(
        self,
        points: IoPoints,
        dialect: Dialect,
        clock: Clock,
        send: Send,
        available: Callable[[], str | None],
    ) -> None:
        self._points = points
        self._dialect = dialect
        self._clock = clock
        self._send = send
        self._available = available
        self._framer = Framer(dialect.byte_order)
        self._stream = IoStream(points, clock, self._publish, lambda: available() is not None)
        self._open = True
        self._reported: str | None = None
        self._rejected: list[str] = []
        self._answers: Mapping[type[Message], Callable[[Any], Message]] = {
            IoInfo: self._info,
            IoRead: self._read,
            IoWrite: self._write,
            IoReset: self._reset,
            IoSubscribe: self._subscribe,
            IoUnsubscribe: self._unsubscribe,
        }

    def receive(self, data: bytes) -> None:
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            packet = self._reply(frame)
            if packet is not None:
                self._send(encode(packet, self._dialect))

    def closed(self) -> None:
        if self._open:
            self._open = False
            self._stream.close()
            self._points.client_gone(self)

    def _reply(self, frame: Frame) -> Packet | None:
        try:
            packet = decode(frame)
        except (HeaderError, BodyError):
            return answer_frame(frame, {})  # logs the error and answers FAILURE
        handler = self._answers.get(type(packet.message))
        if handler is None or packet.comm_type is not CommType.SERVICE_REQUEST:
            return answer(packet, {})
        reason = self._available()
        if reason != self._reported:
            self._reported = reason
            _log.info('the I/O port %s', 'answers' if reason is None else f'refuses: {reason}')
        if reason is not None:
            return failure(packet.msg_type)
        self._rejected.clear()
        body = handler(packet.message)
        if self._rejected:
            _log.warning(
                'items refused: %d, the first: %s', len(self._rejected), self._rejected[0]
            )
        return reply(body, ReplyCode.SUCCESS)

    def _info(self, message: IoInfo) -> IoInfoReply:
        features = ControllerFeature.TIMESTAMPS
        return IoInfoReply(message.message_id, features, self._points.ranges())

    def _read(self, message: IoRead) -> IoReadReply:
        items = tuple(self._reading(item) for item in message.items)
        return IoReadReply(message.message_id, timestamp(self._clock), items)

    def _reading(self, item: IoAddress) -> IoReading:
        try:
            value = self._points.read(item.io_type, item.index)
        except IoError as error:
            self._rejected.append(str(error))
            return IoReading(item.io_type, item.index, error.result, 0)
        return IoReading(item.io_type, item.index, IoResult.SUCCESS, value)

    def _write(self, message: IoWrite) -> IoWriteReply:
        write = self._points.write
        items = tuple(
            self._outcome(item.io_type, item.index, write, item.io_type, item.index, item.value)
            for item in message.items
        )
        self._record_writer(items)
        return IoWriteReply(message.message_id, timestamp(self._clock), items)

    def _reset(self, message: IoReset) -> IoResetReply:
        done = {  # no duplicates, because an item can contain thousands of points
            item: self._outcome(item.io_type, item.index, self._reset_points, item)
            for item in dict.fromkeys(message.items)
        }
        items = tuple(done[item] for item in message.items)
        self._record_writer(items)
        return IoResetReply(message.message_id, items)

    def _reset_points(self, item: IoAddress) -> None:
        if item.index != ALL:
            self._points.reset_point(item.io_type, item.index)
            return
        types = _RESETTABLE if item.io_type == ALL else (item.io_type,)
        ranges = [io_range for io_range in self._points.ranges() if io_range.io_type in types]
        if not ranges:
            self._points.reset_point(item.io_type, 0)  # raises the error for a type without points
        for io_range in ranges:
            for index in range(io_range.start, io_range.start + io_range.count):
                self._points.reset_point(io_range.io_type, index)

    def _subscribe(self, message: IoSubscribe) -> IoSubscribeReply:
        items = tuple(
            self._outcome(item.io_type, item.start, self._stream.subscribe, item)
            for item in message.items
        )
        return IoSubscribeReply(message.message_id, items)

    def _unsubscribe(self, message: IoUnsubscribe) -> IoUnsubscribeReply:
        items = tuple(
            self._outcome(item.io_type, item.index, self._stream.unsubscribe, item)
            for item in message.items
        )
        return IoUnsubscribeReply(message.message_id, items)

    def _outcome(
        self, io_type: int, index: int, action: Callable[..., None], *arguments: object
    ) -> IoOutcome:
        try:
            action(*arguments)
        except IoError as error:
            self._rejected.append(str(error))
            return IoOutcome(io_type, index, error.result)
        return IoOutcome(io_type, index, IoResult.SUCCESS)

    def _record_writer(self, items: tuple[IoOutcome, ...]) -> None:
        done = (item.io_type for item in items if item.result == IoResult.SUCCESS)
        if any(io_type in _OUTPUTS or io_type == ALL for io_type in done):
            self._points.client_wrote(self)

    def _publish(self, message: IoPublish) -> None:
        self._send(encode(topic(message), self._dialect))
