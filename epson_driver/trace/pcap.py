# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes classic pcap files of TCP conversations, without sockets or clock.

The writer does not have the packets that the kernel sent. It creates packets of a regular TCP
conversation with the same bytes, including handshake, sequence numbers, acknowledgements,
checksums and FIN. The reader also accepts captures of tcpdump and Wireshark, including
retransmissions.

The file format is specified in draft-ietf-opsawg-pcap, and the packets in RFC 791, 8200, 9293.
"""

import functools
import ipaddress
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Protocol

from epson_driver.link.connection import Address

MAX_SEGMENT_BYTES = 16384
"""Maximum number of bytes in a packet. Longer data is split, because of IPv4's limit of 65,535."""

MAX_UNACKNOWLEDGED_BYTES = 16384  # maximum of one side, below the TCP window of 65,535
MICROSECONDS = 0xA1B2C3D4
NANOSECONDS = 0xA1B23C4D
PCAPNG = 0x0A0D0D0A
MAX_RECORD_BYTES = 262144  # maximum length of a packet, as in tcpdump: a longer one is damage
_FILE_HEADER = struct.pack('<IHHiIII', MICROSECONDS, 2, 4, 0, 0, MAX_RECORD_BYTES, 1)
_RECORD = struct.Struct('<IIII')
_TCP = struct.Struct('!HHIIBBHHH')
_IPV4 = struct.Struct('!BBHHHBBH4s4s')
_IPV6 = struct.Struct('!IHBB16s16s')
_CONTROLLER_MAC = bytes.fromhex('020000000002')
_CLIENT_MAC = bytes.fromhex('020000000001')
_TCP_PROTOCOL = 6
_FIRST_SEQUENCE = 1000

LINK_HEADERS = {0: 4, 1: 14, 12: 0, 101: 0, 113: 16, 276: 20}
"""Link type → number of bytes before the IP header. The types are BSD loopback, Ethernet, raw IP
(twice), and both versions of Linux cooked (`tcpdump -i any`)."""


class PcapError(ValueError):
    """A file that cannot be read as a capture. The text is the reason."""


class Flag:
    """Flags of a TCP segment, as plain numbers, because IntFlag is slow."""

    FIN = 1
    SYN = 2
    RST = 4
    PSH = 8
    ACK = 16


class Sink(Protocol):
    """Destination of packets, such as a binary file."""

    def write(self, data: bytes, /) -> object: ...


@dataclass(frozen=True, slots=True)
class Segment:
    """One TCP segment of a capture. `time` is s since 1970."""

    time: float
    source: Address
    target: Address
    sequence: int
    flags: int
    data: bytes


class PcapWriter:
    """Writes a pcap file, which starts with the file header. `size`: bytes written so far."""

    def __init__(self, sink: Sink) -> None:
        self.size = 0
        self._sink = sink
        self._write(_FILE_HEADER)

    def record(self, time_ns: int, packet: bytes) -> None:
        """Write one packet with its time, ns since 1970."""
        seconds, rest = divmod(time_ns, 1_000_000_000)
        length = len(packet)
        self._write(_RECORD.pack(seconds & 0xFFFFFFFF, rest // 1000, length, length) + packet)

    def _write(self, data: bytes) -> None:
        self.size += len(data)
        self._sink.write(data)


class _Side:
    """One end of a conversation.

    `sequence`: sequence number of the next packet of this side. `acknowledged`: sequence number up
    to which this side has acknowledged the other side's data.
    """

    def __init__(self, own: Address, other: Address, own_mac: bytes, other_mac: bytes) -> None:
        source, target = _packed(own[0]), _packed(other[0])
        self._ipv6 = len(source) == 16
        self._ports = (own[1], other[1])
        self._ethernet = other_mac + own_mac + (b'\x86\xdd' if self._ipv6 else b'\x08\x00')
        self._addresses = (source, target)
        self._identification = 0
        self._pseudo_sum = _sum(source) + _sum(target) + _TCP_PROTOCOL
        self.sequence = _FIRST_SEQUENCE
        self.acknowledged = 0

    def packet(self, flags: int, acknowledge: int, data: bytes) -> bytes:
        """Return the next packet of this side, and advance its sequence number."""
        source, target = self._ports
        fields = (self.sequence, acknowledge, 0x50, flags, 0xFFFF)
        length = _TCP.size + len(data)
        bare = _TCP.pack(source, target, *fields, 0, 0)
        check = _checksum(self._pseudo_sum + length + _sum(bare) + _sum(data))
        tcp = _TCP.pack(source, target, *fields, check, 0)
        control = bool(flags & (Flag.SYN | Flag.FIN))  # both use one sequence number
        self.sequence = (self.sequence + len(data) + control) & 0xFFFFFFFF
        self.acknowledged = acknowledge
        return self._ethernet + self._ip(length) + tcp + data

    def _ip(self, length: int) -> bytes:
        if self._ipv6:
            return _IPV6.pack(6 << 28, length, _TCP_PROTOCOL, 64, *self._addresses)
        self._identification = (self._identification + 1) & 0xFFFF
        total = _IPV4.size + length
        fields = (0x45, 0, total, self._identification, 0x4000, 64, _TCP_PROTOCOL)
        check = _checksum(_sum(_IPV4.pack(*fields, 0, *self._addresses)))
        return _IPV4.pack(*fields, check, *self._addresses)


class Conversation:
    """Writes the packets of one TCP connection, from its handshake to its end.

    Times are in ns since 1970.
    """

    def __init__(self, writer: PcapWriter, client: Address, server: Address, time_ns: int) -> None:
        self._writer = writer
        self._client = _Side(client, server, _CLIENT_MAC, _CONTROLLER_MAC)
        self._server = _Side(server, client, _CONTROLLER_MAC, _CLIENT_MAC)
        self._finished: set[bool] = set()
        self._record(time_ns, Flag.SYN, from_client=True)
        self._record(time_ns, Flag.SYN | Flag.ACK, from_client=False)
        self._record(time_ns, Flag.ACK, from_client=True)

    def data(self, time_ns: int, data: bytes, *, from_client: bool) -> None:
        sender, receiver = self._sides(from_client=from_client)
        for start in range(0, len(data), MAX_SEGMENT_BYTES):
            piece = data[start : start + MAX_SEGMENT_BYTES]
            self._record(time_ns, Flag.PSH | Flag.ACK, from_client=from_client, data=piece)
            if (sender.sequence - receiver.acknowledged) & 0xFFFFFFFF >= MAX_UNACKNOWLEDGED_BYTES:
                self._record(time_ns, Flag.ACK, from_client=not from_client)

    def finish(self, time_ns: int, *, from_client: bool) -> None:
        """Write the FIN of one side if it has not been written yet.

        Then write the acknowledgement of the other side.
        """
        if from_client not in self._finished:
            self._finished.add(from_client)
            self._record(time_ns, Flag.FIN | Flag.ACK, from_client=from_client)
            self._record(time_ns, Flag.ACK, from_client=not from_client)

    def reset(self, time_ns: int, *, from_client: bool) -> None:
        self._record(time_ns, Flag.RST | Flag.ACK, from_client=from_client)
        self._finished = {True, False}

    def _sides(self, *, from_client: bool) -> tuple[_Side, _Side]:
        sides = (self._client, self._server)
        return sides if from_client else (sides[1], sides[0])

    def _record(self, time_ns: int, flags: int, *, from_client: bool, data: bytes = b'') -> None:
        sender, receiver = self._sides(from_client=from_client)
        acknowledge = receiver.sequence if flags & Flag.ACK else 0
        self._writer.record(time_ns, sender.packet(flags, acknowledge, data))


def _packed(address: str) -> bytes:
    return ipaddress.ip_address(address.split('%')[0]).packed


@functools.lru_cache(maxsize=1024)
def _text(address: bytes) -> str:
    return str(ipaddress.ip_address(address))


def _sum(data: bytes) -> int:
    """Return the sum of the data's 16-bit words modulo 65,535 (RFC 1071).

    The data as a single large number has the same remainder, because 65,536 is 1 modulo 65,535.
    """
    return int.from_bytes(data + b'\0' if len(data) % 2 else data) % 0xFFFF


def _checksum(total: int) -> int:
    return 0xFFFF - (total % 0xFFFF or 0xFFFF)


# --- reading ---------------------------------------------------------------------------------


def read_segments(data: bytes) -> Iterator[Segment]:
    """Yield the TCP segments of a classic pcap file, in the order of the file.

    Other packets are ignored. An incomplete packet at the end is ignored, too, because it is
    normal if the writer was killed. Raises PcapError if the file is damaged, or is not a classic
    capture of IP packets.
    """
    order, scale, link_type = _file_header(data)
    skip = LINK_HEADERS[link_type]
    record = struct.Struct(order + 'IIII')
    position = 24
    while position + record.size <= len(data):
        seconds, fraction, length, _ = record.unpack_from(data, position)
        if length > MAX_RECORD_BYTES:
            raise PcapError(f'damaged at byte {position}: a packet of {length} bytes')
        position += record.size
        packet = data[position + skip : position + length]
        if position + length > len(data):
            return
        position += length
        segment = _segment(packet, seconds + fraction * scale)
        if segment is not None:
            yield segment


def _file_header(data: bytes) -> tuple[str, float, int]:
    """Return the byte order, the unit of the fractions of time stamps, s, and the link type."""
    if len(data) < 24:
        raise PcapError('not a capture: shorter than the header of one')
    for order in '<>':
        magic, *_, link_type = struct.unpack_from(order + 'IHHiIII', data)
        if magic == PCAPNG:
            raise PcapError('a pcapng file: convert it with `editcap -F pcap FILE NEW`')
        if magic in (MICROSECONDS, NANOSECONDS):
            link_type &= 0xFFFF
            if link_type not in LINK_HEADERS:
                raise PcapError(f'link type {link_type} is not supported')
            return order, 1e-6 if magic == MICROSECONDS else 1e-9, link_type
    raise PcapError('not a capture: it has no pcap header')


def _segment(packet: bytes, time: float) -> Segment | None:
    if not packet:
        return None
    if packet[0] >> 4 == 4 and len(packet) >= _IPV4.size:
        header = (packet[0] & 15) * 4
        protocol, fragment = packet[9], int.from_bytes(packet[6:8]) & 0x3FFF
        end = int.from_bytes(packet[2:4]) or len(packet)  # 0: offloaded, use the packet's length
        source, target = packet[12:16], packet[16:20]
        if any(packet[10:12]) and _sum(packet[:header]):
            return None  # its checksum is wrong (0: offloaded)
    elif packet[0] >> 4 == 6 and len(packet) >= _IPV6.size:
        header, protocol, fragment = _IPV6.size, packet[6], 0
        end = header + (int.from_bytes(packet[4:6]) or len(packet) - header)
        source, target = packet[8:24], packet[24:40]
    else:
        return None
    if protocol != _TCP_PROTOCOL or fragment or not header + _TCP.size <= end <= len(packet):
        return None
    from_port, to_port, sequence, _, offset, flags, *_ = _TCP.unpack_from(packet, header)
    return Segment(
        time,
        (_text(source), from_port),
        (_text(target), to_port),
        sequence,
        flags & 0x1F,
        packet[header + (offset >> 4) * 4 : end],
    )


@dataclass(slots=True)
class Stream:
    """Reassembles the byte stream of one direction of a conversation."""

    next_sequence: int | None = None
    waiting: dict[int, bytes] = field(default_factory=dict)  # after a gap, by position

    _starts: list[int] = field(default_factory=list)
    _position: int = 0

    def take(self, segment: Segment) -> bytes:
        """Return the bytes that continue the stream.

        Data after a gap is kept until the gap is filled.
        """
        sequence = (segment.sequence + bool(segment.flags & Flag.SYN)) & 0xFFFFFFFF
        if self.next_sequence is None or segment.flags & Flag.SYN:
            self.next_sequence = sequence
        if segment.data:
            ahead = (sequence - self.next_sequence) & 0xFFFFFFFF
            start = self._position + ahead - (ahead >> 31 << 32)
            if start not in self.waiting:
                heappush(self._starts, start)
            self.waiting[start] = max(self.waiting.get(start, b''), segment.data, key=len)
        fresh = bytearray()
        while self._starts and self._starts[0] <= self._position:
            start = heappop(self._starts)
            data = self.waiting.pop(start)[self._position - start :]
            fresh += data
            self._position += len(data)
        self.next_sequence = (self.next_sequence + len(fresh)) & 0xFFFFFFFF
        return bytes(fresh)
