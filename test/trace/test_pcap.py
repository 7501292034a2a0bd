# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Pcap files: valid TCP conversations that are read back unchanged."""

import io
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.recorded_run import Recorder, usual_run

from epson_driver.inputs import InputError
from epson_driver.simple_message import Status
from epson_driver.trace.messages import MessagesError, messages_of
from epson_driver.trace.pcap import (
    Conversation,
    Flag,
    PcapError,
    PcapWriter,
    Segment,
    Stream,
    read_segments,
)
from epson_driver.trace.recording import read_recording

CLIENT = ('192.168.0.10', 50123)
SERVER = ('192.168.0.1', 11002)
SECOND = 1_000_000_000


def records(data):
    """Split a file into (time in µs, packet), independently of the reader."""
    assert struct.unpack_from('<IHHiIII', data) == (0xA1B2C3D4, 2, 4, 0, 0, 262144, 1)
    position = 24
    while position < len(data):
        seconds, micros, kept, length = struct.unpack_from('<IIII', data, position)
        assert kept == length
        position += 16
        yield seconds * 1_000_000 + micros, data[position : position + kept]
        position += kept


def ones_complement_sum(data):
    """Return the checksum of RFC 1071."""
    total = sum(struct.unpack(f'!{(len(data) + 1) // 2}H', data + b'\0' * (len(data) % 2)))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return total


def written(*steps, client=CLIENT, server=SERVER):
    """Return a file with one conversation. Each step is called with it and a time in ns."""
    file = io.BytesIO()
    writer = PcapWriter(file)
    conversation = Conversation(writer, client, server, SECOND)
    for number, step in enumerate(steps):
        step(conversation, (number + 2) * SECOND)
    assert writer.size == len(file.getvalue())
    return file.getvalue()


def from_client(data):
    return lambda conversation, time: conversation.data(time, data, from_client=True)


def from_server(data):
    return lambda conversation, time: conversation.data(time, data, from_client=False)


def closes(*, from_client):
    return lambda conversation, time: conversation.finish(time, from_client=from_client)


def test_checksums_of_written_packets_are_valid():
    odd = bytes(range(1, 252))
    zeros = struct.pack('!HH', 0, 0)
    file = written(from_server(odd), from_client(zeros), from_client(b'\xff' * 9))
    for _, packet in records(file):
        assert packet[12:14] == b'\x08\x00'
        ip, tcp = packet[14:34], packet[34:]
        assert struct.unpack_from('!H', ip, 2)[0] == len(packet) - 14
        assert ones_complement_sum(ip) == 0xFFFF
        pseudo = ip[12:20] + struct.pack('!HH', 6, len(tcp))
        assert ones_complement_sum(pseudo + tcp) == 0xFFFF


def test_sequence_numbers_acknowledge_earlier_data():
    file = written(
        from_server(b'state'),
        from_client(b'point'),
        from_server(b'reply'),
        closes(from_client=False),
        closes(from_client=True),
        closes(from_client=True),
    )
    reached = {CLIENT: None, SERVER: None}
    flags = []
    for segment in read_segments(file):
        number, acknowledges = struct.unpack_from('!II', packet_of(file, len(flags)), 38)
        own, other = reached[segment.source], reached[segment.target]
        assert own is None or number == own
        assert acknowledges == (other or 0)
        both = bool(segment.flags & (Flag.SYN | Flag.FIN))
        reached[segment.source] = number + len(segment.data) + both
        flags.append(segment.flags)
    assert flags[:3] == [Flag.SYN, Flag.SYN | Flag.ACK, Flag.ACK]
    assert flags[3:6] == [Flag.PSH | Flag.ACK] * 3
    assert flags[6:] == [Flag.FIN | Flag.ACK, Flag.ACK] * 2


def packet_of(file, number):
    return list(records(file))[number][1]


@pytest.mark.parametrize(
    ('client', 'server'),
    [(CLIENT, SERVER), (('fe80::1%eth0', 40000), ('fe80::2', 11000))],
    ids=['IPv4', 'IPv6'],
)
def test_written_conversation_is_read_back(client, server):
    file = written(
        from_client(b'abc'),
        from_server(b'de'),
        lambda conversation, time: conversation.reset(time, from_client=False),
        client=client,
        server=server,
    )
    segments = list(read_segments(file))
    assert [s.data for s in segments] == [b'', b'', b'', b'abc', b'de', b'']
    assert [s.time for s in segments] == [1.0, 1.0, 1.0, 2.0, 3.0, 4.0]
    plain = (client[0].split('%')[0], client[1])
    assert {s.source for s in segments} == {plain, server}
    assert segments[-1].flags == Flag.RST | Flag.ACK
    assert segments[-1].source == server


def test_truncated_file_is_read_to_the_last_packet():
    file = written(from_client(b'abc'), from_client(b'def'))
    for cut in range(1, 70):
        data = [segment.data for segment in read_segments(file[:-cut])]
        assert data == [b'', b'', b'', b'abc'], cut


def converted(order='<', magic=0xA1B2C3D4, link_type=1, header=b'', fraction=1):
    """Return a capture of the same packets in the format of another program."""
    file = written(from_client(b'abc'))
    out = struct.pack(order + 'IHHiIII', magic, 2, 4, 0, 0, 65535, link_type)
    for time, packet in records(file):
        packet = packet if link_type == 1 else header + packet[14:]
        seconds, micros = divmod(time, 1_000_000)
        length = len(packet)
        out += struct.pack(order + 'IIII', seconds, micros * fraction, length, length) + packet
    return out


@pytest.mark.parametrize(
    'options',
    [
        {'order': '>'},
        {'magic': 0xA1B23C4D, 'fraction': 1000},
        {'link_type': 113, 'header': bytes(16)},
        {'link_type': 276, 'header': bytes(20)},
        {'link_type': 101},
        {'link_type': 0, 'header': bytes(4)},
    ],
    ids=['big endian', 'nanoseconds', 'cooked', 'cooked 2', 'raw', 'loopback'],
)
def test_other_capture_formats_are_read(options):
    segments = list(read_segments(converted(**options)))
    assert [s.data for s in segments] == [b'', b'', b'', b'abc']
    assert segments[-1].time == 2.0


@pytest.mark.parametrize(
    ('data', 'text'),
    [
        (b'', 'shorter'),
        (b'x' * 100, 'no pcap header'),
        (struct.pack('<I', 0x0A0D0D0A) + bytes(100), 'editcap'),
        (struct.pack('<IHHiIII', 0xA1B2C3D4, 2, 4, 0, 0, 65535, 105), 'link type 105'),
        (written() + struct.pack('<IIII', 0, 0, 2**31, 2**31), 'damaged'),
    ],
    ids=['empty', 'garbage', 'pcapng', 'link type', 'length'],
)
def test_file_that_is_no_capture_is_refused(data, text):
    with pytest.raises(PcapError, match=text):
        list(read_segments(data))


def test_packets_of_other_protocols_are_ignored():
    file = written()
    udp = bytearray(packet_of(file, 0))
    udp[14 + 9] = 17
    for packet in (bytes(udp), bytes(60), b'', packet_of(file, 0)[:40]):
        data = file + struct.pack('<IIII', 1, 0, len(packet), len(packet)) + packet
        assert len(list(read_segments(data))) == 3


def test_segments_are_ordered_without_duplicates():
    stream = Stream()

    def take(sequence, data, flags=Flag.ACK):
        return stream.take(Segment(0.0, CLIENT, SERVER, sequence & 0xFFFFFFFF, flags, data))

    assert take(-5, b'', Flag.SYN) == b''
    assert take(-4, b'abc') == b'abc'
    assert take(-4, b'abc') == b''  # a retransmission
    assert take(1, b'fg') == b''  # out of order
    assert take(-3, b'bcde') == b'defg'  # an overlap with a wrapped number
    assert take(3, b'h') == b'h'
    assert not stream.waiting


@pytest.mark.skipif(shutil.which('tshark') is None, reason='tshark is not installed')
@pytest.mark.parametrize(
    'fault',
    ['_ws.malformed', 'tcp.analysis.flags', 'tcp.checksum.status == 0 || ip.checksum.status == 0'],
)
def test_wireshark_reports_no_errors(fault, tmp_path):
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    for number in range(40):
        recorder.controller_sends(0.1 * number, 11002, Status())
    recorder.lose(5.0, 11002)
    path = recorder.write(tmp_path / 'run.pcap')
    checks = ['-o', 'tcp.check_checksum:TRUE', '-o', 'ip.check_checksum:TRUE']

    def matching(rule):
        command = ['tshark', '-r', str(path), *checks, '-Y', rule]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert matching(fault) == ''
    assert len(matching('tcp.checksum.status == 1').splitlines()) > 40


@pytest.mark.invariant(7)
@pytest.mark.parametrize('place', ['/dev/zero', '/', '/nowhere/run.pcap', '/tmp/\0', 'x' * 5000])
def test_path_that_is_no_file_is_refused(place: str) -> None:
    with pytest.raises(InputError):
        read_recording(Path(place))


@pytest.mark.invariant(7)
def test_lost_packet_does_not_slow_down_the_following() -> None:
    """Sorting all waiting segments per segment would take hours for a long capture."""
    ends = ('10.0.0.1', 11002), ('10.0.0.2', 50000)
    stream = Stream()
    assert stream.take(Segment(0.0, *ends, 0, Flag.ACK, b'a')) == b'a'
    for number in range(40_000):
        assert stream.take(Segment(0.0, *ends, 2 + number, Flag.ACK, b'c')) == b''
    assert stream.take(Segment(0.0, *ends, 1, Flag.ACK, b'b')) == b'b' + b'c' * 40_000


@pytest.mark.invariant(7)
def test_segments_after_gaps_do_not_slow_down_ordered_segments() -> None:
    """Sorting them for each ordered segment would take days for 100 MB."""
    ends = ('10.0.0.1', 11002), ('10.0.0.2', 50000)
    stream = Stream()
    assert stream.take(Segment(0.0, *ends, 0, Flag.ACK, b'a')) == b'a'
    for number in range(40_000):
        assert stream.take(Segment(0.0, *ends, 1_000_000 + 2 * number, Flag.ACK, b'c')) == b''
        assert stream.take(Segment(0.0, *ends, 1 + number, Flag.ACK, b'b')) == b'b'


CHANGES = st.lists(st.tuples(st.integers(0, 3000), st.binary(max_size=30)), max_size=4)


@pytest.mark.invariant(7)
@settings(max_examples=examples(300), suppress_health_check=list(HealthCheck))
@given(changes=CHANGES, end=st.none() | st.integers(0, 3000))
def test_inv7_random_bytes_are_read_or_refused(tmp_path, changes, end):
    path = tmp_path / 'run.pcap'
    usual_run().write(path)
    content = bytearray(path.read_bytes()[:end])
    for start, data in changes:
        content[start : start + len(data)] = data
    path.write_bytes(content)
    text = ''
    try:
        messages_of(read_recording(path))
    except (PcapError, MessagesError, InputError) as error:
        text = str(error)
    assert text.isprintable()
