# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O port of the simulated Motoman answers like MotoROS."""

import struct

import pytest

from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.io.io_points import IoPoints
from epson_driver.sim_controller.io.motoman_io_session import MotomanIoSession
from epson_driver.simple_message import LITTLE_ENDIAN, IoType

SUCCESS, FAILURE = 1, 2
PROFILE = load_controller_profile('motoman').io


class Peer:
    """A client that speaks in words, and the points."""

    def __init__(self):
        self.points = IoPoints(PROFILE)
        self._sent = bytearray()
        self.session = MotomanIoSession(self.points, LITTLE_ENDIAN, self._sent.extend)

    def ask(self, msg_type, *words, comm_type=2):
        """Return (msg_type, reply_code, words) of the reply."""
        length = 12 + 4 * len(words)
        body = struct.pack(f'<{4 + len(words)}i', length, msg_type, comm_type, 0, *words)
        self.session.receive(body)
        data, self._sent[:] = bytes(self._sent), b''
        _, kind, comm, code, *rest = struct.unpack(f'<{len(data) // 4}i', data)
        assert comm == 3
        return kind, code, tuple(rest)


@pytest.fixture
def peer():
    return Peer()


def test_bits_and_groups_are_read(peer):
    peer.points.set_input(IoType.DIGITAL_INPUT, 9, 1)
    assert peer.ask(2003, 21) == (2004, SUCCESS, (1, 0))
    assert peer.ask(2003, 20) == (2004, SUCCESS, (0, 0))
    assert peer.ask(2007, 2) == (2008, SUCCESS, (0b10, 0))


def test_outputs_are_written_and_read_back(peer):
    assert peer.ask(2005, 10010, 1) == (2006, SUCCESS, (0,))
    assert peer.ask(2009, 1002, 0x81) == (2010, SUCCESS, (0,))
    assert peer.ask(2003, 10010) == (2004, SUCCESS, (1, 0))
    assert peer.ask(2007, 1002) == (2008, SUCCESS, (0x81, 0))
    assert peer.points.read(IoType.DIGITAL_OUTPUT, 15) == 1


@pytest.mark.parametrize(
    ('request_words', 'answer'),
    [
        ((2003, 18), (2004, FAILURE, (0, 1001))),  # the last digit is a place in a group
        ((2003, 0), (2004, FAILURE, (0, 1001))),
        ((2003, -5), (2004, FAILURE, (0, 1001))),
        ((2003, 2**31 - 1), (2004, FAILURE, (0, 1001))),
        ((2007, 0), (2008, FAILURE, (0, 1001))),
        ((2007, 999), (2008, FAILURE, (0, 1001))),
        ((2005, 10, 1), (2006, FAILURE, (1002,))),  # an input
        ((2005, 10010, 2), (2006, FAILURE, (1003,))),
        ((2009, 1001, 256), (2010, FAILURE, (1003,))),
        ((2009, 1, 0), (2010, FAILURE, (1002,))),
    ],
)
def test_invalid_request_gets_the_result_of_motoros(peer, request_words, answer):
    assert peer.ask(*request_words) == answer


@pytest.mark.invariant(7)
@pytest.mark.parametrize('words', [(1,), (2003,), (2003, 10, 10), (65201, 1, 0), (2012, 0), (7,)])
def test_inv7_other_message_is_answered_with_ioctrl_reply(peer, words):
    kind, code, (result, subcode) = peer.ask(*words)
    assert (kind, code, result) == (2011, SUCCESS, 3)
    assert subcode in (3001, 3003)
    assert peer.ask(2003, 10) == (2004, SUCCESS, (0, 0))


def test_outputs_are_kept_after_a_lost_client_and_a_reset(peer):
    peer.ask(2005, 10010, 1)
    peer.session.closed()
    peer.points.reset()
    assert peer.points.read(IoType.DIGITAL_OUTPUT, 0) == 1
