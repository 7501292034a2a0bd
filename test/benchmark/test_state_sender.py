# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The messages of the state benchmark."""

from benchmark.state_sender import STATUS, STEP_RAD, frame
from epson_driver.simple_message import JointPosition, PacketFramer, Status


def test_messages_are_numbered_exactly() -> None:
    framer = PacketFramer()
    for number in (1, 77, 500_000, 900_001):
        framer.receive_data(frame(number) + STATUS)
        packet, status = framer.next_packet(), framer.next_packet()
        assert packet is not None
        assert status is not None
        assert isinstance(packet.message, JointPosition)
        assert packet.message.joints[0] == number * STEP_RAD
        assert round(packet.message.joints[5] / STEP_RAD) == number
        assert isinstance(status.message, Status)
