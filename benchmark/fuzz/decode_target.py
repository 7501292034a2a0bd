# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Framer and decoder on arbitrary bytes: bounded memory, and no errors but their own."""

from benchmark.fuzz import messages
from benchmark.fuzz.cases import Case, FoundError, Step
from benchmark.fuzz.messages import Chance
from epson_driver.simple_message import (
    CommType,
    FieldError,
    FrameError,
    Framer,
    JointTraj,
    Opaque,
    Packet,
    Ping,
    SimpleMessageError,
    decode,
    encode,
)

MESSAGES_PER_CASE = 500

MAX_HELD_BYTES = 65_535 + 4 + 4_096


class _Decoder:
    """Decodes bytes. After a stream error it is reset, like for a new connection."""

    def __init__(self) -> None:
        self._framer = Framer()

    def take(self, data: bytes) -> None:
        """Decode a piece. Raises FoundError if a check fails."""
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
    """Check that a decoded message is encoded to the same bytes.

    The body of a PING has no meaning and is not stored. JOINT_TRAJ has two forms.
    """
    if isinstance(packet.message, (Opaque, Ping, JointTraj)):
        return
    try:
        again = encode(packet, packet.dialect)[16:]
    except FieldError as error:
        raise FoundError(f'{packet.message} was read and cannot be written: {error}') from error
    if again != body and 'nan' not in repr(packet.message):  # payloads of NaN may differ
        raise FoundError(f'{packet.message}: {body.hex()} was read, {again.hex()} is written')


class DecodeTarget:
    """Framer and decoder alone. They must encode each decoded message to the same bytes."""

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
        """Decode the stream. Raises FoundError, or any exception of framer and decoder."""
        decoder = _Decoder()
        for step in case.steps:
            decoder.take(step[2])
