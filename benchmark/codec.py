# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Codec: messages to bytes and back, beside bare `struct` on the same bytes.

Bare: one compiled format with the header, packed from numbers that lie ready and unpacked into a
flat tuple; no message, no check of the header, no search for where a frame ends. The driver's:
`encode` of a packet, and `PacketFramer` from bytes to the packet.
"""

import statistics
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    JointFeedback,
    JointPosition,
    JointTrajPt,
    JointTrajPtFull,
    PacketFramer,
    ReplyCode,
    Status,
    encode,
    reply,
    request,
    topic,
)

MAX_RATIO = 4.0
TEN = tuple(0.1 * number for number in range(10))

PACKETS = {
    'JOINT_POSITION': (topic(JointPosition(7, TEN)), '<4ii10f'),
    'JOINT_POSITION, a reply': (reply(JointPosition(7), ReplyCode.SUCCESS), '<4ii10f'),
    'STATUS': (topic(Status(1, 0, 0, 0, 1, 2, 1)), '<4i7i'),
    'JOINT_TRAJ_PT': (request(JointTrajPt(7, TEN, 0.5, 0.004)), '<4ii12f'),
    'JOINT_TRAJ_PT_FULL': (request(JointTrajPtFull(0, 7, 7, 0.1, TEN, TEN, TEN)), '<4i3i31f'),
    'JOINT_FEEDBACK': (topic(JointFeedback(0, 7, 0.1, TEN, TEN, TEN)), '<4i2i31f'),
}
"""What is measured: a packet, and its frame as `struct` has it."""


@dataclass(frozen=True)
class Codec:
    """One message: times in s to encode and to decode it, bare and the driver's."""

    name: str
    bare_encode: float
    bare_decode: float
    encode: float
    decode: float

    @property
    def ratio(self) -> float:
        """Driver to bare, there and back."""
        return (self.encode + self.decode) / (self.bare_encode + self.bare_decode)


@dataclass(frozen=True)
class Dribble:
    """Frames that come byte by byte: s per byte, of a bare loop over a bytearray and ours."""

    bare: float
    ours: float


def best(works: tuple[Callable[[], None], ...], rounds: int, calls: int) -> list[float]:
    """Return the time of one call of each, s: the best round, and the rounds in turn."""
    times = [float('inf')] * len(works)
    for _ in range(rounds):
        for place, work in enumerate(works):
            begin = time.perf_counter()
            work()
            times[place] = min(times[place], (time.perf_counter() - begin) / calls)
    return times


def codec(name: str, rounds: int, calls: int) -> Codec:
    """Measure one message."""
    packet, layout = PACKETS[name]
    data = encode(packet, LITTLE_ENDIAN)
    bare = struct.Struct(layout)
    numbers = bare.unpack(data)
    framer = PacketFramer()
    framer.receive_data(data)
    received = framer.next_packet()
    if received is None or encode(received, LITTLE_ENDIAN) != data or bare.size != len(data):
        raise AssertionError(f'{name} does not come back')

    def bare_encode() -> None:
        for _ in range(calls):
            bare.pack(*numbers)

    def bare_decode() -> None:
        for _ in range(calls):
            bare.unpack(data)

    def our_encode() -> None:
        for _ in range(calls):
            encode(packet, LITTLE_ENDIAN)

    def our_decode() -> None:
        for _ in range(calls):
            framer.receive_data(data)
            framer.next_packet()

    return Codec(name, *best((bare_encode, bare_decode, our_encode, our_decode), rounds, calls))


def dribble(rounds: int, frames: int) -> Dribble:
    """Measure frames that come byte by byte."""
    packet, layout = PACKETS['JOINT_POSITION']
    data = encode(packet, LITTLE_ENDIAN)
    chunks = [data[at : at + 1] for at in range(len(data))] * frames
    bare = struct.Struct(layout)
    prefix = struct.Struct('<i')

    def bare_loop() -> None:
        buffer, found = bytearray(), 0
        for chunk in chunks:
            buffer += chunk
            if len(buffer) >= 4 and len(buffer) >= 4 + prefix.unpack_from(buffer)[0]:
                bare.unpack(buffer)
                del buffer[: bare.size]
                found += 1
        if found != frames:
            raise AssertionError(found)

    def ours() -> None:
        framer, found = PacketFramer(), 0
        for chunk in chunks:
            framer.receive_data(chunk)
            found += framer.next_packet() is not None
        if found != frames:
            raise AssertionError(found)

    return Dribble(*best((bare_loop, ours), rounds, len(chunks)))


def measure(*, quick: bool) -> tuple[list[Codec], Dribble]:
    """Return the figures of every message, and of frames byte by byte."""
    rounds, calls = (7, 1000) if quick else (15, 5000)
    found = [codec(name, rounds, calls) for name in PACKETS]
    return found, dribble(rounds, calls // 50)


def main() -> int:
    """Print a row for each message; return 1 if a ratio is too large."""
    rows, bytewise = measure(quick='--quick' in sys.argv)
    print('message                    bare: encode  decode   driver: encode  decode   ratio')
    for row in rows:
        times = (row.bare_encode, row.bare_decode, row.encode, row.decode)
        bare_encode, bare_decode, ours, decode = (value * 1e6 for value in times)
        print(
            f'{row.name:26} {bare_encode:9.2f} us {bare_decode:6.2f} us {ours:11.2f} us'
            f' {decode:6.2f} us {row.ratio:7.2f}'
        )
    ratio = bytewise.ours / bytewise.bare
    print(f'byte by byte, per byte     {bytewise.bare * 1e9:6.0f} ns {bytewise.ours * 1e9:26.0f} ns {ratio:23.2f}')
    worst = max(row.ratio for row in rows)
    print(f'median ratio {statistics.median(row.ratio for row in rows):.2f}, at most {worst:.2f}')
    return 1 if worst > MAX_RATIO else 0


if __name__ == '__main__':
    sys.exit(main())
