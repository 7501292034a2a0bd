# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/invariants.md, 7, for recordings: any bytes are read or refused with one sentence."""

import io
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.link_harness import frame, joints

from epson_driver.inputs import InputError
from epson_driver.simple_message import LITTLE_ENDIAN, JointTrajPt, encode, request
from epson_driver.trace.messages import MessagesError, messages_of
from epson_driver.trace.pcap import Conversation, Flag, PcapError, PcapWriter, Segment, Stream
from epson_driver.trace.recording import read_recording

pytestmark = pytest.mark.invariant(7)

SECOND = 1_000_000_000


def recording() -> bytes:
    """Return a capture of a state port and a motion port."""
    file = io.BytesIO()
    writer = PcapWriter(file)
    state = Conversation(writer, ('10.0.0.2', 50000), ('10.0.0.1', 11002), 0)
    motion = Conversation(writer, ('10.0.0.2', 50001), ('10.0.0.1', 11000), 0)
    for number in range(6):
        state.data(number * SECOND, joints(float(number)), from_client=False)
        point = JointTrajPt(number, (0.0,) * 10)
        motion.data(number * SECOND, encode(request(point), LITTLE_ENDIAN), from_client=True)
        motion.data(number * SECOND, frame(11, 3, 1), from_client=False)
    motion.finish(7 * SECOND, from_client=True)
    state.reset(7 * SECOND, from_client=False)
    return file.getvalue()


CAPTURE = recording()


def read_or_refused(path: Path) -> bool:
    """Return whether the messages in a file could be read."""
    error_text = ''
    try:
        messages_of(read_recording(path))
    except (PcapError, MessagesError, InputError) as error:
        error_text = str(error)
    assert error_text.isprintable()
    return not error_text


def test_valid_recording_is_read(tmp_path: Path) -> None:
    path = tmp_path / 'run.pcap'
    path.write_bytes(CAPTURE)
    assert read_or_refused(path)


@settings(
    max_examples=examples(300),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    changes=st.lists(
        st.tuples(st.integers(0, len(CAPTURE)), st.integers(0, 30), st.binary(max_size=30)),
        max_size=4,
    ),
    end=st.none() | st.integers(0, len(CAPTURE)),
)
def test_inv7_random_bytes_are_read_or_refused(
    tmp_path: Path, changes: list[tuple[int, int, bytes]], end: int | None
) -> None:
    content = CAPTURE
    for start, length, data in changes:
        content = content[:start] + data + content[start + length :]
    path = tmp_path / 'run.pcap'
    path.write_bytes(content[:end])
    read_or_refused(path)


@pytest.mark.parametrize('place', ['/dev/zero', '/', '/nowhere/run.pcap', '/tmp/\0', 'x' * 5000])
def test_path_that_is_no_file_is_refused(place: str) -> None:
    with pytest.raises(InputError):
        read_recording(Path(place))


def test_lost_packet_does_not_slow_down_the_following() -> None:
    """Sorting all waiting segments per segment would take hours for a long capture."""
    ends = ('10.0.0.1', 11002), ('10.0.0.2', 50000)
    stream = Stream()
    assert stream.take(Segment(0.0, *ends, 0, Flag.ACK, b'a')) == b'a'
    for number in range(40_000):
        assert stream.take(Segment(0.0, *ends, 2 + number, Flag.ACK, b'c')) == b''
    assert stream.take(Segment(0.0, *ends, 1, Flag.ACK, b'b')) == b'b' + b'c' * 40_000


def test_segments_after_gaps_do_not_slow_down_ordered_segments() -> None:
    """Sorting them for each ordered segment would take days for 100 MB."""
    ends = ('10.0.0.1', 11002), ('10.0.0.2', 50000)
    stream = Stream()
    assert stream.take(Segment(0.0, *ends, 0, Flag.ACK, b'a')) == b'a'
    for number in range(60_000):
        far = 1_000_000 + 2 * number
        assert stream.take(Segment(0.0, *ends, far, Flag.ACK, b'c')) == b''
        assert stream.take(Segment(0.0, *ends, 1 + number, Flag.ACK, b'b')) == b'b'
    assert len(stream.waiting) == 60_000
