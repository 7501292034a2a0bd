# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver fleet`: what it shows, and that nothing of it is left when it ends."""

import io
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console
from support.interrupts import obey_interrupts

from epson_driver.cli import fleet
from epson_driver.fleet import fleet_processes
from epson_driver.fleet import table as shown
from epson_driver.fleet.table import NOTHING, Row, Use, is_up, table
from epson_driver.fleet.watch import Seen, Watch
from epson_driver.processes import process_figures, processes
from epson_driver.processes.interrupt import ENDING, interrupts_held
from epson_driver.processes.processes import RunError

PATIENCE_S = 300.0
WELL = Seen('connected', 182.0, 0.012)
USED = Use(0.1, 100_000_000)


def text_of(*rows: Row, **others: Use) -> list[str]:
    """Return the lines of the table."""
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table(rows, others))
    return console.export_text().splitlines()


def test_a_line_says_how_a_robot_does() -> None:
    lines = text_of(Row('robot_1', None, WELL, USED, Use(0.05, 50_000_000)))
    (line,) = (each for each in lines if 'robot_1' in each)
    cells = re.split('  +', line.strip())
    assert cells == [
        'robot_1', 'yes', '12 ms', '182 Hz', '10 %', '5 %', '15 %', '150 MB',
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('ended', 'seen', 'shown'),
    [
        (None, WELL, 'yes'),
        (1, WELL, 'ended: 1'),
        (0, WELL, 'ended: 0'),
        (None, WELL._replace(link='backing_off'), 'backing off'),
        (None, WELL._replace(answer_s=None), 'no'),
        (None, WELL._replace(rate=0.0), 'no'),
    ],
)
def test_up_is_who_is_connected_answers_and_sends(
    ended: int | None, seen: Seen, shown: str
) -> None:
    row = Row('robot_1', ended, seen, NOTHING, NOTHING)
    assert is_up(row) == (shown == 'yes')
    assert f'  {shown}  ' in '\n'.join(text_of(row))


def test_it_fits_80_columns() -> None:
    busy = Use(1.23, 1_234_567_890)
    rows = [Row('robot_64', -15, WELL, busy, busy), Row('robot_1', None, WELL, busy, busy)]
    lines = [
        line for line in text_of(*rows, discovery=busy, **{'this table': busy}) if line.strip()
    ]
    assert len(lines) == 1 + 1 + 4 + 1 + 1  # no cell has two lines
    assert '…' not in ''.join(lines)
    assert max(map(len, lines)) <= 80


def test_the_last_line_is_of_all_with_what_they_share() -> None:
    rows = [Row('robot_1', None, WELL, USED, USED), Row('robot_2', 1, WELL, USED, USED)]
    shared = {'discovery': Use(0.01, 5_000_000)}
    last = next(line for line in text_of(*rows, **shared) if line.strip().startswith('all '))
    for cell in ('1 of 2', '20 %', '41 %', '405 MB', '≥ 182 Hz'):
        assert f' {cell} ' in f'{last} '


@pytest.mark.skipif(not process_figures.available(), reason='Linux only')
def test_a_process_counts_with_its_children() -> None:
    code = 'import subprocess, sys; subprocess.run([sys.executable, "-ISc", sys.argv[1]])'
    child = 'data = b"x" * 50_000_000\nprint("ready", flush=True)\ninput()'
    parent = subprocess.Popen(
        [sys.executable, '-ISc', code, child], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert parent.stdout is not None
    assert parent.stdout.readline() == b'ready\n'
    alone = process_figures.use(parent.pid, children=False).memory_bytes
    both = process_figures.use(parent.pid).memory_bytes
    parent.communicate()
    assert both > alone + 50_000_000
    assert process_figures.use(parent.pid) == NOTHING  # it has ended


def test_without_a_discovery_server_it_says_where_one_comes_from(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'python'))
    monkeypatch.setenv('PATH', str(tmp_path))
    with pytest.raises(RunError, match='it comes with Fast DDS'):
        fleet_processes.program()


def test_those_who_end_together_are_told_before_one_is_waited_for() -> None:
    told: list[Any] = []

    class Ending:
        returncode = None

        def __init__(self, name: str) -> None:
            self.name = name

        def send(self, number: int) -> None:
            told.append((self.name, number))

        def ended(self) -> int:
            told.append(self.name)
            return 0

    processes.end_together([Ending('a'), Ending('b')])  # type: ignore[list-item]
    assert told == [('a', signal.SIGINT), ('b', signal.SIGINT), 'a', 'b']


@pytest.fixture
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt, also where a shell's `&` has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures('_interruptible')
def test_a_signal_waits_while_something_is_started() -> None:
    known = []

    def start() -> None:
        with interrupts_held((signal.SIGINT,)):
            signal.raise_signal(signal.SIGINT)
            known.append('what was started')

    with pytest.raises(KeyboardInterrupt):
        start()
    assert known
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a fleet; its processes can be told by a variable that they inherit."""
    process = subprocess.Popen(
        [*processes.EXECUTABLE, 'fleet', *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {'OF_THIS_FLEET': str(os.getpid()), 'COLUMNS': '140'},
        preexec_fn=obey_interrupts,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def left_running() -> list[str]:
    """Return the command lines of all that runs with the variable of this test's fleets."""
    mark = f'OF_THIS_FLEET={os.getpid()}'.encode()
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        try:
            if mark in path.joinpath('environ').read_bytes().split(b'\0'):
                words = path.joinpath('cmdline').read_bytes().replace(b'\0', b' ').decode()
                found.append(words)
        except (FileNotFoundError, ProcessLookupError, PermissionError):
            continue
    return [words for words in found if words]


@pytest.mark.slow
@pytest.mark.parametrize(
    'words', [(), ('--together',), ('--discovery', 'simple')], ids=['server', 'one', 'simple']
)
def test_a_fleet_is_up_and_ends_with_all_its_processes(words: tuple[str, ...]) -> None:
    with started('--robots', '2', '--seconds', '1', *words) as fleet:
        said, _ = fleet.communicate(timeout=PATIENCE_S)
    assert fleet.returncode == 0, said
    assert '2 robots are up' in said
    rows = re.findall(r'robot_\d +yes +(\d+) ms +(\d+) Hz', said)
    assert len(rows) in (2, 4)  # the first table, and the last if there was another
    assert re.search(r'all +2 of 2 ', said)
    assert ('ROS_DISCOVERY_SERVER=' in said) == ('simple' not in words)
    assert left_running() == []


@pytest.mark.slow
def test_ctrl_c_ends_a_fleet_with_all_its_processes() -> None:
    with started('--robots', '2') as fleet:
        assert fleet.stdout is not None
        for line in fleet.stdout:
            if line.strip().startswith('all '):  # the first table is complete
                break
        assert '2 of 2' in line
        assert len(left_running()) >= 6  # two drivers, two controllers, server, itself
        fleet.send_signal(signal.SIGINT)
        assert 'all ended' in fleet.stdout.read()
        assert fleet.wait(PATIENCE_S) == 0
    assert left_running() == []


@pytest.mark.slow
def test_ctrl_c_while_a_fleet_starts_leaves_nothing_running() -> None:
    with started('--robots', '2') as fleet:
        until = time.monotonic() + PATIENCE_S
        while len(left_running()) < 4:
            assert time.monotonic() < until
            time.sleep(0.05)
        fleet.send_signal(signal.SIGINT)
        fleet.communicate(timeout=PATIENCE_S)
        assert fleet.returncode == 130
    assert left_running() == []


@pytest.mark.slow
def test_a_discovery_server_uses_no_shared_memory(tmp_path: Path) -> None:
    """What killed processes leave there has kept a fleet from being heard."""
    port = processes.port_beside(processes.free_ros_domain())
    server = fleet_processes.discovery_server(tmp_path / 'log', fleet_processes.ADDRESS, port)
    try:
        until = time.monotonic() + PATIENCE_S
        while f':{port:04X} ' not in Path('/proc/net/udp').read_text('ascii'):
            assert time.monotonic() < until
            time.sleep(0.05)
        assert '/dev/shm/fastrtps' not in Path(f'/proc/{server.process_id}/maps').read_text()
    finally:
        server.kill()


# --- without a fleet --------------------------------------------------------------------------


class Running:
    """A process, with its exit code if it has ended."""

    def __init__(self, code: int | None = None) -> None:
        self.returncode = code
        self.process_id = os.getpid()

    def check_alive(self) -> None:
        pass


def two_robots(**more: Any) -> Any:
    names = ('robot_1', 'robot_2')
    one = {name: Running() for name in names}
    two = {name: Running() for name in names}
    usual = {'names': names, 'drivers': one, 'controllers': two, 'server': None}
    return SimpleNamespace(**usual | {'together': False, 'environment': {}} | more)


class Heard:
    """A watch that hears one robot of two."""

    def __init__(self) -> None:
        self.forgotten: list[str] = []

    def connected(self) -> list[str]:
        return ['robot_2']

    def spin(self, _seconds: float) -> None:
        pass

    def forget(self, name: str) -> None:
        self.forgotten.append(name)

    def hear(self, _seconds: float) -> dict[str, Seen]:
        return dict.fromkeys(('robot_1', 'robot_2'), WELL)


def quiet() -> Console:
    return Console(width=140, file=io.StringIO(), force_terminal=True)


def test_who_is_not_heard_in_time_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shown, 'START_TIMEOUT_S', -1.0)
    watch: Any = Heard()
    with pytest.raises(RunError, match=r'^robot_1: not heard within -1 s$'):
        shown.wait(two_robots(), watch, quiet())


def test_what_a_driver_that_has_ended_said_last_is_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process_figures, 'available', lambda: False)  # as on another system
    robots = two_robots()
    robots.drivers['robot_1'] = Running(3)
    watch: Any = Heard()
    rows, others = shown._window(robots, watch)
    assert watch.forgotten == ['robot_1']
    assert [row.ended for row in rows] == [3, None]
    assert [is_up(row) for row in rows] == [False, True]
    assert {row.driver for row in rows} == {NOTHING}
    assert others == {'this table': NOTHING}


def test_a_terminal_shows_every_window_and_the_last_one_decides(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    up, down = (Row('robot_1', code, WELL, USED, USED) for code in (None, 1))
    windows = iter([([down], {}), ([down], {}), ([up], {})])
    clock = iter([0.0, 1.0, 2.0, 9.0])
    monkeypatch.setattr(shown, '_window', lambda *_: next(windows))
    monkeypatch.setattr(shown.time, 'monotonic', lambda: next(clock, 9.0))
    console = quiet()
    assert shown.show(two_robots(), Heard(), 5.0, console) == 0  # type: ignore[arg-type]
    assert next(windows, None) is None
    assert isinstance(console.file, io.StringIO)
    assert 'ended: 1' in console.file.getvalue()


def test_a_fleet_that_cannot_start_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RunError('no ROS domain is free')

    before = [signal.getsignal(number) for number in ENDING]
    monkeypatch.setattr(fleet, 'running_fleet', fails)
    monkeypatch.setattr(sys, 'argv', ['epson_driver fleet'])
    try:
        assert fleet.main() == 1
    finally:
        for number, handler in zip(ENDING, before, strict=True):
            signal.signal(number, handler)
    assert 'fleet failed: no ROS domain is free' in capsys.readouterr().out


def test_a_robot_that_is_forgotten_is_not_connected_and_answers_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in processes.ros_environment(processes.free_ros_domain()).items():
        monkeypatch.setenv(name, value)
    watch = Watch(['robot_1', 'robot_2'])
    try:
        for name in ('robot_1', 'robot_2'):
            watch._links[name] = 'connected'
            watch._calls[name] = (0.0, None)
        watch.forget('robot_1')
        assert watch.connected() == ['robot_2']
        for name in ('robot_1', 'robot_2'):
            watch._on_answer(name, None)
        assert list(watch._answers) == ['robot_2']
    finally:
        watch.close()


@pytest.mark.skipif(not process_figures.available(), reason='Linux only')
def test_a_process_that_has_ended_uses_nothing() -> None:
    ended = subprocess.Popen(['/bin/true'])
    ended.wait()
    assert process_figures.use(ended.pid) == NOTHING
