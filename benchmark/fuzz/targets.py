# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of the fuzzer and their shares of the inputs; framer, decoder and remote client."""

import asyncio
from typing import Protocol

from benchmark.fuzz import messages
from benchmark.fuzz.cases import Case, FoundError, Step
from benchmark.fuzz.controller_target import ControllerTarget
from benchmark.fuzz.driver_target import DriverTarget
from benchmark.fuzz.memory_server import ServedEnd, listen, new_loop
from benchmark.fuzz.messages import Chance
from epson_driver.remote_ethernet.client import RemoteError, execute
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


COMMANDS = ('GetStatus', 'SetMotorsOn,1', 'Reset', 'SetIO,1,1')
INPUTS_PER_CASE = 60
PORT = 4
TIMEOUT_S = 5.0


class RemoteClientTarget:
    """Commands to a server that answers, truncates its answers, or disconnects."""

    name = 'client of Remote Ethernet'

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return the sequence of answers."""
        steps: list[Step] = []
        for _ in range(INPUTS_PER_CASE):
            draw = chance.random()
            if draw < 0.05:
                steps.append(('do', 'hang up'))
                continue
            data = messages.answer(chance, chance.choice((b'Login,', *map(str.encode, COMMANDS))))
            if draw < 0.5:
                data = b''  # the right answer
            elif draw < 0.8:
                data = messages.mutated(chance, data)
            steps.append(('send', 'remote', data))
        return Case(self.name, tuple(steps))

    def run(self, case: Case) -> None:
        """Send commands until all answers are used. Raises exceptions that no caller expects."""
        loop = new_loop()
        answers = list(reversed(case.steps))

        def accept(end: ServedEnd) -> None:
            def on_bytes(data: bytes) -> None:
                step = answers.pop() if answers else ('do', 'hang up')
                if step[0] != 'send':
                    end.hang_up()
                    return
                right = b'#' + data.removeprefix(b'$').split(b',')[0].strip() + b',0\r\n'
                end.feed(step[2] or right)

            end.on_bytes = on_bytes

        listen(loop, PORT, accept)

        async def give() -> None:
            while answers:
                left = len(answers)
                try:
                    await execute('127.0.0.1', PORT, COMMANDS, TIMEOUT_S)
                except (RemoteError, TimeoutError, ConnectionError):
                    if left == len(answers):
                        return

        try:
            loop.run_until_complete(asyncio.wait_for(give(), 1e6))
        finally:
            loop.bury()


class Target(Protocol):
    """A target of the fuzzer."""

    name: str

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return a new case, determined by the random generator and the corpus."""

    def run(self, case: Case) -> None:
        """Run the case. Raises an exception if a check fails."""


KINDS = ('motion', 'state', 'io')


def in_process() -> dict[Target, float]:
    """Return the targets within this process, with their shares of the inputs."""
    targets: dict[Target, float] = {DecodeTarget(): 20.0, RemoteClientTarget(): 4.0}
    for armed in (False, True):
        for name in ('simulated', 'generic', 'fanuc', 'abb', 'motoman'):
            targets[ControllerTarget(name, KINDS, armed=armed)] = 3.0
        targets[ControllerTarget('spel', KINDS, armed=armed)] = 1.0
    targets[ControllerTarget('simulated', ('motion', 'state'), armed=True, smooth=True)] = 1.0
    targets[ControllerTarget('simulated', ('remote',), armed=False)] = 6.0
    targets[ControllerTarget('simulated', ('remote', *KINDS), armed=True)] = 4.0
    targets[ControllerTarget('spel', ('remote', *KINDS), armed=True)] = 1.0
    for name in ('simulated', 'abb', 'motoman'):
        for used in (False, True):
            targets[DriverTarget(name, used=used)] = 3.0
    return targets
