# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The header rules of REP-I0006, the sizes of the bodies, and errors that name the field."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wire_examples import DIALECTS, INT32, ZEROS, bits, frames_of

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    BodyError,
    ByteOrder,
    CommType,
    Dialect,
    FieldError,
    Frame,
    GetVersion,
    HeaderError,
    JointFeedback,
    JointPosition,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    Opaque,
    PacketFramer,
    Ping,
    Real,
    ReplyCode,
    Status,
    decode,
    encode,
    joint_data,
    request,
)
from epson_driver.simple_message.packets import check_header

# message, then (body, length, wire) in float32 and in float64
SIZES: tuple[tuple[Message, tuple[int, int, int], tuple[int, int, int]], ...] = (
    (Ping(), (0, 12, 16), (0, 12, 16)),
    (Ping((0,) * 10), (40, 52, 56), (40, 52, 56)),
    (GetVersion(), (0, 12, 16), (0, 12, 16)),
    (GetVersion((1, 2, 3)), (12, 24, 28), (12, 24, 28)),
    (JointPosition(), (44, 56, 60), (84, 96, 100)),
    (JointTrajPt(0), (52, 64, 68), (100, 112, 116)),
    (Status(), (28, 40, 44), (28, 40, 44)),
    (JointTrajPtFull(0, 0, 0), (136, 148, 152), (260, 272, 276)),
    (JointFeedback(0, 0), (132, 144, 148), (256, 268, 272)),
    (JointTraj(), (4, 16, 20), (4, 16, 20)),
    (JointTraj((JointTrajPt(0),) * 3), (160, 172, 176), (304, 316, 320)),
    (JointTraj((JointTrajPt(0),) * 200), (10404, 10416, 10420), (20004, 20016, 20020)),
)

SIZES_OF_TYPE = {
    1: ('Ping', '0 or 40'),
    2: ('GetVersion', '0 or 12'),
    10: ('JointPosition', '44 or 84'),
    11: ('JointTrajPt', '52 or 100'),
    13: ('Status', '28'),
    14: ('JointTrajPtFull', '136 or 260'),
    15: ('JointFeedback', '132 or 256'),
}


@pytest.mark.parametrize(('message', 'float32', 'float64'), SIZES, ids=lambda x: str(x)[:30])
@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
def test_sizes_on_the_wire(
    dialect: Dialect,
    message: Message,
    float32: tuple[int, int, int],
    float64: tuple[int, int, int],
) -> None:
    wire = encode(request(message), dialect)
    (length,) = struct.unpack_from(dialect.byte_order.value + 'i', wire)
    expected = float32 if dialect.real is Real.FLOAT32 else float64
    assert (len(wire) - 16, length, len(wire)) == expected


@pytest.mark.parametrize(
    ('header', 'text'),
    [
        ((0, 1, 0), 'msg_type = 0: must be positive (0 is reserved)'),
        ((-10, 1, 0), 'msg_type = -10: must be positive (0 is reserved)'),
        ((10, 0, 0), 'comm_type = 0: must be 1 (topic), 2 (request) or 3 (reply)'),
        ((10, 4, 0), 'comm_type = 4: must be 1 (topic), 2 (request) or 3 (reply)'),
        ((10, -1, 0), 'comm_type = -1: must be 1 (topic), 2 (request) or 3 (reply)'),
        ((10, 1, 1), 'reply_code = 1: must be 0 in topics and requests'),
        ((10, 2, 2), 'reply_code = 2: must be 0 in topics and requests'),
        ((10, 3, 0), 'reply_code = 0: must be 1 (success) or 2 (failure) in a reply'),
        ((10, 3, 3), 'reply_code = 3: must be 1 (success) or 2 (failure) in a reply'),
        ((7, 9, 9), 'comm_type = 9: must be 1 (topic), 2 (request) or 3 (reply)'),
    ],
)
def test_header_error_names_the_field(header: tuple[int, int, int], text: str) -> None:
    with pytest.raises(HeaderError) as error:
        decode(Frame(*header, bytes(44), ByteOrder.LITTLE))
    assert str(error.value) == text
    assert error.value.field == text.split(' ', 1)[0]


@given(
    msg_type=st.integers(-2, 20) | INT32,
    comm_type=st.integers(-1, 4) | INT32,
    reply_code=st.integers(-1, 3) | INT32,
)
def test_header_is_accepted_exactly_by_the_rules_of_rep_i0006(
    msg_type: int, comm_type: int, reply_code: int
) -> None:
    legal = msg_type > 0 and (
        (comm_type in (1, 2) and reply_code == 0) or (comm_type == 3 and reply_code in (1, 2))
    )
    frame = Frame(msg_type, comm_type, reply_code, b'', ByteOrder.LITTLE)
    if legal:
        assert check_header(frame) == (CommType(comm_type), ReplyCode(reply_code))
    else:
        with pytest.raises(HeaderError):
            check_header(frame)


@pytest.mark.parametrize(('msg_type', 'row'), SIZES_OF_TYPE.items(), ids=str)
@pytest.mark.parametrize('comm_type', [1, 2])
def test_body_error_names_the_type_and_its_sizes(
    comm_type: int, msg_type: int, row: tuple[str, str]
) -> None:
    name, sizes = row
    allowed = {int(size) for size in sizes.split(' or ')}
    if name == 'Ping':  # with the field of an older message class
        allowed |= set(range(0, 300, 4))
    for size in range(300):
        frame = Frame(msg_type, comm_type, 0, bytes(size), ByteOrder.LITTLE)
        if size in allowed:
            packet = decode(frame)
            assert type(packet.message).__name__ == name
            framer = PacketFramer()
            framer.receive_data(struct.pack('<4i', 12 + size, *frame[:3]) + frame.body)
            assert framer.next_packet() == packet
            continue
        with pytest.raises(BodyError) as error:
            decode(frame)
        assert error.value.field == 'body'
        assert (
            str(error.value) == f"body = '{size} bytes': {name} (msg_type {msg_type}) has {sizes}"
        )


@pytest.mark.parametrize('msg_type', [*SIZES_OF_TYPE, 12])
@pytest.mark.parametrize('code', [ReplyCode.SUCCESS, ReplyCode.FAILURE])
def test_reply_may_have_any_body(code: ReplyCode, msg_type: int) -> None:
    for size in range(300):
        packet = decode(Frame(msg_type, 3, code, b'\x55' * size, ByteOrder.BIG))
        assert (packet.msg_type, packet.comm_type) == (msg_type, CommType.SERVICE_REPLY)
        assert packet.reply_code is code
        if isinstance(packet.message, Opaque):
            assert packet.message.body == b'\x55' * size


@pytest.mark.parametrize(
    ('message', 'text'),
    [
        (JointPosition(0, (*ZEROS[:9],)), "joints = '9 values': must have 10"),
        (JointPosition(0, (*ZEROS, 0.0)), "joints = '11 values': must have 10"),
        (JointPosition(2**31), 'sequence = 2147483648: must be an int32'),
        (JointPosition(0.5), 'sequence = 0.5: must be an int32'),  # type: ignore[arg-type]
        (JointPosition(None), 'sequence = None: must be an int32'),  # type: ignore[arg-type]
        (
            JointPosition(0, joint_data((0.0, 0.0, 0.0, 1e39))),
            'joints[3] = 1e+39: must fit float32',
        ),
        (
            JointPosition(0, joint_data((0.0, 'left'))),  # type: ignore[arg-type]
            "joints[1] = 'left': must fit float32",
        ),
        (JointTrajPt(0, velocity=-1e300), 'velocity = -1e+300: must fit float32'),
        (JointTrajPt(0, duration=10**400), f'duration = {10**400}: must fit float32'),
        (Status(mode=-(2**31) - 1), 'mode = -2147483649: must be an int32'),
        (Ping((0,) * 9), "padding = '9 values': must have 0 or 10"),
        (Ping((0,) * 9 + (2**40,)), 'padding[9] = 1099511627776: must be an int32'),
        (GetVersion((1, 2)), "version = '2 values': must have 0 or 3"),
        (
            JointFeedback(0, 0, accelerations=joint_data((0.0,) * 9 + (4e38,))),
            'accelerations[9] = 4e+38: must fit float32',
        ),
        (
            JointTraj((JointTrajPt(0), JointTrajPt(1), JointTrajPt(2, joint_data((0.0, 1e39))))),
            'points[2].joints[1] = 1e+39: must fit float32',
        ),
        (JointTraj((JointTrajPt(0, ()),)), "points[0].joints = '0 values': must have 10"),
        (JointTraj((JointTrajPt(0),) * 201), 'points = 201: at most 200'),
        (Opaque(2**31), 'msg_type = 2147483648: must be an int32'),
        (
            Opaque(1500, bytes(65524)),
            "body = '65524 bytes': a frame holds at most 65523 bytes of body",
        ),
    ],
    ids=lambda x: x[:40] if isinstance(x, str) else type(x).__name__,
)
def test_encode_error_names_the_field(message: Message, text: str) -> None:
    with pytest.raises(FieldError) as error:
        encode(request(message), LITTLE_ENDIAN)
    assert str(error.value) == text
    assert error.value.field == text.split(' = ', 1)[0]


def test_value_beyond_float32_is_encoded_in_float64() -> None:
    message = JointPosition(0, joint_data((1e39,)))
    wire = encode(request(message), Dialect(real=Real.FLOAT64))
    assert decode(frames_of(wire)[0]).message == message


def test_longest_body_is_accepted() -> None:
    message = Opaque(1500, bytes(65523))
    (frame,) = frames_of(encode(request(message), LITTLE_ENDIAN))
    assert decode(frame).message == message


def test_joint_data_has_ten_values_filled_with_zeros() -> None:
    assert joint_data((1.0, 2.0)) == (1.0, 2.0) + (0.0,) * 8
    assert joint_data([]) == (0.0,) * 10
    assert joint_data(range(10)) == tuple(range(10))
    with pytest.raises(ValueError, match='11 joints: a message carries at most 10'):
        joint_data((0.0,) * 11)


@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@pytest.mark.parametrize('count', [0, 1, 9, 10, 13, 26, 200])
def test_joint_traj_in_the_form_of_the_cpp_library(dialect: Dialect, count: int) -> None:
    points = trajectory_points(count)
    body = b''.join(point_bytes(point, dialect) for point in points)
    body += struct.pack(dialect.byte_order.value + 'i', count)
    packet = decode(Frame(12, 2, 0, body, dialect.byte_order))
    assert packet.message == JointTraj(points)
    assert encode(packet, dialect)[16:] == body
    if count:
        assert packet.dialect == dialect


@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@pytest.mark.parametrize('count', [0, 1, 5, 10])
def test_joint_traj_in_the_form_of_rep_i0006(dialect: Dialect, count: int) -> None:
    points = trajectory_points(count)
    unused = (JointTrajPt(0),) * (10 - count)
    body = struct.pack(dialect.byte_order.value + 'i', count)
    body += b''.join(point_bytes(point, dialect) for point in (*points, *unused))
    packet = decode(Frame(12, 2, 0, body, dialect.byte_order))
    assert packet.message == JointTraj(points)
    assert packet.dialect == dialect


@pytest.mark.parametrize(
    'body',
    [
        b'',
        bytes(3),
        struct.pack('<i', 1),  # one point announced, none sent
        bytes(52),  # no number of points
        bytes(52) + struct.pack('<i', 2),
        bytes(52 * 2) + struct.pack('<i', 1),
        struct.pack('<i', 11) + bytes(520),  # too long for REP-I0006's form
        struct.pack('<i', -1) + bytes(520),
        bytes(52 * 201) + struct.pack('<i', 201),
        bytes(100 * 201) + struct.pack('<i', 201),
        bytes(53) + struct.pack('<i', 1),
    ],
    ids=lambda body: f'{len(body)} bytes',
)
def test_joint_traj_with_a_wrong_number_of_points_is_refused(body: bytes) -> None:
    with pytest.raises(BodyError) as error:
        decode(Frame(12, 2, 0, body, ByteOrder.LITTLE))
    assert str(error.value) == (
        f"body = '{len(body)} bytes': JointTraj: length or number of points is wrong"
    )


@pytest.mark.invariant(8)
def test_inv8_points_of_a_joint_traj_are_bit_exact() -> None:
    odd = JointTrajPt(-3, (float('nan'), -0.0, float('inf'), float('-inf'), *ZEROS[4:]), 1.0, -0.0)
    (frame,) = frames_of(encode(request(JointTraj((odd, odd))), LITTLE_ENDIAN))
    assert bits(decode(frame).message) == bits(JointTraj((odd, odd)))


def trajectory_points(count: int) -> tuple[JointTrajPt, ...]:
    return tuple(
        JointTrajPt(index, joint_data((index / 4, -index / 8)), 0.5, 0.25)
        for index in range(1, count + 1)
    )


def point_bytes(point: JointTrajPt, dialect: Dialect) -> bytes:
    order, real = dialect.byte_order.value, dialect.real.value
    reals = (*point.joints, point.velocity, point.duration)
    return struct.pack(f'{order}i12{real}', point.sequence, *reals)
