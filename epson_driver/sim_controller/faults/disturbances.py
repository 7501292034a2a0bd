# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The effects of connection faults on a message to the client, as a table."""

import random
import struct
from collections.abc import Callable
from dataclasses import dataclass

from epson_driver.sim_controller.faults.fault_kinds import Fault
from epson_driver.simple_message import ByteOrder, CommType

_WORD_BYTES = 4
_HEADER_BYTES = 16
_COMM_TYPE_OFFSET = 8  # after length and msg_type


@dataclass(slots=True)
class OutgoingMessage:
    """One message to the client, and how it is sent. Faults modify both.

    * `data`: bytes (empty: the message is lost).
    * `delay`: time until the message is sent, s.
    * `gather`: time for which messages are collected and then sent together, s.
    * `one_byte`: whether each byte is sent separately.
    """

    data: bytes
    delay: float = 0.0
    gather: float = 0.0
    one_byte: bool = False


Disturbance = Callable[[OutgoingMessage, Fault, random.Random], None]


def lose(outgoing: OutgoingMessage, _fault: Fault, _chance: random.Random) -> None:
    outgoing.data = b''


def delay(outgoing: OutgoingMessage, fault: Fault, _chance: random.Random) -> None:
    outgoing.delay += fault.number('seconds')


def jitter(outgoing: OutgoingMessage, fault: Fault, chance: random.Random) -> None:
    outgoing.delay += chance.random() * fault.number('seconds')


def coalesce(outgoing: OutgoingMessage, fault: Fault, _chance: random.Random) -> None:
    outgoing.gather = max(outgoing.gather, fault.number('seconds'))


def one_byte(outgoing: OutgoingMessage, _fault: Fault, _chance: random.Random) -> None:
    outgoing.one_byte = True


def bit_errors(outgoing: OutgoingMessage, fault: Fault, chance: random.Random) -> None:
    if chance.random() >= fault.number('rate'):
        return
    data = bytearray(outgoing.data)
    bits = 8 * len(data)
    for bit in chance.sample(range(bits), min(bits, int(fault.number('bits')))):
        data[bit // 8] ^= 1 << bit % 8
    outgoing.data = bytes(data)


def wrong_length(outgoing: OutgoingMessage, fault: Fault, _chance: random.Random) -> None:
    """Overwrite the length field with the fault's `value`, or add the fault's `add` to it."""
    order = byte_order(outgoing.data)
    if order is None:  # already disturbed by another fault
        return
    value = fault.values['value']
    length = len(outgoing.data) - _WORD_BYTES + fault.number('add') if value is None else value
    outgoing.data = struct.pack(order.value + 'i', int(length)) + outgoing.data[_WORD_BYTES:]


def wrong_byte_order(outgoing: OutgoingMessage, _fault: Fault, _chance: random.Random) -> None:
    """Reverse the bytes of every whole word."""
    data = outgoing.data
    end = len(data) - len(data) % _WORD_BYTES
    words = (data[start : start + _WORD_BYTES][::-1] for start in range(0, end, _WORD_BYTES))
    outgoing.data = b''.join(words) + data[end:]


DISTURBANCES: dict[str, Disturbance] = {
    'half_open': lose,
    'delay': delay,
    'jitter': jitter,
    'coalesce': coalesce,
    'one_byte': one_byte,
    'bit_errors': bit_errors,
    'wrong_length': wrong_length,
    'lost_reply': lose,
    'late_reply': delay,
    'wrong_byte_order': wrong_byte_order,
}


def byte_order(message: bytes) -> ByteOrder | None:
    """Return the byte order in which the length field of a message is correct, or None."""
    if len(message) < _WORD_BYTES:
        return None
    for order in ByteOrder:
        if struct.unpack_from(order.value + 'i', message)[0] == len(message) - _WORD_BYTES:
            return order
    return None


def is_reply(message: bytes) -> bool:
    order = byte_order(message)
    if order is None or len(message) < _HEADER_BYTES:
        return False
    comm_type: int = struct.unpack_from(order.value + 'i', message, _COMM_TYPE_OFFSET)[0]
    return comm_type == CommType.SERVICE_REPLY
