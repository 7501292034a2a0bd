# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""All readers and writers of files with the same malicious files and paths.

Each ends in one sentence that names the file, within a memory limit. No other file changes.
"""

import gzip
import os
import re
import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from support.examples import one_in
from support.longer_arm import arm_file
from support.recorded_run import usual_run

from epson_driver.error_texts import load_error_texts, read_error_texts
from epson_driver.first_run.record import DONE, Entry, FirstRunRecord, load, replica_settings
from epson_driver.first_run.steps import StepResult
from epson_driver.inputs import InputError, read_file, write_file
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.report.figures import figures
from epson_driver.report.page import write_report
from epson_driver.report.run import Run, RunError
from epson_driver.report.smooth_study import save_picture
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import load_robot_model
from epson_driver.robots.limit_files import file_limits
from epson_driver.setup.robot_file import node_sections
from epson_driver.share import share_path
from epson_driver.spel import read_project
from epson_driver.spel.errors import SpelError
from epson_driver.spel.export import exported
from epson_driver.spel.files import Files
from epson_driver.spel.project_data import project_data
from epson_driver.spel.settings import file_values
from epson_driver.taught_points import EpsonPoint, TaughtPoints
from epson_driver.trajectory_file import read_trajectory, write_trajectory

pytestmark = pytest.mark.invariant(7)

SPARE_BYTES = 400_000_000
MODEL = load_robot_model('c3_a601s')
REFUSED = (InputError, RunError, SpelError, OSError)


@contextmanager
def little_memory() -> Iterator[None]:
    """Limit the additional memory of this process to SPARE_BYTES."""
    used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + SPARE_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def check_refused(act: Callable[[Path], object], path: Path) -> bool:
    """Return whether `act` refuses a file. Its error must be one sentence with the file name."""
    try:
        act(path)
    except REFUSED as error:
        text = str(error)
    else:
        return False
    assert text.isprintable(), text
    assert len(text) < 1200, text
    assert path.stem[:20].encode('ascii', 'ignore').decode().partition('\0')[0] in text
    return True


# --- paths and contents ----------------------------------------------------------------------


def _socket(path: Path) -> None:
    before = Path.cwd()
    os.chdir(path.parent)  # a Unix socket's address has at most 108 bytes
    try:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    finally:
        os.chdir(before)


NO_FILE: dict[str, Callable[[Path], Path | None]] = {
    'a folder': lambda path: path.mkdir(),
    'a pipe': lambda path: os.mkfifo(path),
    'a socket': _socket,
    'a link to an endless device': lambda path: path.symlink_to('/dev/zero'),
    'a link to a pipe': lambda path: (os.mkfifo(path.parent / 'p'), path.symlink_to('p'))[1],
    'a link to itself': lambda path: path.symlink_to(path.name),
    'a link to nothing': lambda path: path.symlink_to(path.parent / 'victim' / 'new'),
    'a folder that is not there': lambda path: path.parent / 'none' / path.name,
    'a file as a folder': lambda path: path.parent / 'victim' / 'secret' / path.name,
    'a name with a NUL': lambda path: path.with_stem('file\0x'),
    'a name that is no text': lambda path: path.with_stem('file\ud800'),
    'a name that is too long': lambda path: path.with_stem('file' * 100),
}
"""Makers of paths that must be neither read nor written. Some return another path."""

if os.geteuid():  # root may read and write everything
    NO_FILE['no permission'] = lambda path: (path.touch(0), path.parent.chmod(0o500))[1]


def _sparse(path: Path, valid: bytes) -> None:
    path.write_bytes(valid[:64])
    os.truncate(path, 5_000_000_000)


def _texts(of: Callable[[str], str]) -> Callable[[bytes], bytes]:
    return lambda valid: of(valid.decode('latin-1')).encode('latin-1')


def _number(text: str) -> Callable[[bytes], bytes]:
    """Return a function that replaces the first decimal number."""
    number = re.compile(r'([:=\[] ?)-?\d+\.\d+')
    return _texts(lambda valid: number.sub(lambda found: found[1] + text, valid, count=1))


DEEP = 100_000
LAUGHS = ''.join(f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]\n' for n in range(1, 10))
CONTENT: dict[str, Callable[[bytes], bytes]] = {
    'nothing': lambda _: b'',
    'zeros': lambda _: bytes(100_000),
    'noise': lambda _: bytes(n * n * 7919 % 251 for n in range(100_000)),
    'a head, then zeros': lambda valid: valid[:64] + bytes(1_000_000),
    'half of it': lambda valid: valid[: len(valid) // 2],
    'all but its end': lambda valid: valid[:-3],
    'twice': lambda valid: valid + valid,
    'UTF-16': _texts(lambda valid: valid.encode('utf-16').decode('latin-1')),
    'no UTF-8': lambda valid: valid[:20] + b'\xff\xfe\xc0' + valid[20:],
    'escapes': lambda valid: valid.replace(b':', b': "\x1b]0;x\x07\x1b[2J"', 1),
    'lines of a log': lambda valid: valid.replace(b'\n', b'\r\n[ERROR] false\r\n', 3),
    'deep lists': lambda _: b'[' * DEEP,
    'deep mappings': lambda _: b'{"a":' * DEEP,
    'deep blocks': lambda _: b'- ' * DEEP,
    'deep blocks of RC+': lambda _: b'Block {\n' * DEEP,
    'deep JSON in a page': lambda _: _page('[' * DEEP),
    'a billion laughs': lambda _: f'a0: &a0 [x]\n{LAUGHS}'.encode(),
    'entities': lambda _: b'<!DOCTYPE a [<!ENTITY b "&b;&b;">]><a>&b;</a>',
    'what expands': lambda _: gzip.compress(bytes(50_000_000)),
    'not a number': _number('.nan'),
    'NaN of JSON': _number('NaN'),
    'no end': _number('1e999'),
    'a million digits': _number('9' * 1_000_000),
    'a key twice': lambda valid: re.sub(
        rb'(\n[ \t]*\w+ ?[:=][^\n{\[]*)', rb'\1\1', valid, count=1
    ),
    'a tag': _number('!!python/object/apply:os.system [true]'),
    'one long line': lambda valid: valid.replace(b'\n', b'') + b'x' * 900_000,
}
VALUES = ('null', 'true', '-1', '1e999', '"x"', '[1]', '{"a": 1}', '"<img src=x>"', '[[[[]]]]')


def _page(data: str) -> bytes:
    return f'<script type="application/json" id="first-run">{data}</script>'.encode()


def wrong_types(valid: bytes) -> Iterator[bytes]:
    """Yield copies of the file, each with one of up to 60 values replaced by one of VALUES."""
    text = '' if b'\0' in valid else valid.decode('latin-1')
    result = list(re.finditer(r'(?<=[:=])( ?"[^"\n]*"| ?-?[\w.]+| ?\[[^\]\n]*\])(?=[,}\n])', text))
    for item in result[:: len(result) // 60 + 1]:
        for value in VALUES:
            yield f'{text[: item.start()]} {value}{text[item.end() :]}'.encode('latin-1')


# --- readers ----------------------------------------------------------------------------------


def _first_day(folder: Path) -> Path:
    about = {'controller': 'simulated', 'robot': 'c3_a601s', 'address': '::1', 'when': 'now'}
    facts: dict[str, object] = {'reply delay': 0.25, 'lateness': 0.5, 'rests at points': True}
    facts |= {'state.period': 0.005, 'io': {'digital_inputs': 24}, 'byte_order': 'little'}
    times = {'joint 1: point sent to motion seen': 0.75}
    result = StepResult(facts, times, {'power': 'low'}, ['replies come late'])
    FirstRunRecord(about, {'listen': Entry(DONE, 'now', result, 'why', 'AAAA')}).save(
        folder / 'day.html'
    )
    return folder / 'day.html'


def _points(name: str) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        points = TaughtPoints()
        points.set('pick', EpsonPoint(350.5, 20.0, -30.0), {})
        points.save(folder / name)
        return folder / name

    return made


def _text(name: str, text: str) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        (folder / name).write_text(text, 'utf-8')
        return folder / name

    return made


def _project(folder: Path) -> Path:
    files = read_project(share_path('controller_program'))
    made = exported('own', files, 7, datetime(2026, 1, 1, tzinfo=UTC))
    (folder / 'own.sprj').write_bytes(made['own.sprj'])
    (folder / 'main.prg').write_bytes(made['main.prg'])
    return folder / 'own.sprj'


def _bag(ending: str) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        pytest.importorskip('rosbags', reason='the extra [report] is not installed')
        from rosbags.highlevel import AnyReader
        from rosbags.rosbag2 import StoragePlugin, Writer

        from epson_driver.report.bag_file import typestore, write_bag

        write_bag(_run(), figures(_run()), folder / 'run')
        with (
            AnyReader([folder / 'run']) as bag,
            Writer(folder / 'db', version=9, storage_plugin=StoragePlugin.SQLITE3) as other,
        ):
            topics = {
                connection.id: other.add_connection(
                    connection.topic, connection.msgtype, typestore=typestore()
                )
                for connection in bag.connections
            }
            for topic, time, data in bag.messages():
                other.write(topics[topic.id], time, data)
        return next(folder.rglob(ending))

    return made


def _read_bag(path: Path) -> None:
    from epson_driver.report.bag_run import read_bag

    read_bag(path, load_error_texts())


SHARED = share_path('config')
READERS: dict[str, tuple[Callable[[Path], object], Callable[[Path], Path]]] = {
    'any': (lambda path: read_file(path, 1_000_000), _text('x.txt', 'a: 1.0\n')),
    'trajectory': (
        read_trajectory,
        lambda _: SHARED / 'trajectories' / 'around_pillar_11_points.yaml',
    ),
    'robot model': (lambda path: load_robot_model(str(path)), lambda folder: arm_file(folder, 6)),
    'controller': (
        lambda path: load_controller_profile(str(path)),
        lambda _: SHARED / 'controllers' / 'simulated.yaml',
    ),
    'error texts': (read_error_texts, lambda _: SHARED / 'errors' / 'epson.yaml'),
    'joint limits': (
        lambda path: file_limits(str(path)),
        _text('x.yaml', 'joint_limits: {a: {has_velocity_limits: true, max_velocity: 1.5}}\n'),
    ),
    'parameters': (node_sections, _text('x.yaml', '/**:\n  ros__parameters:\n    a: 1.5\n')),
    'settings': (
        file_values,
        _text('spel.yaml', 'stubs:\n  VGet: [[1, 2.5], [0, 3]]\ntools:\n  1: [0, 0, 1.5, 0]\n'),
    ),
    'program': (read_project, _text('main.prg', 'Function main\n  Print 1.5\nFend\n')),
    'project': (lambda path: project_data(read_project(path), []), _project),
    'points of RC+': (lambda path: TaughtPoints().load(path), _points('x.pts')),
    'points': (lambda path: TaughtPoints().load(path), _points('x.yaml')),
    'first day': (lambda path: replica_settings(load(path)), _first_day),
    'trace': (
        lambda path: read_trace(path, MODEL.limits, load_error_texts()),
        lambda folder: usual_run().write(folder / 'x.pcap'),
    ),
    'bag': (_read_bag, _bag('*.mcap')),
    'database': (_read_bag, _bag('*.db3')),
    'file of SPEL+': (lambda path: Files(path.parent).read(path.name), _text('x.csv', 'a: 1\n')),
}
SPEL_READS_NO_LINK = 'file of SPEL+'


@pytest.mark.parametrize('name', one_in(8, READERS))
def test_inv7_reader_reads_or_refuses_any_file(name: str, tmp_path: Path) -> None:
    reader, made = READERS[name]
    original = tmp_path / 'original'
    original.mkdir()
    valid = made(original)
    reader(valid)
    content = valid.read_bytes()
    for number, kind in enumerate((*NO_FILE, *CONTENT)):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = folder / f'file{valid.suffix}'
        if name == 'project':
            (folder / 'main.prg').write_bytes((original / 'main.prg').read_bytes())
        if kind in CONTENT:
            path.write_bytes(CONTENT[kind](content))
        else:
            (folder / 'victim').mkdir()
            path = NO_FILE[kind](path) or path
        before = sorted(folder.rglob('*'))
        with little_memory():
            refused = check_refused(reader, path)
        assert kind in CONTENT or refused or name == SPEL_READS_NO_LINK, kind
        assert sorted(folder.rglob('*')) == before, kind
    path = tmp_path / f'file{valid.suffix}'
    _sparse(path, content)
    with little_memory():
        assert check_refused(reader, path)
    for changed in wrong_types(content):
        path.write_bytes(changed)
        with little_memory():
            check_refused(reader, path)


# --- writers ----------------------------------------------------------------------------------


def _pick() -> TaughtPoints:
    points = TaughtPoints()
    points.set('pick', EpsonPoint(350.5, 20.0, -30.0), {})
    return points


@cache
def _run() -> Run:
    with TemporaryDirectory() as folder:
        pcap = usual_run().write(Path(folder, 'run.pcap'))
        return read_trace(pcap, MODEL.limits, load_error_texts())


def _picture(path: Path) -> None:
    from matplotlib.figure import Figure

    save_picture(path, Figure())


BOOK = FirstRunRecord(
    {'controller': 'simulated', 'robot': 'c3_a601s', 'address': '::1', 'when': 'now'}
)
PLAN = Trajectory(('joint_1',), np.array([0.0, 1.0]), np.array([[0.0], [0.1]]))
WRITERS: dict[str, tuple[Callable[[Path], object], str]] = {
    'any': (lambda path: write_file(path, 'text'), '.txt'),
    'points of RC+': (lambda path: _pick().save(path), '.pts'),
    'points': (lambda path: _pick().save(path), '.yaml'),
    'first day': (BOOK.save, '.html'),
    'report': (
        lambda path: write_report([(_run(), figures(_run()))], MODEL, path),
        '.html',
    ),
    'trajectory': (lambda path: write_trajectory(path, PLAN, 'made'), '.yaml'),
    'picture': (_picture, '.png'),
    'file of SPEL+': (
        lambda path: Files(path.parent, keep=True).write(path.name, b'1'),
        '.csv',
    ),
}


@pytest.mark.parametrize('name', one_in(3, WRITERS))
def test_inv7_writer_replaces_whole_files_only(name: str, tmp_path: Path) -> None:
    writer, ending = WRITERS[name]
    victim = tmp_path / 'victim' / 'secret'
    victim.parent.mkdir()
    victim.write_text('mine')

    def folder(number: object) -> Path:
        made = tmp_path / str(number)
        made.mkdir()
        (made / 'victim').symlink_to(victim.parent)
        return made / f'file{ending}'

    links = {'a link to a file': lambda path: path.symlink_to(victim)}
    for kind, put in (NO_FILE | links).items():
        path = folder(kind)
        path = put(path) or path
        before = {item: item.lstat().st_mode for item in path.parent.glob('*')}
        assert check_refused(writer, path), kind
        assert {item: item.lstat().st_mode for item in path.parent.glob('*')} == before, kind
        assert [item.name for item in victim.parent.iterdir()] == ['secret'], kind
        assert victim.read_text() == 'mine', kind

    path = folder('replaced')
    for beside in (f'{path.name}.part', f'{path.name}.tmp', f'.{path.name}.part'):
        (path.parent / beside).symlink_to(victim)
    path.write_text('old')
    path.chmod(0o640)
    writer(path)
    assert path.read_bytes() != b'old'
    assert path.stat().st_mode & 0o777 == 0o640
    assert victim.read_text() == 'mine'

    path = folder('a full disk')
    path.write_text('old')
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        assert check_refused(writer, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_text() == 'old'
    assert sorted(item.name for item in path.parent.iterdir()) == [path.name, 'victim']
