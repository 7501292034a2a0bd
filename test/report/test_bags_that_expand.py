# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Bags of a few kilobytes that expand to gigabytes are refused within little memory."""

import os
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from support.examples import one_in

pytest.importorskip('rosbags', reason='the extra [report] is not installed')
import lz4.frame
from rosbags.rosbag2.reader import zstd

from epson_driver.report.bag_run import BASE_BYTES, GROWTH

SIZE = 2**31
MAGIC = b'\x89MCAP0\r\n'
TABLES = """
CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT,
                    offered_qos_profiles TEXT);
CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, data BLOB {});
INSERT INTO topics VALUES(1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '');
"""
METADATA = """
rosbag2_bagfile_information:
  version: 5
  storage_identifier: {storage}
  relative_file_paths: [{file}]
  duration: {{nanoseconds: 1}}
  starting_time: {{nanoseconds_since_epoch: 1}}
  message_count: 1
  compression_format: zstd
  compression_mode: {mode}
  topics_with_message_count:
  - message_count: 1
    topic_metadata:
      name: /joint_states
      type: sensor_msgs/msg/JointState
      serialization_format: cdr
      offered_qos_profiles: '{qos}'
"""


@cache
def zeros(make: Callable[[], object], size: int = SIZE) -> bytes:
    """Return `size` zeros, compressed."""
    compressor = make()
    head_bytes = compressor.begin() if hasattr(compressor, 'begin') else b''
    parts = [compressor.compress(bytes(2**20)) for _ in range(size // 2**20)]
    return b''.join([head_bytes, *parts, compressor.flush()])


def record(kind: int, content: bytes) -> bytes:
    return bytes([kind]) + struct.pack('<Q', len(content)) + content


def text(of: str) -> bytes:
    return struct.pack('<I', len(of)) + of.encode()


def mcap(compression: str, data: bytes, size_in_header: int = SIZE) -> bytes:
    """Return a file with one chunk, whose header states a size."""
    head = struct.pack('<QQQI', 0, 2**62, size_in_header, 0) + text(compression)
    chunk = record(6, head + struct.pack('<Q', len(data)) + data)
    start = MAGIC + record(1, text('ros2') + text(''))
    return start + chunk + record(2, bytes(20)) + MAGIC


def database(path: Path, more: str = '', values: str = '1, 1, ?', *data: bytes) -> None:
    connection = sqlite3.connect(path)
    connection.executescript(TABLES.format(more))
    connection.execute(f'INSERT INTO messages VALUES({values})', data)
    connection.commit()
    connection.close()


def folder(path: Path, **words: str) -> Path:
    path.mkdir()
    values = {'storage': 'sqlite3', 'file': 'a.db3', 'mode': '', 'qos': ''} | words
    (path / 'metadata.yaml').write_text(METADATA.format(**values))
    return path


def chunk_of_zstd(path: Path) -> Path:
    path.with_suffix('.mcap').write_bytes(mcap('zstd', zeros(zstd.ZstdCompressor)))
    return path.with_suffix('.mcap')


def chunk_that_lies(path: Path) -> Path:
    path.with_suffix('.mcap').write_bytes(mcap('zstd', zeros(zstd.ZstdCompressor), 100))
    return path.with_suffix('.mcap')


def chunk_of_lz4(path: Path) -> Path:
    path.with_suffix('.mcap').write_bytes(mcap('lz4', zeros(lz4.frame.LZ4FrameCompressor)))
    return path.with_suffix('.mcap')


def whole_file(path: Path) -> Path:
    folder(path, storage='mcap', file='a.mcap.zstd', mode='FILE')
    (path / 'a.mcap.zstd').write_bytes(zeros(zstd.ZstdCompressor))
    return path


def each_message(path: Path) -> Path:
    database(folder(path, mode='MESSAGE') / 'a.db3', '', '1, 1, ?', zeros(zstd.ZstdCompressor))
    return path


def generated_column(path: Path) -> Path:
    computed = 'GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL'
    database(path.with_suffix('.db3'), computed, '1, 1')
    return path.with_suffix('.db3')


def sparse(path: Path) -> Path:
    path = path.with_suffix('.mcap')
    start = MAGIC + record(1, text('ros2') + text(''))
    path.write_bytes(start + b'\x05' + struct.pack('<Q', 4_999_000_000))
    with path.open('r+b') as file:
        file.truncate(5_000_000_000)
    return path


def deep_metadata(path: Path) -> Path:
    (folder(path) / 'metadata.yaml').write_text('[' * 100_000)
    return path


def deep_qos(path: Path) -> Path:
    database(folder(path, qos='[' * 100_000) / 'a.db3', '', '1, 1, ?', b'')
    return path


READS = """
import sys
from pathlib import Path
from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import InputError
from epson_driver.report.bag_run import read_bag
from epson_driver.report.run import RunError

def memory(key):
    return int(Path('/proc/self/status').read_text().partition(f'{key}:')[2].split()[0]) * 1024

began = memory('VmRSS')
try:
    read_bag(Path(sys.argv[1]), load_error_texts())
except (RunError, InputError) as error:
    print(memory('VmHWM') - began)
    print(error)
"""
"""Reads a bag in a new process, because memory freed by other tests would hide its use."""


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'made',
    one_in(
        4,
        [
            chunk_of_zstd,
            chunk_that_lies,
            chunk_of_lz4,
            whole_file,
            each_message,
            generated_column,
            sparse,
            deep_metadata,
            deep_qos,
        ],
    ),
)
def test_inv7_expanding_bag_is_refused_within_little_memory(
    made: Callable[[Path], Path], tmp_path: Path
) -> None:
    path = made(tmp_path / 'bag')
    before = {item: item.stat().st_size for item in tmp_path.rglob('*')}
    command = [sys.executable, '-c', READS, str(path)]
    environment = os.environ | {'TMPDIR': str(tmp_path)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert not run.stderr
    used, _, error = run.stdout.rstrip('\n').partition('\n')
    assert int(used) < BASE_BYTES + GROWTH * min(sum(before.values()), SIZE // 200)
    assert error.startswith(str(path))
    assert error.isprintable()
    assert len(error) < 500
    assert 'Recursion' not in error
    assert {item: item.stat().st_size for item in tmp_path.rglob('*')} == before
