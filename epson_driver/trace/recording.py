# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads a capture file as the events of its TCP connections."""

from dataclasses import dataclass
from pathlib import Path

from epson_driver.inputs import read_file
from epson_driver.link.connection import Address, WireEvent
from epson_driver.trace.pcap import Flag, PcapError, Segment, Stream, read_segments

Pair = frozenset[Address]
MAX_RECORDING_BYTES = 1_000_000_000  # 1 GB, because it is read into memory
CARRIES = (WireEvent.SENT, WireEvent.RECEIVED)


@dataclass(frozen=True, slots=True)
class Step:
    """One event of connection `number`, counted from 0. `time`: s since 1970."""

    time: float
    number: int
    server: Address
    event: WireEvent
    data: bytes = b''


class _Connection:
    def __init__(self, number: int, client: Address, server: Address) -> None:
        self.number = number
        self.client = client
        self.server = server
        self.ended: set[WireEvent] = set()
        self.streams = {client: Stream(), server: Stream()}

    @property
    def gap(self) -> str:
        lost = sum(
            len(data) for stream in self.streams.values() for data in stream.waiting.values()
        )
        host, port = self.server
        return (
            f'a packet to or from {host}:{port} is missing, with it {lost} bytes' if lost else ''
        )

    def steps(self, segment: Segment) -> list[Step]:
        by_client = segment.source == self.client
        steps = []
        data = self.streams[segment.source].take(segment)
        if data:
            steps.append(WireEvent.SENT if by_client else WireEvent.RECEIVED)
        if segment.flags & Flag.RST:
            steps.append(WireEvent.CLOSED if by_client else WireEvent.RESET)
        elif segment.flags & Flag.FIN:
            steps.append(WireEvent.CLOSED if by_client else WireEvent.ENDED)
        new = [step for step in steps if step not in self.ended]
        self.ended |= {WireEvent.CLOSED, WireEvent.ENDED, WireEvent.RESET}.intersection(new)
        return [
            Step(segment.time, self.number, self.server, step, data if step in CARRIES else b'')
            for step in new
        ]


class DamagedError(PcapError):
    """A file contains an invalid packet. `steps` are the events before it."""

    def __init__(self, text: str, steps: list[Step]) -> None:
        super().__init__(text)
        self.steps = steps


def read_recording(path: Path, gaps: list[str] | None = None) -> list[Step]:
    """Return all events of all connections in a pcap file.

    If the start of a connection was not captured, its lower port is assumed to be the server's. A
    sentence is appended to `gaps` for each connection with a missing packet. Raises DamagedError
    if only a part of the file is valid, PcapError if no part is valid, and InputError if the file
    is unreadable.
    """
    steps: list[Step] = []
    try:
        _read(path, steps, [] if gaps is None else gaps)
    except PcapError as error:
        if steps:
            raise DamagedError(str(error), steps) from error
        raise
    return steps


def _read(path: Path, steps: list[Step], gaps: list[str]) -> None:
    connections: dict[Pair, _Connection] = {}
    every: list[_Connection] = []
    for segment in read_segments(read_file(path, MAX_RECORDING_BYTES)):
        pair = frozenset({segment.source, segment.target})
        connection = connections.get(pair)
        opens = segment.flags & (Flag.SYN | Flag.ACK) == Flag.SYN
        if connection is None or (opens and connection.ended):
            client, server = _client_first(segment, opens=opens)
            connection = connections[pair] = _Connection(len(every), client, server)
            every.append(connection)
            steps.append(Step(segment.time, connection.number, server, WireEvent.OPENED))
        steps += connection.steps(segment)
    gaps += filter(None, (connection.gap for connection in every))


def _client_first(segment: Segment, *, opens: bool) -> tuple[Address, Address]:
    answers = segment.flags & Flag.SYN and not opens  # the second packet of a handshake
    if opens or (not answers and segment.source[1] > segment.target[1]):
        return segment.source, segment.target
    return segment.target, segment.source
