# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Messages of Real-time Motion Control: golden bytes, round trips, and invalid bytes."""

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.rtmc.messages import (
    JOINTS_DATA,
    MOVED_DATA,
    REPLY_DATA,
    TARGET_DATA,
    OperationMode,
    Request,
    RtmcError,
    RtmcMessage,
    RtmcStatus,
    decode,
    encode_text,
)

MOTORS_ON = bytes.fromhex('00010000 f003 0000 0100 0000 01000000 00')
WORD = st.integers(0, 0xFFFF)


def test_golden_bytes_of_motors_on():
    message = RtmcMessage(Request.SET_MOTORS, low=1)
    assert message.encode() == MOTORS_ON
    assert decode(MOTORS_ON) == message


def test_golden_bytes_of_a_status():
    status = RtmcStatus(False, True, OperationMode.TEACH, 5042, 7)
    data = bytes.fromhex(
        '00 01 0200 b213 0700 01000000 ffffffff 03000000 04000000 05000000 06000000'
    )
    assert RtmcStatus.decode(RtmcMessage(Request.STATUS, 0, 1, data)) == status
    assert status.encode() == data[:8] + bytes(24)


def test_sizes_that_the_genuine_client_requires():
    sizes = {number: layout.size for number, layout in REPLY_DATA.items()}
    assert sizes == {
        0: 32, 1: 48, 100: 32, 101: 48, 102: 2, 1014: 64, 1015: 48, 1020: 2, 1021: 2, 1022 + 1: 8
    }  # fmt: skip
    assert TARGET_DATA.size == 50


def test_reply_to_a_target_has_its_padding():
    data = MOVED_DATA.pack(1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0x800000)
    assert data[:8] == b'\1' + bytes(7)
    assert data[48:56] == bytes.fromhex('000000000000f03f')
    assert data[56:] == bytes.fromhex('0000800000000000')


@given(WORD, WORD, WORD, st.binary(max_size=100))
def test_round_trip_of_a_message(number, low, high, data):
    message = RtmcMessage(number, low, high, data)
    assert decode(message.encode()) == message


@given(st.booleans(), st.booleans(), st.sampled_from(OperationMode), WORD, WORD)
def test_round_trip_of_a_status(safeguard, estop, mode, error, warning):
    status = RtmcStatus(safeguard, estop, mode, error, warning)
    assert RtmcStatus.decode(RtmcMessage(Request.STATUS, 0, 1, status.encode())) == status


def test_warning_comes_before_error_each_with_nul():
    assert encode_text('bad') == b'\0\0' + b'\4\0bad\0'


@pytest.mark.parametrize('padding', range(4))
def test_padding_at_the_end_is_accepted(padding):
    assert decode(MOTORS_ON + bytes(padding)).low == 1


@pytest.mark.parametrize(
    'data',
    [
        b'',
        MOTORS_ON[:-1],
        MOTORS_ON + bytes(4),
        b'\0\0' + MOTORS_ON[2:],  # big-endian
        MOTORS_ON[:12] + b'\xff\xff\xff\xff' + MOTORS_ON[16:],
    ],
)
def test_invalid_bytes_are_an_error(data):
    with pytest.raises(RtmcError):
        decode(data)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_message_or_an_error(data):
    for read in (RtmcStatus.decode, lambda known: known.values(JOINTS_DATA)):
        with suppress(RtmcError):
            read(decode(data))


def test_data_of_another_size_is_an_error():
    message = RtmcMessage(Request.MOVE, data=bytes(49))
    with pytest.raises(RtmcError, match='49 bytes of data: must be 50'):
        message.values(TARGET_DATA)


def test_unknown_operation_mode_is_an_error():
    data = bytearray(RtmcStatus(False, False, OperationMode.AUTO).encode())
    data[2] = 3
    with pytest.raises(RtmcError, match='operation mode 3'):
        RtmcStatus.decode(RtmcMessage(Request.STATUS, 0, 1, bytes(data)))


def test_special_numbers_pass_unchanged():
    data = JOINTS_DATA.pack(math.nan, math.inf, -0.0, 1e-320, 0.0, 0.0)
    values = RtmcMessage(Request.JOINTS, data=data).values(JOINTS_DATA)
    assert math.isnan(values[0])
    assert values[1] == math.inf
