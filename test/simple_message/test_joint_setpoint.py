# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""JOINT_SETPOINT: bytes made with struct alone, and back."""

import struct

import pytest
from wire_examples import frames_of

from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    BodyError,
    Dialect,
    Frame,
    JointSetpoint,
    decode,
    encode,
    request,
)

JOINTS = (0.5, -0.25, 0.125, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0)
VELOCITIES = (-1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0)


@pytest.mark.parametrize(
    ('order', 'dialect'), [('<', LITTLE_ENDIAN), ('>', BIG_ENDIAN)], ids=['little', 'big']
)
def test_a_setpoint_is_100_bytes_long(order: str, dialect: Dialect) -> None:
    """Its type lies in the range that REP-I0004 gives to EPSON, 1500 to 1599."""
    wire = struct.pack(order + '4ii21f', 100, 1510, 2, 0, 7, *JOINTS, *VELOCITIES, 0.25)
    assert len(wire) == 104
    message = JointSetpoint(7, JOINTS, VELOCITIES, 0.25)
    assert encode(request(message), dialect) == wire
    (frame,) = frames_of(wire)
    assert decode(frame).message == message


def test_a_setpoint_of_another_length_is_none() -> None:
    with pytest.raises(BodyError, match='JointSetpoint'):
        decode(Frame(1510, 2, 0, bytes(80), LITTLE_ENDIAN.byte_order))
