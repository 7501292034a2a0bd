# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Layouts of the I/O messages.

A body consists of int32 words: fields, the number of items, and the items.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Any

from epson_driver.simple_message.constants import (
    BodyError,
    ByteOrder,
    Dialect,
    FieldError,
    MessageType,
    Real,
)
from epson_driver.simple_message.io_messages import (
    IoAddress,
    IoInfoReply,
    IoOutcome,
    IoPublish,
    IoRange,
    IoRead,
    IoReading,
    IoReadReply,
    IoReset,
    IoResetReply,
    IoSetting,
    IoSpan,
    IoSubscribe,
    IoSubscribeReply,
    IoUnsubscribe,
    IoUnsubscribeReply,
    IoValues,
    IoWrite,
    IoWriteReply,
)
from epson_driver.simple_message.messages import Message

MAX_ITEMS = 1024
"""Maximum items per message. The longest reply has 16,412 bytes, a frame may have 65,535."""

MAX_VALUES = 8192
"""Maximum values per IO_STREAM_PUB, so that it has less than 65,535 bytes with MAX_ITEMS items."""

_INT32 = 4
_COUNT = 'num_items'


class ItemsLayout:
    """Layout of a message with items of a class whose fields are in wire order."""

    def __init__(self, msg_type: int, message_class: type[Message], item_class: type[Any]) -> None:
        self.msg_type = int(msg_type)
        self.message_class = message_class
        self._item_class = item_class
        self._names = tuple(field.name for field in fields(item_class))
        self._width = len(self._names)
        self._head = _head(message_class)

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        """Return the body. Raises FieldError for too many items, or a value that is no int32."""
        items: Sequence[Any] = message.items  # type: ignore[attr-defined]
        _check_number(len(items))
        named = [(name, getattr(message, name)) for name in self._head]
        named.append((_COUNT, len(items)))
        for number, item in enumerate(items):
            named.extend((f'items[{number}].{name}', getattr(item, name)) for name in self._names)
        return _pack(named, dialect.byte_order)

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        """Return the message, and FLOAT32, because it has no reals.

        Raises BodyError if invalid.
        """
        words = _unpack(body, byte_order, self.message_class, len(self._head) + 1)
        head = words[: len(self._head)]
        rest = words[len(self._head) + 1 :]
        count = words[len(self._head)]
        if not 0 <= count <= MAX_ITEMS:
            raise BodyError(_COUNT, count, f'must be 0 to {MAX_ITEMS}')
        if count * self._width != len(rest):
            rule = f'the items that follow have {len(rest) * _INT32} bytes, {self._width * _INT32}'
            raise BodyError(_COUNT, count, f'{rule} each')
        starts = range(0, len(rest), self._width)
        items = tuple(self._item_class(*rest[start : start + self._width]) for start in starts)
        values: list[object] = [*head, items]
        return self.message_class(*values), Real.FLOAT32


class PublishLayout:
    """Layout of IO_STREAM_PUB, whose items have a variable number of values."""

    msg_type = int(MessageType.IO_STREAM_PUB)
    message_class: type[Message] = IoPublish

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        items: Sequence[IoValues] = message.items  # type: ignore[attr-defined]
        _check_number(len(items))
        total = sum(len(item.values) for item in items)
        if total > MAX_VALUES:
            raise FieldError('values', total, f'at most {MAX_VALUES} in all items')
        timestamp = message.timestamp  # type: ignore[attr-defined]
        named = [('timestamp', timestamp), (_COUNT, len(items))]
        for number, item in enumerate(items):
            name = f'items[{number}]'
            named.append((f'{name}.io_type', item.io_type))
            named.append((f'{name}.start', item.start))
            named.append((f'{name}.count', len(item.values)))
            named.extend((f'{name}.values[{i}]', value) for i, value in enumerate(item.values))
        return _pack(named, dialect.byte_order)

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        timestamp, count, *rest = _unpack(body, byte_order, IoPublish, 2)
        if not 0 <= count <= MAX_ITEMS:
            raise BodyError(_COUNT, count, f'must be 0 to {MAX_ITEMS}')
        items = []
        position = 0
        for number in range(count):
            if len(rest) - position < 3:
                raise BodyError(_COUNT, count, f'the body ends in items[{number}]')
            io_type, start, length = rest[position : position + 3]
            position += 3
            if not 0 <= length <= len(rest) - position:
                rule = f'{len(rest) - position} values follow in the body'
                raise BodyError(f'items[{number}].count', length, rule)
            items.append(IoValues(io_type, start, tuple(rest[position : position + length])))
            position += length
        if position != len(rest):
            rule = f'{(len(rest) - position) * _INT32} bytes follow after the last item'
            raise BodyError(_COUNT, count, rule)
        return IoPublish(timestamp, tuple(items)), Real.FLOAT32


def _head(message_class: type[Message]) -> tuple[str, ...]:
    *head, last = (field.name for field in fields(message_class))  # type: ignore[arg-type]
    if last != 'items':
        raise TypeError(f'{message_class.__name__}: the last field is {last}, not items')
    return tuple(head)


def _check_number(count: int) -> None:
    if count > MAX_ITEMS:
        raise FieldError('items', count, f'at most {MAX_ITEMS}')


def _pack(named: Sequence[tuple[str, int]], order: ByteOrder) -> bytes:
    """Return named values packed as int32. Raises FieldError if a value is no int32."""
    try:
        return struct.pack(f'{order.value}{len(named)}i', *(value for _, value in named))
    except struct.error as cause:
        raise next(_errors(named)) from cause


def _errors(named: Sequence[tuple[str, int]]) -> Iterator[FieldError]:
    for name, value in named:
        try:
            struct.pack('<i', value)
        except struct.error:
            yield FieldError(name, value, 'must be an int32')


def _unpack(
    body: bytes, order: ByteOrder, message_class: type[Message], least: int
) -> tuple[int, ...]:
    """Return the words of a body. Raises BodyError if there are fewer than `least`."""
    count, rest = divmod(len(body), _INT32)
    if rest or count < least:
        rule = f'{message_class.__name__} has {least * _INT32} bytes, and 4 for each further field'
        raise BodyError('body', f'{len(body)} bytes', rule)
    return struct.unpack(f'{order.value}{count}i', body)


IO_ROWS = (
    ItemsLayout(MessageType.IO_READ, IoRead, IoAddress),
    ItemsLayout(MessageType.IO_WRITE, IoWrite, IoSetting),
    ItemsLayout(MessageType.IO_RESET, IoReset, IoAddress),
    ItemsLayout(MessageType.IO_STREAM_SUB, IoSubscribe, IoSpan),
    ItemsLayout(MessageType.IO_STREAM_UNSUB, IoUnsubscribe, IoAddress),
    PublishLayout(),
)

IO_REPLY_ROWS = (
    ItemsLayout(MessageType.IO_INFO, IoInfoReply, IoRange),
    ItemsLayout(MessageType.IO_READ, IoReadReply, IoReading),
    ItemsLayout(MessageType.IO_WRITE, IoWriteReply, IoOutcome),
    ItemsLayout(MessageType.IO_RESET, IoResetReply, IoOutcome),
    ItemsLayout(MessageType.IO_STREAM_SUB, IoSubscribeReply, IoOutcome),
    ItemsLayout(MessageType.IO_STREAM_UNSUB, IoUnsubscribeReply, IoOutcome),
)
