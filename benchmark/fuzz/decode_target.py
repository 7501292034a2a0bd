# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Framer and decoder on bytes of any kind: nothing but their own errors, and bounded memory."""

from benchmark.fuzz import messages
from benchmark.fuzz.cases import Case, FoundError, Step
from benchmark.fuzz.messages import Chance
from epson_driver.simple_message import (
    CommType,
    FieldError,
    FrameError,
    Framer,
    Opaque,
    Packet,
    SimpleMessageError,
    decode,
    encode,
)

MESSAGES_PER_CASE = 500

MAX_HELD_BYTES = 65_535 + 4 + 4_096


class _Decoder:
    """Takes bytes; after an error of the stream it begins anew, as the next connection does."""

    def __init__(self) -> None:
        self._framer = Framer()

    def take(self, data: bytes) -> None:
        """Take a piece. Raises FoundError if something does not hold."""
        self._framer.receive_data(data)
        if len(self._framer.unread) > MAX_HELD_BYTES:
            raise FoundError(f'{len(self._framer.unread)} bytes are held')
        try:
            while (frame := self._framer.next_frame()) is not None:
                try:
                    packet = decode(frame)
                except SimpleMessageError:
                    continue
                if packet.comm_type is not CommType.SERVICE_REPLY:
                    _same(packet, frame.body)
        except FrameError:
            self._framer = Framer()


def _same(packet: Packet, body: bytes) -> None:
    """See that a message which was understood is written in the same bytes."""
    if isinstance(packet.message, Opaque) or packet.msg_type == 12:
        return
    try:
        again = encode(packet, packet.dialect)[16:]
    except FieldError as error:
        raise FoundError(f'{packet.message} was read and cannot be written: {error}') from error
    if again != body and 'nan' not in repr(packet.message):  # of a NaN only that it is one counts
        raise FoundError(f'{packet.message}: {body.hex()} was read, {again.hex()} is written')


class DecodeTarget:
    """Framer and decoder alone: what they take, they write again in the same bytes."""

    name = 'framer and decoder'

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return a stream of messages, in pieces."""
        order = chance.choice('<>')
        stream = b''
        for _ in range(MESSAGES_PER_CASE):
            data = messages.message(chance, order=order)
            if corpus and chance.random() < 0.2:
                data = chance.choice(corpus)
            if chance.random() < 0.6:
                data = messages.mutated(chance, data)
            stream += data
        steps: list[Step] = []
        while stream:
            size = chance.choice((1, 4, 16, 56, 60, 200))
            steps.append(('send', '', stream[:size]))
            stream = stream[size:]
        return Case(self.name, tuple(steps))

    def run(self, case: Case) -> None:
        """Feed it. Raises FoundError, or whatever they raise."""
        decoder = _Decoder()
        for step in case.steps:
            decoder.take(step[2])
