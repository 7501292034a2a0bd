# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Codec: messages to bytes and back, beside bare `struct` on the same bytes.

Bare: compiled formats. A frame is packed from the fields' values; it is unpacked in two steps, as
only the header says what follows, into values for the fields. There is no message, no check of
the header, no search for where a frame ends. Barest: one format, packed from a flat tuple and
unpacked into one, for a program that knows beforehand what comes. The driver's: `encode` of a
packet, and `PacketFramer` from bytes to the packet.
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
    Packet,
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

Fields = Callable[[tuple[float, ...]], object]

PACKETS: dict[str, tuple[Packet, str, Fields]] = {
    'JOINT_POSITION': (topic(JointPosition(7, TEN)), 'i10f', lambda v: (v[0], v[1:])),
    'JOINT_POSITION, a reply': (
        reply(JointPosition(7), ReplyCode.SUCCESS),
        'i10f',
        lambda v: (v[0], v[1:]),
    ),
    'STATUS': (topic(Status(1, 0, 0, 0, 1, 2, 1)), '7i', lambda v: v),
    'JOINT_TRAJ_PT': (
        request(JointTrajPt(7, TEN, 0.5, 0.004)),
        'i12f',
        lambda v: (v[0], v[1:11], v[11], v[12]),
    ),
    'JOINT_TRAJ_PT_FULL': (
        request(JointTrajPtFull(0, 7, 7, 0.1, TEN, TEN, TEN)),
        '3i31f',
        lambda v: (v[0], v[1], v[2], v[3], v[4:14], v[14:24], v[24:]),
    ),
    'JOINT_FEEDBACK': (
        topic(JointFeedback(0, 7, 0.1, TEN, TEN, TEN)),
        '2i31f',
        lambda v: (v[0], v[1], v[2], v[3:13], v[13:23], v[23:]),
    ),
}
"""What is measured: a packet, its body as `struct` has it, and the fields of the body's values."""


@dataclass(frozen=True)
class Codec:
    """One message: times in s to encode and to decode it, bare and the driver's.

    barest: both together, for a program that knows what comes.
    """

    name: str
    barest: float
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
    """Return the CPU time of one call of each, s: the best round, and the rounds in turn."""
    times = [float('inf')] * len(works)
    for _ in range(rounds):
        for place, work in enumerate(works):
            begin = time.thread_time()
            work()
            times[place] = min(times[place], (time.thread_time() - begin) / calls)
    return times


def codec(name: str, rounds: int, calls: int) -> Codec:
    """Measure one message."""
    packet, layout, fields = PACKETS[name]
    data = encode(packet, LITTLE_ENDIAN)
    frame, header, body = (struct.Struct('<' + each) for each in ('4i' + layout, '4i', layout))
    words, flat = header.unpack_from(data), body.unpack_from(data, header.size)
    numbers = (*words, *flat)
    length, msg_type, comm_type, reply_code = words
    framer = PacketFramer()
    framer.receive_data(data)
    received = framer.next_packet()
    if received is None or encode(received, LITTLE_ENDIAN) != data or frame.size != len(data):
        raise AssertionError(f'{name} does not come back')

    def barest() -> None:
        for _ in range(calls):
            frame.pack(*numbers)
            frame.unpack(data)

    def bare_encode() -> None:
        for _ in range(calls):
            frame.pack(length, msg_type, comm_type, reply_code, *flat)

    def bare_decode() -> None:
        for _ in range(calls):
            header.unpack_from(data)
            fields(body.unpack_from(data, 16))

    def our_encode() -> None:
        for _ in range(calls):
            encode(packet, LITTLE_ENDIAN)

    def our_decode() -> None:
        for _ in range(calls):
            framer.receive_data(data)
            framer.next_packet()

    works = (barest, bare_encode, bare_decode, our_encode, our_decode)
    return Codec(name, *best(works, rounds, calls))


def dribble(rounds: int, frames: int) -> Dribble:
    """Measure frames that come byte by byte."""
    packet, layout, _ = PACKETS['JOINT_POSITION']
    data = encode(packet, LITTLE_ENDIAN)
    chunks = [data[at : at + 1] for at in range(len(data))] * frames
    bare = struct.Struct('<4i' + layout)
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
    print('message, us                bare: encode  decode   driver: encode  decode   ratio')
    for row in rows:
        times = (row.bare_encode, row.bare_decode, row.encode, row.decode)
        one, other, ours, back = (value * 1e6 for value in times)
        print(
            f'{row.name:26} {one:12.2f} {other:7.2f} {ours:16.2f} {back:7.2f} {row.ratio:7.2f}'
            f'   to the barest {(row.encode + row.decode) / row.barest:.2f}'
        )
    ratio = bytewise.ours / bytewise.bare
    print(f'byte by byte, ns per byte: {bytewise.bare * 1e9:.0f}, ours {bytewise.ours * 1e9:.0f}')
    print(f'ratio of these {ratio:.2f}')
    worst = max(row.ratio for row in rows)
    print(f'median ratio {statistics.median(row.ratio for row in rows):.2f}, at most {worst:.2f}')
    return 1 if worst > MAX_RATIO else 0


if __name__ == '__main__':
    sys.exit(main())
