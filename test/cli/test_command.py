# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The command line: its options, odd arguments, Ctrl+C, closed streams."""

import errno
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest
from support.examples import one_in
from support.interrupts import obey_interrupts

from epson_driver.cli import __main__ as main
from epson_driver.cli.arguments import if_in_use
from epson_driver.node import smooth_goals
from epson_driver.processes import processes
from epson_driver.processes.command import EXECUTABLES, module_command, safe_python
from epson_driver.processes.interrupt import ENDING, INTERRUPTED
from epson_driver.setup.table import ROWS


def command(*arguments: str, before: str = '') -> subprocess.CompletedProcess[str]:
    code = f'import sys; {before}\nfrom epson_driver.cli.__main__ import main; sys.exit(main())'
    return subprocess.run(
        [sys.executable, '-c', code, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        ((), 'sim_controller'),
        (('robot',), 'epson_driver: no command robot: did you mean robots?\n'),
        (('Doctor',), 'epson_driver: no command Doctor: did you mean doctor?\n'),
        (('xyz',), 'no command xyz: must be connect, client, sim_controller'),
        (('demo', '--rob', 'c4'), 'no option --rob: did you mean --robot?\n'),
        (('connect', '1.2.3.4', '--file', 'a.txt'), "'a.txt': must end in .yaml\n"),
        (('robots', '--payload', 'heavy'), 'heavy: must be a number from 0 to 100000\n'),
        (('doctor', '--contoller', 'x'), 'no option --contoller: did you mean --controller?\n'),
        (('panel', '--controler', 'spel'), 'no option --controler: did you mean --controller?\n'),
        (('spel', 'chek'), "'chek': did you mean check?\n"),
        (('spel', 'check', 'x', '--stict'), 'no option --stict: did you mean --strict?\n'),
        (('smooth', '-q', 'x'), 'unexpected argument -q: see `epson_driver smooth --help`\n'),
        (('pendant',), 'required: WORD: see `epson_driver pendant --help`\n'),
        (('pendant', 'estop'), 'did you mean estop press or estop release?\n'),
        (('doctor', '192.168.0.300'), 'four numbers from 0 to 255, such as 192.168.0.1\n'),
        (('client', 'none.yaml'), 'no such file; `epson_driver connect` writes one\n'),
    ],
)
def test_mistake_at_the_shell_is_answered_with_a_remedy(
    arguments: tuple[str, ...],
    error: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, 'argv', ['epson_driver', *arguments])
    monkeypatch.setattr(main, 'raise_at_interrupt', lambda: None)
    try:
        code: object = main._run()
    except SystemExit as end:
        code = end.code
    assert code in (1, 2)
    stderr = capsys.readouterr().err
    assert error in stderr
    assert not arguments or len(stderr.splitlines()) == 1


def test_version_equals_package_xml() -> None:
    root = Path(__file__).parents[2]
    run = command('--version')
    assert run.returncode == 0
    assert f'<version>{run.stdout.split()[1]}</version>' in (root / 'package.xml').read_text(
        'utf-8'
    )
    assert run.stdout == f'epson_driver {run.stdout.split()[1]}\n'


def test_every_executable_is_installed_for_ros2_run() -> None:
    scripts = {path.name for path in (Path(__file__).parents[2] / 'scripts').iterdir()}
    assert scripts == {'executable', 'first-run', *EXECUTABLES}  # both spellings are documented


@pytest.mark.parametrize('package', ['epson_msgs', 'industrial_msgs'])
def test_missing_message_package_is_reported_with_its_build_command(package: str) -> None:
    run = command('client', before=f'sys.modules["{package}"] = None')
    assert run.returncode == 1
    assert f'the Python module {package} is missing' in run.stderr
    assert 'colcon build --base-paths src/epson_driver src/epson_driver/interfaces' in run.stderr
    assert f'pip install ./interfaces/{package}' in run.stderr


@pytest.mark.parametrize('name', ['client', 'demo'])
def test_missing_rclpy_is_reported(name: str) -> None:
    run = command(name, before='sys.modules["rclpy"] = None')
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert 'the Python module rclpy is missing' in line
    assert "pip install 'epson_driver[ros]'" in line
    assert 'Traceback' not in run.stderr


def test_missing_module_names_its_extra() -> None:
    assert main._missing('matplotlib') == (
        "the Python module matplotlib is missing: pip install 'epson_driver[report]'"
    )


@pytest.mark.parametrize('name', ['epson_driver.cli.robot', 'epson_driver', None])
def test_missing_module_of_this_package_raises(
    monkeypatch: pytest.MonkeyPatch, name: str | None
) -> None:
    def missing(_name: str) -> None:
        raise ModuleNotFoundError(f'No module named {name!r}', name=name)

    monkeypatch.setattr(main, 'import_module', missing)
    monkeypatch.setattr(sys, 'argv', ['epson_driver', 'robots'])
    with pytest.raises(ModuleNotFoundError):
        main._run()


@pytest.mark.parametrize('name', ['doctor', 'spel'])
def test_ctrl_c_exits_as_interrupted(name: str) -> None:
    interrupt = 'm.main = lambda: signal.default_int_handler(signal.SIGINT, None)'
    run = command(name, before=f'import signal, epson_driver.cli.{name} as m; {interrupt}')
    assert (run.returncode, run.stderr) == (INTERRUPTED, '')


def test_error_advises_other_ports_only_if_the_port_is_in_use() -> None:
    assert if_in_use(None) == if_in_use(OSError(errno.EACCES, 'x')) == ''
    assert '--motion-port' in if_in_use(OSError(errno.EADDRINUSE, 'x'))


CLOSED = ['sh', '-c', 'exec "$@" <&- >&- 2>&-', 'sh']

WITHOUT_STDERR = ['sh', '-c', 'exec "$@" 2>&-', 'sh']

WORKER = """
import os
from epson_driver.processes.worker import answer_file
answers = answer_file()
print('printed', flush=True)
os.write(2, b'logged')
answers.write(b'answer')
"""


@pytest.mark.parametrize(
    ('words', 'code'), [(['robots'], 0), (['--help'], 0), (['pendant', '--port=x', 'status'], 2)]
)
def test_exit_code_is_correct_with_closed_streams(words: list[str], code: int) -> None:
    run = subprocess.run([*CLOSED, *module_command('epson_driver.cli', *words)], check=False)
    assert run.returncode == code


def test_output_of_a_worker_is_kept_out_of_its_answer_file() -> None:
    answer = subprocess.run(
        [*WITHOUT_STDERR, *safe_python(), '-c', WORKER],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        check=True,
    )
    assert answer.stdout == b'answer'


PLAN = str(Path(__file__).parents[2] / 'config' / 'trajectories' / 'around_pillar_11_points.yaml')

PROGRAM = str(Path(__file__).parents[2] / 'controller_program')

DIGITS = '9' * 400

TOO_LONG = '9' * 5000  # above Python's limit for integers

HOSTS = ('', ' ', 'a..b', '.', 'x' * 64, 'a\nb', 'a\0b', '\udc80', '999.1.1.1', '1.2.3.4.5', 'a b')

NUMBERS = (DIGITS, TOO_LONG, 'nan', '-inf', '-1e300', '', 'x', '1_0', '٣', '0x10')

FILES = (
    '',
    '.',
    '/dev/zero',
    '/nowhere/x.yaml',
    '[/red]x.yaml',
    'a\nb.yaml',
    'a\0b.yaml',
    'x' * 300,
    'x' * 300 + '.yaml',
    '\udc80.yaml',
)

TABLE = (
    ('pendant', HOSTS, '--host={}', 'status'),
    ('pendant', NUMBERS, '--port={}', 'status'),
    ('pendant', NUMBERS, '--timeout={}', 'status'),
    ('pendant', NUMBERS, 'io', 'DO', '{}', 'x'),
    ('sim_controller', HOSTS, '--host={}'),
    ('sim_controller', NUMBERS, '--motion-port={}'),
    ('sim_controller', NUMBERS, '--state-period={}'),
    ('sim_controller', NUMBERS, '--look-ahead={}'),
    ('sim_controller', NUMBERS, '--seed={}'),
    ('sim_controller', NUMBERS, '--fault={}'),
    ('sim_controller', NUMBERS, '--start={}'),
    ('sim_controller', (DIGITS, TOO_LONG, 'nan', '-inf', '', 'x'), '--start={},0,0,0,0,0'),
    ('sim_controller', FILES, '--robot={}'),
    ('sim_controller', FILES, '--controller={}'),
    ('smooth', FILES, '{}'),
    ('smooth', FILES, PLAN, '--robot={}'),
    ('smooth', NUMBERS, PLAN, '--rate={}'),
    ('smooth', (*NUMBERS, '1e-300', '0'), PLAN, '--look-ahead={}'),
    ('smooth', NUMBERS, PLAN, '--path-tolerance={}'),
    ('smooth', ('x.foo', '.', '', '\udc80'), PLAN, '--picture={}'),
    ('robots', FILES[1:], '{}'),  # without a name it lists all
    ('spel', FILES, 'check', '{}'),
    ('spel', FILES, 'test', '{}'),
    ('spel', NUMBERS, 'check', PLAN, '--version={}'),
    ('spel', FILES, 'run', '{}'),
    ('spel', FILES[::3], 'run', '--fast', PROGRAM, '--robot={}'),
    ('spel', FILES[::3], 'run', '--fast', PROGRAM, '--controller={}'),
    ('spel', NUMBERS, 'run', '--fast', PROGRAM, '--seconds={}'),
    ('spel', NUMBERS, 'run', PROGRAM, '--remote-port={}'),
    ('spel', (*NUMBERS, '=1', 'NOWHERE=1'), 'run', '--fast', PROGRAM, '--define={}'),
    ('demo', FILES, '--trajectory={}'),
    ('demo', ('x.foo', '.', ''), '--picture={}'),
)

BAD_FILE = {'demo': 1}
"""Executables that exit with 1 for an invalid file. All others exit with 2."""


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    ('name', 'values', 'words'),
    [(name, values, words) for name, values, *words in TABLE],
    ids=[f'{name} {" ".join(words)[-30:]}' for name, _, *words in TABLE],
)
def test_inv7_invalid_argument_is_rejected_with_a_message(
    name: str,
    values: tuple[str, ...],
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    main = import_module(f'epson_driver.cli.{name}').main
    for value in values:
        monkeypatch.setattr(sys, 'argv', [name, *(word.replace('{}', value) for word in words)])
        try:
            code = main()
        except SystemExit as end:
            code = end.code
        output = capsys.readouterr()
        sentence = ' '.join((output.out + output.err).split())
        assert code in (2, BAD_FILE.get(name, 2)), (value[:50], sentence)
        assert 'error: ' in sentence or 'demo failed: ' in sentence
        assert len(sentence) < 3000
    assert not list(tmp_path.iterdir())


@pytest.mark.invariant(7)
@pytest.mark.parametrize('name', ['client', 'panel'])
@pytest.mark.parametrize('words', [('-r', 'no remapping'), ('-p', 'x'), ('-p', ':=3')])
def test_inv7_invalid_ros_argument_is_rejected_with_a_message(
    name: str,
    words: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if name == 'panel':
        pytest.importorskip('websockets')
    monkeypatch.setattr(sys, 'argv', [name, '--ros-args', *words])
    assert import_module(f'epson_driver.cli.{name}').main() == 1
    error = capsys.readouterr().err
    assert error.startswith(f'epson_driver {name}: ')
    assert 'Failed to parse ROS arguments' in error
    assert words[1] in error


PATIENCE = 300.0

PAUSE = 0.01
"""Time between two signals, s."""

AT_IMPORT = """
import os, signal, sys
class AtImport:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, AtImport())
from epson_driver.cli.__main__ import main
sys.exit(main())
"""
"""A program that sends itself SIGINT when it imports `module`."""

LOADED = [
    *((name, f'epson_driver.cli.{name.replace("-", "_")}') for name in EXECUTABLES),
    ('client', 'rclpy'),
    ('client', 'epson_driver.node.node'),
    ('demo', 'rclpy'),
    ('sim_controller', 'numpy'),
    ('smooth', 'ruckig'),
]


@pytest.mark.parametrize(('name', 'module'), one_in(7, LOADED, several=True))
def test_ctrl_c_during_import_leaves_no_traceback(name: str, module: str) -> None:
    run = subprocess.run(
        [sys.executable, '-c', AT_IMPORT.format(module=module), name, '--help'],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        preexec_fn=obey_interrupts,
    )
    assert (run.returncode, run.stdout, run.stderr) == (130, '', '')


@pytest.mark.parametrize('number', one_in(4, ENDING))
def test_signal_before_the_executable_handles_it_exits_with_130(number: signal.Signals) -> None:
    code = (
        'import os, signal, sys\n'
        'from epson_driver.cli import robots\n'
        'from epson_driver.cli.__main__ import main\n'
        f'robots.main = lambda: os.kill(os.getpid(), {number.value})\n'
        'sys.exit(main())'
    )
    command = [sys.executable, '-c', code, 'robots']
    run = subprocess.run(
        command, capture_output=True, text=True, check=False, preexec_fn=obey_interrupts
    )
    assert (run.returncode, run.stdout, run.stderr) == (130, '', '')


@pytest.mark.invariant(3)
def test_each_signal_ends_the_loop_and_further_ones_are_ignored() -> None:
    """This includes the time in which the loop closes."""
    code = (
        'import asyncio, os, signal\n'
        'from epson_driver.processes.interrupt import ended_by_signals\n'
        'def interrupt():\n'
        '    for number in (signal.SIGQUIT, signal.SIGHUP, signal.SIGINT):\n'
        '        os.kill(os.getpid(), number)\n'
        'async def main():\n'
        '    loop, end = asyncio.get_running_loop(), asyncio.Event()\n'
        '    with ended_by_signals(loop, end.set):\n'
        '        loop.call_soon(interrupt)\n'
        '        await end.wait()\n'
        '        interrupt()\n'
        '    close = loop.close\n'
        '    def interrupted_close(): interrupt(); close(); interrupt()\n'
        '    loop.close = interrupted_close\n'
        '    interrupt()\n'
        'asyncio.run(main())\n'
        'interrupt()\n'
        "print('ended', signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)"
    )
    run = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=obey_interrupts,
    )
    assert (run.returncode, run.stdout, run.stderr) == (0, 'ended True\n', '')


def interrupted(process: subprocess.Popen[str]) -> str:
    """Send SIGINT until the process ends. Return its remaining output."""
    until = time.monotonic() + PATIENCE
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        time.sleep(PAUSE)
        assert time.monotonic() < until, 'it does not end'
    assert process.stdout is not None
    with process.stdout:
        return process.stdout.read()


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start executables in a separate ROS domain. They end with the test."""
    all_started: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*processes.EXECUTABLE, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=processes.ros_environment(processes.free_ros_domain()),
        )
        all_started.append(process)
        return process

    yield start
    for process in all_started:
        process.kill()
        process.wait()


def line_with(process: subprocess.Popen[str], text: str) -> str:
    """Wait for a line of output with `text` and return it."""
    assert process.stdout is not None
    output = ''
    for line in process.stdout:
        output += line
        if text in line:
            return line
    raise AssertionError(output)


@pytest.mark.invariant(9)
@pytest.mark.slow
def test_repeated_ctrl_c_ends_controller_and_client(
    started: Callable[..., subprocess.Popen[str]],
) -> None:
    free = [f'--{name}-port=0' for name in ('motion', 'state', 'io', 'remote')]
    controller = started('sim_controller', *free)
    ports = dict(re.findall(r'(\w+)=(\d+)', line_with(controller, 'listening ')))
    settings = [f'{name}_port:={ports[name]}' for name in ('motion', 'state')]
    client = started('client', '--ros-args', *(w for setting in settings for w in ('-p', setting)))
    line_with(client, 'state link connected')
    for process in (client, controller):
        output = interrupted(process)
        assert process.returncode in (0, 130), output
        assert 'Traceback' not in output
        assert 'KeyboardInterrupt' not in output


@pytest.mark.invariant(9)
@pytest.mark.slow
def test_repeated_ctrl_c_leaves_no_process_of_the_demo(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    demo = started('demo', f'--picture={tmp_path / "report.png"}')
    line_with(demo, 'sim_controller: simulated, c3_a601s, 127.0.0.1:')
    children = Path(f'/proc/{demo.pid}/task/{demo.pid}/children').read_text().split()
    assert children
    output = interrupted(demo)
    assert demo.returncode == 130, output
    assert 'Traceback' not in output
    assert [child for child in children if Path('/proc', child).exists()] == []


@pytest.mark.parametrize('name', sorted(EXECUTABLES))
def test_help_has_examples_exit_codes_and_defaults(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, 'argv', [name, '--help'])
    with pytest.raises(SystemExit):
        import_module(f'epson_driver.cli.{name.replace("-", "_")}').main()
    text = capsys.readouterr().out
    assert text.count(f'\n  epson_driver {name} ') + text.count(f'\n  epson_driver {name}\n') >= 2
    assert re.search(r'\nexit codes: 0 .*, 2 invalid arguments', text)
    given = set(re.findall(r'-p ([a-z_.]+):=', text))
    table = smooth_goals.TABLE if name == 'smooth_goals' else ROWS.values()
    assert given <= {row.name for row in table}
    assert not re.search(r'\((?!default|repeatable)[\w.]+\)\n', text.partition('examples:')[0])
