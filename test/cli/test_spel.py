# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel`: check, test and run."""

import json
import os
import socket
import subprocess
import sys
from functools import partial
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
from support.controller_harness import do
from support.examples import one_in
from support.here import run_here

from epson_driver.cli import spel

COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'spel']

GOOD = 'Function main\n  Print 1\nFend\n'
WARNS = 'Function main\n  Integer i\n  If i = True Then Print 1\nFend\n'
NEWER = 'Function main\n  UByte b\n  b = 200\nFend\n'
TESTS = """#include "limits.inc"
Function TestAdds
  Print "adding"
  If 1 + 1 <> 2 Then Error 8001
Fend
Function TestFails
  Print "about to fail"
  If LIMIT <> 4 Then Error 8002
Fend
Function TestWaits
  Wait 100
Fend
Function TestNeverEnds
  Do
    Wait 1
  Loop
Fend
Function TestForNobody
  SetNet #201, "", 2001
  OpenNet #201 As Server
  WaitNet #201
Fend
Function TestWith(n As Integer)
Fend
Function helper
  Error 8003
Fend
"""


run = partial(run_here, spel.main)


@pytest.fixture
def program(tmp_path: Path) -> Path:
    (tmp_path / 'limits.inc').write_text('#define LIMIT 3\n')
    (tmp_path / 'tests.prg').write_text(TESTS)
    return tmp_path / 'tests.prg'


def test_check_reports_positions_and_exits_with_1_for_errors(tmp_path: Path) -> None:
    path = tmp_path / 'main.prg'
    path.write_text(GOOD.replace('Print', 'Prin'))
    done = run('check', path.parent, cwd=tmp_path.parent)
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        f'{tmp_path.name}/main.prg:2:3: error: '
        'unknown statement or function Prin: did you mean Print? [unknown]',
        '1 errors, 0 warnings (version 8)',
    ]
    path.write_text(GOOD)
    done = run('check', path)
    assert (done.returncode, done.stdout) == (0, '0 errors, 0 warnings (version 8)\n')
    piped = subprocess.run(
        [*COMMAND, 'check', '-'],
        input=WARNS.replace('Fend', "Fend ' Größe").encode('cp1252'),
        env={**os.environ, 'PYTHONIOENCODING': 'utf-8:strict'},
        capture_output=True,
        check=False,
    )
    assert piped.stdout.startswith(b'stdin.prg:3:8: warning: i = True')


def test_check_version_and_strict_options_change_the_result(tmp_path: Path) -> None:
    path = tmp_path / 'main.prg'
    path.write_text(NEWER)
    assert run('check', path).returncode == 0
    done = run('check', path, '--version', '6')
    assert done.returncode == 1
    assert 'main.prg:2:3: error: ubyte exists from version 7 on' in done.stdout
    path.write_text(WARNS)
    assert run('check', path).returncode == 0
    assert run('check', path, '--strict').returncode == 1


def test_check_writes_json_and_github_annotations(tmp_path: Path) -> None:
    path = tmp_path / 'main.prg'
    path.write_text(WARNS)
    (problem,) = json.loads(run('check', '--format', 'json', 'main.prg', cwd=tmp_path).stdout)
    text = problem.pop('text')
    about = problem.pop('about')
    assert text.startswith('i = True')
    assert about
    assert problem == {
        'file': 'main.prg',
        'line': 3,
        'column': 8,
        'rule': 'true-compare',
        'severity': 'warning',
    }
    path.write_text(GOOD)
    assert json.loads(run('check', '--format', 'json', 'main.prg', cwd=tmp_path).stdout) == []
    path.write_text(WARNS)
    path = path.rename(tmp_path / 'main task.prg')
    done = run('check', '--format', 'github', path.name, cwd=tmp_path)
    assert done.stdout.startswith(
        '::warning file=main task.prg,line=3,col=8,title=true-compare::i = T'
    )


def test_folder_is_checked_as_a_project(program: Path) -> None:
    (program.parent / 'main.prg').write_text('Function main\n  helper\nFend\n')
    done = run('check', program.parent)
    assert (done.returncode, done.stdout) == (0, '0 errors, 0 warnings (version 8)\n')
    alone = run('check', program.parent / 'main.prg')
    assert 'unknown statement or function helper' in alone.stdout
    both = run('check', program, program.parent / 'main.prg')
    assert both.returncode == 0


def test_test_functions_run_and_are_reported(program: Path) -> None:
    report = program.parent / 'report.xml'
    done = run('test', program.name, '--junit', report, cwd=program.parent)
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        'passed TestAdds (0.000 s)',
        'FAILED TestFails: tests.prg:8: error 8002: an error defined by the program: handle it '
        '(OnErr), or add it to UserErrors.dat',
        '  about to fail',
        'passed TestWaits (100.000 s)',
        'FAILED TestNeverEnds: tests.prg:15: still running after 600 s of controller time',
        'FAILED TestForNobody: tests.prg:21: waits for an event that cannot occur',
        'FAILED TestWith: tests.prg:23: a test cannot have parameters',
        'tests.prg: 11 of 18 lines ran',
        '2 passed, 4 failed',
    ]
    suite = Xml.parse(report).getroot()
    assert (suite.get('tests'), suite.get('failures')) == ('6', '4')
    assert [case.get('name') for case in suite if case.find('failure') is not None] == [
        'TestFails',
        'TestNeverEnds',
        'TestForNobody',
        'TestWith',
    ]


def test_test_functions_can_be_selected(program: Path) -> None:
    done = run('test', program, '-k', 'ADDS')
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, '1 passed, 0 failed')
    done = run('test', program, '-k', 'nothing')
    assert (done.returncode, done.stdout) == (1, 'no functions named Test… found\n')


def test_invalid_program_is_not_tested(tmp_path: Path) -> None:
    path = tmp_path / 'main.prg'
    path.write_text('Function TestIt\n  Curved 1\nFend\n')
    done = run('test', path.name, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == 'main.prg:2:3: error: unknown statement or function Curved [unknown]\n'
    assert done.stderr == ''


@pytest.mark.parametrize('command', ['check', 'run', 'test'])
@pytest.mark.parametrize(
    ('name', 'text', 'message'),
    [
        (
            'a.sprj',
            'A {\n\tProgramFile1 {\n',
            '2:1: error: cannot be read: the block Prog',
        ),
        (
            'a.sprj',
            'PointFile1 {\nnRobot=x\n}\n',
            "2:1: error: cannot be read: nRobot='x'",
        ),
        ('UserErrors.dat', 'Label1 {\n\tnError=1e999\n}\n', '2:1: error: cannot be read: nError'),
    ],
)
def test_project_error_has_a_path_relative_to_the_caller(
    tmp_path: Path, command: str, name: str, text: str, message: str
) -> None:
    (tmp_path / 'cell').mkdir()
    (tmp_path / 'cell' / 'main.prg').write_text('Function main\nFend\n')
    (tmp_path / 'cell' / name).write_text(text)
    done = run(command, 'cell', cwd=tmp_path)
    assert done.returncode == 1
    assert f'cell/{name}:{message}' in done.stdout


RUNS = """#define STEPS 3
Function main
  Integer i
  String s$
  Motor On
  Power High
  Speed 50
  For i = 1 To STEPS
    Go AglToPls(10 * i, 0, 0, 0, 0, 0)
    Print "at ", Agl(1)
  Next i
  Print "name"
  Input s$
  Print "hello ", s$, Sw(3)
Fend
"""


def run_with_input(typed: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, 'run', *map(str, arguments)],
        input=typed,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize('how', one_in(2, [['--fast'], []]), ids=['fast', 'real time'])
def test_run_passes_output_and_input_and_ends_when_the_program_ends(
    tmp_path: Path, how: list[str]
) -> None:
    (tmp_path / 'main.prg').write_text(RUNS)
    done = run_with_input('you\n', *how, '--define', 'STEPS=2', tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line.split() for line in done.stdout.splitlines()] == [
        ['at', '10'],
        ['at', '20'],
        ['name'],
        ['hello', 'you', '0'],
    ]


@pytest.mark.slow
def test_fast_runs_are_reproducible(tmp_path: Path) -> None:
    """The times of motions and statements do not depend on the computer."""
    (tmp_path / 'main.prg').write_text(
        'Function main\n  Integer i\n  Xqt 2, other\n  Motor On\n  Power High\n  Speed 30\n'
        '  For i = 1 To 5\n    Go AglToPls(5 * i, 0, 0, 0, 0, 0) CP\n    Print i, Tmr(0)\n'
        '  Next i\n  Quit other\nFend\n'
        'Function other\n  Do\n    Print Tmr(0), Agl(1)\n    Wait 0.03\n  Loop\nFend\n'
    )
    first, second = (run_with_input('', '--fast', tmp_path) for _ in range(2))
    assert first.returncode == 0, first.stderr
    assert first.stdout == second.stdout
    assert len(first.stdout.splitlines()) > 20


def test_program_error_ends_the_run_and_is_reported(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text(
        'Function main\n  Integer a(3), i\n  i = 7\n  a(i) = 1\nFend\n'
    )
    done = run_with_input('', '--fast', tmp_path)
    assert done.returncode == 1
    assert 'main.prg:4: error 9992 in main (task 1): an array index is out of range' in done.stderr


def test_invalid_program_is_not_started(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text('Function main\n  Jumps P1\nFend\n')
    done = run_with_input('', tmp_path)
    assert done.returncode == 1
    message = 'error: unknown statement or function Jumps: did you mean Jump? [unknown]'
    assert done.stdout == f'{tmp_path}/main.prg:2:3: {message}\n'
    assert done.stderr == f'{tmp_path} has no .sprj file: all its .prg files are built\n'


def test_timeout_of_run_shows_the_tasks(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text('Function main\n  Do\n    Wait 1\n  Loop\nFend\n')
    done = run_with_input('', '--fast', '--seconds', '5', tmp_path)
    assert done.returncode == 3
    assert 'still running after 5.00 s' in done.stderr
    assert 'task 1 main (Normal): waits main.prg:3' in done.stderr


def test_run_accepts_operator_actions_on_the_remote_port(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text(
        'Function main\n  Wait Sw(3) = On\n  On 2\n  Print "seen"\nFend\n'
    )
    process = subprocess.Popen(
        [*COMMAND, 'run', str(tmp_path)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    listening = next(line for line in process.stderr if line.startswith('listening'))
    ports = dict(word.split('=') for word in listening.split()[1:])
    do(int(ports['remote']), 'io', 'DI', '3', 'on')
    assert process.communicate(timeout=120)[0] == 'seen\n'
    assert process.returncode == 0


HOMES = """Function main
  Motor On
  On 40
  Tool 1
  Home
  TesterStarts
  Print Oport(40), CZ(Here)
Fend
Function TesterStarts  ' is no test here, so it makes no settings
  If CZ(TLSet(1)) <> 50 Then Error 8001
  TLSet 1, XY(0, 0, 50, 0)
Fend
"""


@pytest.mark.slow
def test_run_executes_the_setup_statements_before_the_program(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text(HOMES)
    (tmp_path / 'robot.pts').write_text('sVersion="2.0.0"\nnNumberOfPoints=0\n')
    settings = tmp_path / 'spel.yaml'
    settings.write_text('robot: t3_401s\nsetup: HomeSet 0, 0, 0, 0\ntools:\n  1: [0, 0, 20, 0]\n')
    done = run_with_input('', '--fast', '--set', 'tools.1=[0, 0, 50, 0]', tmp_path)
    assert (done.returncode, done.stdout.split()) == (0, ['1', '50']), done
    done = run_with_input('', '--fast', '--set', 'setup=HomeSett', tmp_path)
    assert done.returncode == 2
    assert f'{settings}: TLSet 1, XY(0, 0, 20, 0); HomeSett: unknown statement' in done.stderr
    settings.write_text('robot: t3_401s\n')
    done = run_with_input('', '--fast', tmp_path)
    advice = 'Tool: 1 is not defined: use TLSet, or add `1: [X, Y, Z, U]` under `tools:`'
    assert advice in done.stdout + done.stderr


def test_program_connects_to_a_local_server(tmp_path: Path) -> None:
    """`OpenNet … As Client` uses the port of the system configuration."""
    (tmp_path / 'main.prg').write_text(
        'Function main\n  String s$\n  OpenNet #202 As Client\n  WaitNet #202\n'
        '  Print #202, "hello"\n  Input #202, s$\n  Print s$\n  CloseNet #202\nFend\n'
    )
    with socket.create_server(('127.0.0.1', 0)) as server:
        server.settimeout(30)
        port = f'ports.202=192.168.0.9:{server.getsockname()[1]}:LF'
        command = [*COMMAND, 'run', '--set', port, str(tmp_path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL) as done:
            client, _ = server.accept()
            with client:
                client.settimeout(30)
                assert client.recv(100) == b'hello\n'
                client.sendall(b'and you\n')
                assert client.recv(100) == b''
            assert done.communicate(timeout=30)[0] == b'and you\n'
    assert done.returncode == 0


def test_test_functions_can_move_the_arm(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text(
        'Function TestJumps\n  Motor On\n  Jump XY(0, 300, -50, 0)\n'
        '  If CZ(Here) <> -50 Or Tmr(0) < 0.1 Or In(511) <> 0 Then Error 8001\nFend\n'
    )
    done = run('test', '--robot', 't3_401s', tmp_path)
    assert done.returncode == 0, done.stdout
    done = run('test', 'main.prg', cwd=tmp_path)
    message = 'FAILED TestJumps: main.prg:3: error 9993: Jump: c3_a601s is not a SCARA'
    assert done.stdout.startswith(message)
    assert done.stderr == ''


def test_coverage_lists_the_executed_lines(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text(
        'Function pick(found As Boolean)\n  If found Then\n    On 1\n  Else\n    Off 1\n'
        '  EndIf\nFend\nFunction TestPick\n  SetSw 3, On\n  pick(Sw(3))\nFend\n'
        'Function TestMore\n  pick(True)\nFend\n'
    )
    (tmp_path / 'more').mkdir()
    (tmp_path / 'more' / 'main.prg').write_text('Function TestNothing\nFend\n')
    done = run('test', '--coverage', 'coverage.xml', '.', 'more', cwd=tmp_path)
    assert done.stdout.splitlines()[-3:] == [
        'main.prg: 8 of 9 lines ran',
        'more/main.prg: 1 of 1 lines ran',
        '3 passed, 0 failed',
    ]
    report = Xml.parse(tmp_path / 'coverage.xml').getroot()
    assert [item.get('filename') for item in report.iter('class')] == ['main.prg', 'more/main.prg']
    missed = [line.get('number') for line in report.iter('line') if line.get('hits') == '0']
    assert missed == ['5']
    assert report.get('lines-valid') == '10'


def test_fmt_writes_files_and_check_only_names_them(tmp_path: Path) -> None:
    file = tmp_path / 'main.prg'
    file.write_bytes(b'\xef\xbb\xbffunction main\r\nprint "\x83A"\r\nfend\r\n')
    (tmp_path / 'notes.txt').write_text('function')
    checked = run('fmt', '--check', tmp_path)
    assert (checked.returncode, checked.stdout) == (1, f'would format {file}\n')
    assert run('fmt', tmp_path).returncode == 0
    content = b'\xef\xbb\xbfFunction main\r\n  Print "\x83A"\r\nFend\r\n'
    assert file.read_bytes() == content
    assert run('fmt', '--check', tmp_path).returncode == 0
    assert run('fmt', tmp_path / 'none.prg').returncode == 2


def test_points_are_shown_as_a_table_and_converted(tmp_path: Path) -> None:
    table = tmp_path / 'points.csv'
    table.write_text(
        'Number,Label,Description,X,Y,Z,Local,Hand,Elbow,Wrist,J4Flag,J1Angle\n'
        '3,pick,"the ""red"" one",1,-20.5,3,2,2,1,1,1,-90\n'
    )
    assert run('points', table, '--to', tmp_path / 'robot1.pts').returncode == 0
    result = run('points', tmp_path / 'robot1.pts')
    assert result.returncode == 0
    head, line = result.stdout.splitlines()
    assert head.split() == ['label', *'XYZUVW', 'flags', 'description']
    assert line == (
        'P3  pick   1.000  -20.500  3.000  0.000  0.000  0.000  /L /A /NF /J4F1 /J1A(-90) /2'
        '  the "red" one'
    )
    with table.open('a') as file:
        file.write('4,,,1,2,3,,2,1,1,,\n5,place,,1,2,3,,2,1,1,,\n')
    result = run('points', table, '--to', tmp_path / 'a.yaml')
    assert result.stderr == '2 points without label or position omitted\n'
    assert (tmp_path / 'a.yaml').read_text().startswith('place: {x: 1.0, y: 2.0, z: 3.0')
