# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Bytes of real peers with their meaning, and strategies for messages of every type."""

import struct
from dataclasses import dataclass, fields, is_dataclass
from itertools import product

from hypothesis import strategies as st

from epson_driver.simple_message import (
    ByteOrder,
    CommType,
    Dialect,
    Frame,
    Framer,
    GetVersion,
    JointFeedback,
    JointPosition,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    Opaque,
    Packet,
    Ping,
    Real,
    ReplyCode,
    SpecialSequence,
    Status,
    reply,
    request,
    topic,
)
from epson_driver.simple_message.layouts import LAYOUT_OF_TYPE

DIALECTS = tuple(Dialect(order, real) for order, real in product(ByteOrder, Real))
ZEROS = (0.0,) * 10


@dataclass(frozen=True)
class Example:
    """A little endian frame in hex words, and its packet."""

    name: str
    words: str
    packet: Packet

    @property
    def little(self) -> bytes:
        """The frame in little endian."""
        return bytes.fromhex(self.words)

    @property
    def big(self) -> bytes:
        """The frame in big endian."""
        return reversed_words(self.little)


def reversed_words(data: bytes) -> bytes:
    """Reverse the bytes of every 32-bit word, to change the byte order."""
    return b''.join(data[at : at + 4][::-1] for at in range(0, len(data), 4))


EXAMPLES = (
    Example(
        'JOINT_POSITION, thesis figure 4',
        '38000000 0a000000 01000000 00000000  00000000'
        'fad91ab8 126383b6 f543c0b7 1615b8b8 55d065b8 5e36b6b8' + '00' * 16,
        topic(
            JointPosition(
                0,
                (
                    -3.69194677e-05,
                    -3.91563754e-06,
                    -2.29198286e-05,
                    -8.77773127e-05,
                    -5.47918789e-05,
                    -8.68856296e-05,
                    0.0,
                    0.0,
                    0.0,
                    0.0,
                ),
            )
        ),
    ),
    Example(
        'STATUS, thesis figure 5',
        '28000000 0d000000 01000000 00000000'
        '01000000 ffffffff 00000000 00000000 00000000 02000000 01000000',
        topic(
            Status(
                drives_powered=1,
                e_stopped=-1,
                error_code=0,
                in_error=0,
                in_motion=0,
                mode=2,
                motion_possible=1,
            )
        ),
    ),
    Example(
        'JOINT_TRAJ_PT, thesis figure 6',
        '40000000 0b000000 02000000 00000000  01000000'
        '000060a7 e8cda73e 579e5dbf db0f49c0 5f81343f db0f49c0' + '00' * 16 + 'cdcccc3d 0000a040',
        request(
            JointTrajPt(
                1,
                (
                    -7 * 2.0**-51,  # printed as -3.1e-15
                    0.327742815,
                    -0.865697324,
                    -3.141592741,
                    0.705099046,
                    -3.141592741,
                    0.0,
                    0.0,
                    0.0,
                    0.0,
                ),
                velocity=0.1,
                duration=5.0,
            )
        ),
    ),
    Example(
        'STOP of the ROS 1 client',
        '40000000 0b000000 02000000 00000000 fcffffff' + '00' * 48,
        request(JointTrajPt(SpecialSequence.STOP_TRAJECTORY)),
    ),
    Example(
        'PING request of the C++ library',
        '0c000000 01000000 02000000 00000000',
        request(Ping()),
    ),
    Example(
        'PING reply of the C++ library',
        '0c000000 01000000 03000000 01000000',
        reply(Ping(), ReplyCode.SUCCESS),
    ),
    Example(
        'PING request of REP-I0006',
        '34000000 01000000 02000000 00000000' + '00' * 40,
        request(Ping((0,) * 10)),
    ),
    Example(
        "the EPSON program's usual reply",
        '38000000 0a000000 03000000 01000000' + '00' * 44,
        reply(JointPosition(), ReplyCode.SUCCESS),
    ),
    Example(
        "FANUC's usual reply, with the sequence",
        '38000000 0a000000 03000000 01000000 07000000' + '00' * 40,
        reply(JointPosition(7), ReplyCode.SUCCESS),
    ),
    Example(
        'reply without a body',
        '0c000000 0b000000 03000000 01000000',
        reply(Opaque(11), ReplyCode.SUCCESS),
    ),
    Example(
        'FAILURE reply with a garbage body',
        '10000000 0b000000 03000000 02000000 a55a5aa5',
        reply(Opaque(11, b'\xa5\x5a\x5a\xa5'), ReplyCode.FAILURE),
    ),
    Example(
        'GET_VERSION reply',
        '18000000 02000000 03000000 01000000 01000000 02000000 03000000',
        reply(GetVersion((1, 2, 3)), ReplyCode.SUCCESS),
    ),
)


def frames_of(data: bytes, framer: Framer | None = None) -> list[Frame]:
    """Return the frames of a stream received in one piece."""
    framer = framer or Framer()
    framer.receive_data(data)
    return drain(framer)


def drain(framer: Framer) -> list[Frame]:
    """Return the frames that are complete."""
    return list(iter(framer.next_frame, None))


def bits(value: object) -> object:
    """Return a message or a part with floats as bytes, to compare NaN and -0.0."""
    if is_dataclass(value):
        return type(value), *(bits(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, tuple):
        return tuple(bits(item) for item in value)
    return struct.pack('<d', value) if isinstance(value, float) else value


def _float32(word: int) -> float:
    if word & 0x7F800000 == 0x7F800000 and word & 0x7FFFFF:
        word |= 0x400000  # Python and processors turn signalling NaN into quiet ones
    value: float = struct.unpack('<f', struct.pack('<I', word))[0]
    return value


INT32 = st.integers(-(2**31), 2**31 - 1)
SPECIAL = st.sampled_from([0.0, -0.0, float('inf'), float('-inf'), float('nan')])
FLOAT32 = SPECIAL | st.floats(width=32) | st.integers(0, 2**32 - 1).map(_float32)
REALS = {Real.FLOAT32: FLOAT32, Real.FLOAT64: SPECIAL | st.floats()}


def messages(real: Real) -> st.SearchStrategy[Message]:
    """Return a strategy for messages of every type."""
    number = REALS[real]
    ten = st.tuples(*[number] * 10)
    point = st.builds(JointTrajPt, INT32, ten, number, number)
    types = st.one_of(st.integers(1, 65535), st.integers(1, 2**31 - 1))
    vendor_types = types.filter(lambda msg_type: msg_type not in LAYOUT_OF_TYPE)
    return st.one_of(
        st.builds(Ping, st.just(()) | st.tuples(*[INT32] * 10)),
        st.builds(GetVersion, st.just(()) | st.tuples(INT32, INT32, INT32)),
        st.builds(JointPosition, INT32, ten),
        point,
        st.builds(JointTraj, st.lists(point, max_size=4).map(tuple)),
        st.builds(Status, *[INT32] * 7),
        st.builds(JointTrajPtFull, INT32, INT32, INT32, number, ten, ten, ten),
        st.builds(JointFeedback, INT32, INT32, number, ten, ten, ten),
        st.builds(Opaque, vendor_types, st.binary(max_size=100)),
    )


HEADERS = st.sampled_from(
    [
        (CommType.TOPIC, ReplyCode.INVALID),
        (CommType.SERVICE_REQUEST, ReplyCode.INVALID),
        (CommType.SERVICE_REPLY, ReplyCode.SUCCESS),
        (CommType.SERVICE_REPLY, ReplyCode.FAILURE),
    ]
)


def packets(dialect: Dialect) -> st.SearchStrategy[Packet]:
    """Return a strategy for packets with every kind of header."""
    return st.builds(
        lambda message, header: Packet(message, *header, dialect=dialect),
        messages(dialect.real),
        HEADERS,
    )
