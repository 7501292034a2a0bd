# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One table from message type to body layout. A vendor's message is a class and a row here.

A row names the class's fields in the order of the wire with their width: `i` int32, `r` real,
`10r` ten reals, `0|10i` either none or ten ints (the length of the body tells which).

A type whose replies have a body of their own has a second row, with a class of its own, in
REPLY_ROWS.
"""

import struct
from collections.abc import Iterable
from dataclasses import fields
from itertools import product
from typing import Protocol

from epson_driver.simple_message.constants import MessageType
from epson_driver.simple_message.dialect import ByteOrder, Dialect, Real
from epson_driver.simple_message.errors import BodyError, FieldError
from epson_driver.simple_message.io_layouts import IO_REPLY_ROWS, IO_ROWS
from epson_driver.simple_message.io_messages import IoInfo
from epson_driver.simple_message.messages import (
    GetVersion,
    JointFeedback,
    JointPosition,
    JointSetpoint,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    MotionCtrl,
    MotionReply,
    Ping,
    Status,
)
from epson_driver.simple_message.motoman_io import (
    IoCtrlReply,
    ReadIoBit,
    ReadIoBitReply,
    ReadIoGroup,
    ReadIoGroupReply,
    WriteIoBit,
    WriteIoBitReply,
    WriteIoGroup,
    WriteIoGroupReply,
)

MAX_TRAJECTORY_POINTS = 200


class Layout(Protocol):
    """How one message type's body is written and read."""

    msg_type: int
    message_class: type[Message]

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        """Return the body. Raises FieldError where a value does not fit the wire."""

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        """Return the message and the real width its length shows (FLOAT32 if it has none).

        Raises BodyError for a length that the type does not have.
        """


class _Form:
    """One possible shape of a body: its field counts, and compiled structs per dialect."""

    def __init__(self, counts: tuple[int, ...], codes: tuple[str, ...]) -> None:
        self.counts = counts
        self.structs = {
            Dialect(order, real): struct.Struct(
                order.value
                + ''.join(
                    f'{n}{real.value if code == "r" else code}'
                    for n, code in zip(counts, codes, strict=True)
                )
            )
            for order, real in product(ByteOrder, Real)
        }


class FixedLayout:
    """A body of fixed fields, of which some may be left out as a whole."""

    def __init__(self, msg_type: int, message_class: type[Message], spec: str) -> None:
        self.msg_type = msg_type
        self.message_class = message_class
        names, widths = zip(*(item.split(':') for item in spec.split()), strict=True)
        expected = tuple(f.name for f in fields(message_class))  # type: ignore[arg-type]
        if names != expected:
            raise TypeError(f'{message_class.__name__}: layout names {names}, class {expected}')
        self._names: tuple[str, ...] = names
        self._codes = tuple(width[-1] for width in widths)
        self._scalar = tuple(width in ('i', 'r') for width in widths)
        choices = [tuple(int(n) for n in (width[:-1] or '1').split('|')) for width in widths]
        self._forms = [_Form(counts, self._codes) for counts in product(*choices)]
        self._form_of_counts = {form.counts: form for form in self._forms}
        self._form_of_size: dict[int, tuple[_Form, Real]] = {}
        for form, real in product(self._forms, Real):
            size = form.structs[Dialect(real=real)].size
            self._form_of_size.setdefault(size, (form, real))

    def size(self, dialect: Dialect) -> int:
        """Return the size of the body's first form in bytes."""
        return self._forms[0].structs[dialect].size

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        """Return the body. Raises FieldError where a value does not fit the wire."""
        flat: list[int | float] = []
        counts = []
        for name, scalar in zip(self._names, self._scalar, strict=True):
            value = getattr(message, name)
            if scalar:
                flat.append(value)
                counts.append(1)
            else:
                flat.extend(value)
                counts.append(len(value))
        form = self._form_of_counts.get(tuple(counts))
        if form is None:
            raise self._count_error(counts)
        try:
            return form.structs[dialect].pack(*flat)
        except (struct.error, OverflowError, TypeError) as cause:
            raise self._value_error(message, dialect) from cause

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        """Return the message and the real width its length shows. Raises BodyError."""
        found = self._form_of_size.get(len(body))
        if found is None:
            sizes = ' or '.join(str(size) for size in sorted(self._form_of_size))
            raise BodyError(
                'body',
                f'{len(body)} bytes',
                f'{self.message_class.__name__} (msg_type {self.msg_type}) has {sizes}',
            )
        form, real = found
        flat = form.structs[Dialect(byte_order, real)].unpack(body)
        values: list[object] = []
        at = 0
        for count, scalar in zip(form.counts, self._scalar, strict=True):
            values.append(flat[at] if scalar else flat[at : at + count])
            at += count
        return self.message_class(*values), real

    def _count_error(self, counts: list[int]) -> FieldError:
        for index, count in enumerate(counts):
            allowed = {form.counts[index] for form in self._forms}
            if count not in allowed:
                rule = ' or '.join(str(n) for n in sorted(allowed))
                return FieldError(self._names[index], f'{count} values', f'must have {rule}')
        raise AssertionError('counts fit, but not together')

    def _value_error(self, message: Message, dialect: Dialect) -> FieldError:
        for name, code, scalar in zip(self._names, self._codes, self._scalar, strict=True):
            value = getattr(message, name)
            rule = 'must be an int32' if code == 'i' else f'must fit {dialect.real.name.lower()}'
            one = struct.Struct('<' + (dialect.real.value if code == 'r' else code))
            for index, item in enumerate([value] if scalar else value):
                try:
                    one.pack(item)
                except (struct.error, OverflowError, TypeError):
                    return FieldError(name if scalar else f'{name}[{index}]', item, rule)
        raise AssertionError('every value fits alone, but not together')


class TrajectoryLayout:
    """JOINT_TRAJ, of which two forms are described.

    The C++ library writes the points, then their number; REP-I0006 the number, then always ten
    points. Both are read; the library's form, which exists in code, is written.
    """

    msg_type = int(MessageType.JOINT_TRAJ)
    message_class: type[Message] = JointTraj

    def __init__(self, point: FixedLayout) -> None:
        self._point = point

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        """Return the body. Raises FieldError for too many points or a value that does not fit."""
        points = message.points  # type: ignore[attr-defined]
        if len(points) > MAX_TRAJECTORY_POINTS:
            raise FieldError('points', len(points), f'at most {MAX_TRAJECTORY_POINTS}')
        body = bytearray()
        for index, point in enumerate(points):
            try:
                body += self._point.encode(point, dialect)
            except FieldError as error:
                field = f'points[{index}].{error.field}'
                raise FieldError(field, error.value, error.rule) from error
        return bytes(body) + struct.pack(dialect.byte_order.value + 'i', len(points))

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        """Return the message and its real width. Raises BodyError."""
        int32 = struct.Struct(byte_order.value + 'i')
        for real in Real:
            size = self._point.size(Dialect(byte_order, real))
            held, rest = divmod(len(body), size)
            if rest != int32.size or held > MAX_TRAJECTORY_POINTS:
                continue
            if int32.unpack_from(body, held * size)[0] == held:
                return self._points(body[: held * size], size, byte_order), real
            count = int32.unpack_from(body)[0]
            if held == 10 and 0 <= count <= held:
                start = int32.size
                return self._points(body[start : start + count * size], size, byte_order), real
        raise BodyError(
            'body', f'{len(body)} bytes', 'JointTraj: length or number of points is wrong'
        )

    def _points(self, data: bytes, size: int, byte_order: ByteOrder) -> JointTraj:
        starts: Iterable[int] = range(0, len(data), size)
        points = [self._point.decode(data[i : i + size], byte_order)[0] for i in starts]
        return JointTraj(tuple(points))  # type: ignore[arg-type]


_JOINT_TRAJ_PT = FixedLayout(
    MessageType.JOINT_TRAJ_PT, JointTrajPt, 'sequence:i joints:10r velocity:r duration:r'
)

ROWS: tuple[Layout, ...] = (
    FixedLayout(MessageType.PING, Ping, 'padding:0|10i'),
    FixedLayout(MessageType.GET_VERSION, GetVersion, 'version:0|3i'),
    FixedLayout(MessageType.JOINT_POSITION, JointPosition, 'sequence:i joints:10r'),
    _JOINT_TRAJ_PT,
    TrajectoryLayout(_JOINT_TRAJ_PT),
    FixedLayout(
        MessageType.STATUS,
        Status,
        'drives_powered:i e_stopped:i error_code:i in_error:i in_motion:i mode:i '
        'motion_possible:i',
    ),
    FixedLayout(
        MessageType.JOINT_TRAJ_PT_FULL,
        JointTrajPtFull,
        'robot_id:i sequence:i valid_fields:i time:r '
        'positions:10r velocities:10r accelerations:10r',
    ),
    FixedLayout(
        MessageType.JOINT_FEEDBACK,
        JointFeedback,
        'robot_id:i valid_fields:i time:r positions:10r velocities:10r accelerations:10r',
    ),
    FixedLayout(
        MessageType.JOINT_SETPOINT, JointSetpoint, 'sequence:i joints:10r velocities:10r scale:r'
    ),
    FixedLayout(MessageType.MOTION_CTRL, MotionCtrl, 'robot_id:i sequence:i command:i data:10r'),
    FixedLayout(
        MessageType.MOTION_REPLY,
        MotionReply,
        'robot_id:i sequence:i command:i result:i subcode:i data:10r',
    ),
    FixedLayout(MessageType.READ_IO_BIT, ReadIoBit, 'address:i'),
    FixedLayout(MessageType.READ_IO_BIT_REPLY, ReadIoBitReply, 'value:i result:i'),
    FixedLayout(MessageType.WRITE_IO_BIT, WriteIoBit, 'address:i value:i'),
    FixedLayout(MessageType.WRITE_IO_BIT_REPLY, WriteIoBitReply, 'result:i'),
    FixedLayout(MessageType.READ_IO_GROUP, ReadIoGroup, 'address:i'),
    FixedLayout(MessageType.READ_IO_GROUP_REPLY, ReadIoGroupReply, 'value:i result:i'),
    FixedLayout(MessageType.WRITE_IO_GROUP, WriteIoGroup, 'address:i value:i'),
    FixedLayout(MessageType.WRITE_IO_GROUP_REPLY, WriteIoGroupReply, 'result:i'),
    FixedLayout(MessageType.IOCTRL_REPLY, IoCtrlReply, 'result:i subcode:i'),
    FixedLayout(MessageType.IO_INFO, IoInfo, 'message_id:i'),
    *IO_ROWS,
)

REPLY_ROWS: tuple[Layout, ...] = IO_REPLY_ROWS

LAYOUT_OF_TYPE: dict[int, Layout] = {row.msg_type: row for row in ROWS}
LAYOUT_OF_REPLY: dict[int, Layout] = {row.msg_type: row for row in REPLY_ROWS}
LAYOUT_OF_CLASS: dict[type[Message], Layout] = {
    row.message_class: row for row in (*ROWS, *REPLY_ROWS)
}
