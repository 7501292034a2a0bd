# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Layouts of message bodies by message type, and packets, which are messages with a header.

`encode` returns the bytes of a packet. A message of a vendor needs a class and a row in ROWS.
A row lists the fields of the class in wire order with their width: `i` is an int32, `r` a real,
`10r` ten reals, and `0|10i` either none or ten int32, depending on the length of the body.

A type whose reply has a different body has a second class and a row in IO_REPLY_ROWS.
"""

import struct
from collections.abc import Callable, Iterable
from dataclasses import fields
from itertools import product
from operator import itemgetter
from typing import Any, NamedTuple

from epson_driver.simple_message.constants import (
    DIALECTS,
    LITTLE_ENDIAN,
    BodyError,
    ByteOrder,
    CommType,
    Dialect,
    FieldError,
    MessageType,
    Real,
    ReplyCode,
)
from epson_driver.simple_message.framer import HEADER_SIZE, MAX_LENGTH, PREFIX_SIZE
from epson_driver.simple_message.io_layouts import (
    IO_REPLY_ROWS,
    IO_ROWS,
    ItemsLayout,
    PublishLayout,
)
from epson_driver.simple_message.io_messages import IoInfo
from epson_driver.simple_message.messages import (
    GetVersion,
    JointFeedback,
    JointPosition,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    MotionCtrl,
    MotionReply,
    Opaque,
    Ping,
    Status,
)
from epson_driver.simple_message.motoman import (
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


class BodyReader:
    """Decoder of bodies that have one message class, size and dialect.

    `make`: a class returned by `_writable`. `places`: index or slice of each field's values in a
    body.
    """

    __slots__ = ('_fields_of', '_make', '_message_class', '_unpack_from', 'dialect')

    def __init__(
        self,
        message_class: type[Message],
        make: Callable[..., Message],
        dialect: Dialect,
        body: struct.Struct,
        places: Iterable[int | slice],
    ) -> None:
        self.dialect = dialect
        self._message_class = message_class
        self._unpack_from = body.unpack_from
        self._make = make
        self._fields_of = _fields_of(tuple(places))

    def read(self, buffer: bytes | bytearray, start: int = 0) -> Message:
        values = self._unpack_from(buffer, start)
        if self._fields_of is not None:
            values = self._fields_of(values)
        message = self._make(*values)
        message.__class__ = self._message_class
        return message


def _writable(message_class: type[Message]) -> Callable[..., Message]:
    """Return a subclass of a frozen dataclass whose instances are writable.

    Creating an instance of the subclass and setting its `__class__` to the original is several
    times faster than creating an instance of the frozen class.
    """
    names = [field.name for field in fields(message_class)]  # type: ignore[arg-type]
    assign = '; '.join(f'self.{name} = {name}' for name in names)
    namespace: dict[str, Any] = {'__slots__': (), '__setattr__': object.__setattr__}
    exec(f'def __init__(self, {", ".join(names)}): {assign}', {}, namespace)  # noqa: S102 - own fields
    return type(message_class.__name__, (message_class,), namespace)


def _fields_of(
    places: tuple[int | slice, ...],
) -> Callable[[tuple[Any, ...]], tuple[Any, ...]] | None:
    if all(isinstance(place, int) for place in places):
        return None
    if len(places) == 1:
        return lambda values: (values,)
    return itemgetter(*places)


class _Form:
    """A variant of a body. Variants differ in the number of values of optional fields.

    `codes`: `struct` code of each field, or `r` for a real. `scalar`: whether each field is a
    single value.
    """

    def __init__(
        self, counts: tuple[int, ...], codes: tuple[str, ...], scalar: tuple[bool, ...]
    ) -> None:
        self.counts = counts
        self.bodies = [
            struct.Struct(
                dialect.byte_order.value
                + ''.join(
                    f'{n}{dialect.real.value if code == "r" else code}'
                    for n, code in zip(counts, codes, strict=True)
                )
            )
            for dialect in DIALECTS
        ]
        frames = [struct.Struct(f'{body.format[0]}4i{body.format[1:]}') for body in self.bodies]
        self.frames = [(frame.pack, frame.size - PREFIX_SIZE) for frame in frames]
        """For each `Dialect.number`: the packer of a frame, and the value of its length prefix."""
        self.places: list[int | slice] = []
        """Index or slice of each field in the values of a body."""
        start = 0
        for count, one in zip(counts, scalar, strict=True):
            self.places.append(start if one else slice(start, start + count))
            start += count


class FixedLayout:
    """Layout of a body without lists of items. `spec`: a row as in the module docstring."""

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
        self._forms = [_Form(counts, self._codes, self._scalar) for counts in product(*choices)]
        self._frame = _frame_packer(names, self._scalar)
        self._several = tuple(index for index, one in enumerate(self._scalar) if not one)
        self._form_of_counts = {
            tuple(form.counts[index] for index in self._several): form for form in self._forms
        }
        only = len(self._forms) == 1 and len(self._several) <= 1
        self._only_form = self._forms[0] if only else None
        """The only variant of a body, or None if there are several."""
        self._readers: dict[tuple[int, ByteOrder], BodyReader] = {}
        make = _writable(message_class)
        for form, dialect in product(self._forms, DIALECTS):
            body = form.bodies[dialect.number]
            reader = BodyReader(message_class, make, dialect, body, form.places)
            self._readers.setdefault((body.size, dialect.byte_order), reader)

    def size(self, dialect: Dialect) -> int:
        """Return the size of a body without its optional fields, bytes."""
        return self._forms[0].bodies[dialect.number].size

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        return self.frame(message, 0, 0, dialect)[PREFIX_SIZE + HEADER_SIZE :]

    def frame(self, message: Message, comm_type: int, reply_code: int, dialect: Dialect) -> bytes:
        """Return the whole frame. Raises FieldError if a value does not fit its field."""
        form = self._only_form or self._form_of_counts.get(self._counts(message))
        if form is None:
            raise self._error(message, dialect)
        pack, length = form.frames[dialect.number]
        try:
            return self._frame(pack, length, self.msg_type, comm_type, reply_code, message)
        except (struct.error, OverflowError, TypeError) as cause:
            raise self._error(message, dialect) from cause

    def reader(self, size: int, byte_order: ByteOrder) -> BodyReader:
        """Return the reader of bodies of `size` bytes.

        Raises BodyError if no body has this size.
        """
        result = self._readers.get((size, byte_order))
        if result is None:
            sizes = ' or '.join(str(size) for size in sorted({size for size, _ in self._readers}))
            raise BodyError(
                'body',
                f'{size} bytes',
                f'{self.message_class.__name__} (msg_type {self.msg_type}) has {sizes}',
            )
        return result

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        reader = self.reader(len(body), byte_order)
        return reader.read(body), reader.dialect.real

    def _counts(self, message: Message) -> tuple[int, ...]:
        return tuple([len(getattr(message, self._names[index])) for index in self._several])

    def _error(self, message: Message, dialect: Dialect) -> FieldError:
        for index, count in zip(self._several, self._counts(message), strict=True):
            allowed = {form.counts[index] for form in self._forms}
            if count not in allowed:
                rule = ' or '.join(str(n) for n in sorted(allowed))
                return FieldError(self._names[index], f'{count} values', f'must have {rule}')
        for name, code, scalar in zip(self._names, self._codes, self._scalar, strict=True):
            value = getattr(message, name)
            rule = 'must be an int32' if code == 'i' else f'must fit {dialect.real.name.lower()}'
            one = struct.Struct('<' + (dialect.real.value if code == 'r' else code))
            for index, item in enumerate([value] if scalar else value):
                try:
                    one.pack(item)
                except (struct.error, OverflowError, TypeError):
                    return FieldError(name if scalar else f'{name}[{index}]', item, rule)
        raise AssertionError('each field fits alone, but not together')


def _frame_packer(names: tuple[str, ...], scalar: tuple[bool, ...]) -> Callable[..., bytes]:
    """Return a function that packs header fields and a message into one frame, with `pack`.

    The function is compiled from source, because collecting the fields in a tuple would take as
    long as packing.
    """
    words = 'length, msg_type, comm_type, reply_code'
    values = (
        f'{"" if one else "*"}message.{name}' for name, one in zip(names, scalar, strict=True)
    )
    source = f'lambda pack, {words}, message: pack({words}, {", ".join(values)})'
    frame: Callable[..., bytes] = eval(source)  # noqa: S307 - the names of our own fields
    return frame


class PingLayout(FixedLayout):
    """Layout of PING, whose body may have any number of words and is meaningless.

    A program that reuses a message object of the C++ library sends the object's previous body.
    """

    def reader(self, size: int, byte_order: ByteOrder) -> BodyReader:
        """Return a reader of ten words. The words of a body of any other size are ignored."""
        known = size % 4 or size == 40
        return super().reader(size if known else 0, byte_order)


class TrajectoryLayout:
    """Layout of JOINT_TRAJ, which has two variants.

    ROS-Industrial's C++ library writes the points, and then their number. REP-I0006 specifies the
    number, and then always ten points. Both variants are decoded. Only the library's variant is
    encoded, because existing programs use it.
    """

    msg_type = int(MessageType.JOINT_TRAJ)
    message_class: type[Message] = JointTraj

    def __init__(self, point: FixedLayout) -> None:
        self._point = point

    def encode(self, message: Message, dialect: Dialect) -> bytes:
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
        int32 = struct.Struct(byte_order.value + 'i')
        for real in Real:
            size = self._point.size(Dialect(byte_order, real))
            points, rest = divmod(len(body), size)
            if rest != int32.size or points > MAX_TRAJECTORY_POINTS:
                continue
            if int32.unpack_from(body, points * size)[0] == points:
                return self._points(body[: points * size], size, byte_order), real
            count = int32.unpack_from(body)[0]
            if points == 10 and 0 <= count <= points:
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

Layout = FixedLayout | TrajectoryLayout | ItemsLayout | PublishLayout

ROWS: tuple[Layout, ...] = (
    PingLayout(MessageType.PING, Ping, 'padding:0|10i'),
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

LAYOUT_OF_TYPE: dict[int, Layout] = {row.msg_type: row for row in ROWS}
LAYOUT_OF_REPLY: dict[int, Layout] = {row.msg_type: row for row in IO_REPLY_ROWS}
LAYOUT_OF_CLASS: dict[type[Message], Layout] = {
    row.message_class: row for row in (*ROWS, *IO_REPLY_ROWS)
}


class Packet(NamedTuple):
    """A message with its header fields. A received packet also has the dialect of its bytes."""

    message: Message
    comm_type: CommType
    reply_code: ReplyCode = ReplyCode.INVALID
    dialect: Dialect = LITTLE_ENDIAN

    @property
    def msg_type(self) -> int:
        if isinstance(self.message, Opaque):
            return self.message.msg_type
        return LAYOUT_OF_CLASS[type(self.message)].msg_type


def topic(message: Message) -> Packet:
    return Packet(message, CommType.TOPIC)


def request(message: Message) -> Packet:
    return NEW(Packet, (message, *_REQUEST))


def reply(message: Message, code: ReplyCode) -> Packet:
    return Packet(message, CommType.SERVICE_REPLY, code)


def encode(packet: Packet, dialect: Dialect) -> bytes:
    """Return a packet's bytes with the length prefix. Raises FieldError if a value is invalid."""
    message = packet.message
    layout = LAYOUT_OF_CLASS.get(type(message))
    if isinstance(layout, FixedLayout):
        return layout.frame(message, packet.comm_type, packet.reply_code, dialect)
    if isinstance(message, Opaque):
        body = _opaque_body(message)
    else:
        body = LAYOUT_OF_CLASS[type(message)].encode(message, dialect)
    prefix = struct.pack(
        dialect.byte_order.value + '4i',
        HEADER_SIZE + len(body),
        packet.msg_type,
        packet.comm_type,
        packet.reply_code,
    )
    return prefix + body


def _opaque_body(message: Opaque) -> bytes:
    """Return the body's bytes.

    Raises FieldError if no frame can have the message's type or length.
    """
    if not -(2**31) <= message.msg_type < 2**31:
        raise FieldError('msg_type', message.msg_type, 'must be an int32')
    if HEADER_SIZE + len(message.body) > MAX_LENGTH:
        rule = f'a frame holds at most {MAX_LENGTH - HEADER_SIZE} bytes of body'
        raise FieldError('body', f'{len(message.body)} bytes', rule)
    return message.body


NEW = tuple.__new__
_REQUEST = (CommType.SERVICE_REQUEST, ReplyCode.INVALID, LITTLE_ENDIAN)
