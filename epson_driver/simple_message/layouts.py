# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The layouts of message bodies, by message type. A vendor's message needs a class and a row here.

A row lists the fields of the class in wire order with their width: `i` is an int32, `r` a real,
`10r` ten reals, and `0|10i` either none or ten int32, depending on the length of the body.

A type whose reply has a different body has a second class and a row in IO_REPLY_ROWS.
"""

import struct
from collections.abc import Callable, Iterable
from dataclasses import fields
from itertools import product
from operator import itemgetter
from typing import Any, Protocol

from epson_driver.simple_message.constants import (
    DIALECTS,
    BodyError,
    ByteOrder,
    Dialect,
    FieldError,
    MessageType,
    Real,
)
from epson_driver.simple_message.framer import HEADER_SIZE, PREFIX_SIZE
from epson_driver.simple_message.io_layouts import IO_REPLY_ROWS, IO_ROWS
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


class Layout(Protocol):
    """Encoder and decoder of the body of one message type."""

    msg_type: int
    message_class: type[Message]

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        """Return the body. Raises FieldError if a value does not fit its field."""

    def decode(self, body: bytes, byte_order: ByteOrder) -> tuple[Message, Real]:
        """Return the message and the width of its reals (FLOAT32 if the body has none).

        The width follows from the length of the body. Raises BodyError if no message of this type
        has this length.
        """


class BodyReader:
    """Decoder of bodies of one message class, size and dialect.

    * `make`: class that `_writable` returns for the message class.
    * `body`: `struct` format of the body.
    * `places`: index or slice of each field among the values of the body.
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
        """Return the message whose body starts at `start` in a buffer."""
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
    """Return a function that groups a body's values into fields, or None if each field is one."""
    if all(isinstance(place, int) for place in places):
        return None
    if len(places) == 1:
        return lambda values: (values,)
    return itemgetter(*places)


class _Form:
    """One of the variants of a body, which differ in whether optional fields are present.

    * `counts`: number of values of each field (0: the field is not present).
    * `codes`: `struct` code of each field, or `r` for a real.
    * `scalar`: for each field, whether it is a single value instead of a tuple.
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
    """Layout of a body without lists of items. `spec`: a row as in the module's docstring."""

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
        """Indices of the fields with several values."""
        self._form_of_counts = {
            tuple(form.counts[index] for index in self._several): form for form in self._forms
        }
        only = len(self._forms) == 1 and len(self._several) <= 1
        self._only_form = self._forms[0] if only else None
        """The variant, if only one exists and at most one field has several values, else None."""
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
        """Return the body. Raises FieldError if a value does not fit its field."""
        return self.frame(message, 0, 0, dialect)[PREFIX_SIZE + HEADER_SIZE :]

    def frame(self, message: Message, comm_type: int, reply_code: int, dialect: Dialect) -> bytes:
        """Return the whole frame. Raises FieldError if a value does not fit its field."""
        form = self._only_form or self._form_of_counts.get(self._counts(message))
        if form is None:
            raise self._count_error(message)
        pack, length = form.frames[dialect.number]
        try:
            return self._frame(pack, length, self.msg_type, comm_type, reply_code, message)
        except (struct.error, OverflowError, TypeError) as cause:
            raise self._error(message, dialect) from cause

    def reader(self, size: int, byte_order: ByteOrder) -> BodyReader:
        """Return the reader of bodies of `size` bytes.

        Raises BodyError if no message of this type has this size.
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
        """Return the message and the width of its reals.

        Raises BodyError if no message of this type has this length.
        """
        reader = self.reader(len(body), byte_order)
        return reader.read(body), reader.dialect.real

    def _counts(self, message: Message) -> tuple[int, ...]:
        return tuple([len(getattr(message, self._names[index])) for index in self._several])

    def _error(self, message: Message, dialect: Dialect) -> FieldError:
        if self._counts(message) not in self._form_of_counts:
            return self._count_error(message)
        return self._value_error(message, dialect)

    def _count_error(self, message: Message) -> FieldError:
        for index, count in zip(self._several, self._counts(message), strict=True):
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


def _frame_packer(names: tuple[str, ...], scalar: tuple[bool, ...]) -> Callable[..., bytes]:
    """Return a function of `pack`, header fields and a message, which packs them into one frame.

    It is compiled from source, because collecting the fields in a flat tuple would take as long as
    packing them.
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
        """Return the reader of ten words, or a reader that ignores a body of any other size.

        Raises BodyError if the size is no multiple of a word.
        """
        known = size % 4 or size == 40
        return super().reader(size if known else 0, byte_order)


class TrajectoryLayout:
    """Layout of JOINT_TRAJ, which has two variants.

    ROS-Industrial's C++ library writes the points, then their number. REP-I0006 specifies the
    number, then always ten points. Both variants are decoded. Only the library's is encoded,
    because existing programs use it.
    """

    msg_type = int(MessageType.JOINT_TRAJ)
    message_class: type[Message] = JointTraj

    def __init__(self, point: FixedLayout) -> None:
        self._point = point

    def encode(self, message: Message, dialect: Dialect) -> bytes:
        """Return the body. Raises FieldError if it has too many points or a value does not fit."""
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
        """Return the message and the width of its reals.

        Raises BodyError if the length is wrong for 32-bit and for 64-bit reals, or if the number
        of points is wrong.
        """
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
