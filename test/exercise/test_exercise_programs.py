# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver exercise` with example programs, and the pytest fixture for other packages."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from epson_driver.cli import exercise as command

PROGRAMS = Path(__file__).parent / 'programs'


def exercise(*words):
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'exercise', *words],
        capture_output=True,
        text=True,
        timeout=590,
        check=False,
    )


def program(name):
    return ['--', sys.executable, str(PROGRAMS / f'{name}.py')]


def verdicts(junit):
    """Return the failure of each fault, or 'passed'."""
    result = {}
    for case in ElementTree.parse(junit).getroot():
        failure = case.find('failure')
        result[case.get('name')] = 'passed' if failure is None else failure.get('message')
    return result


@pytest.mark.slow
@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('name', 'expected', 'code'),
    [
        ('good', 'passed', 0),
        pytest.param('hangs', 'hung', 1, marks=pytest.mark.soak),
        pytest.param('repeats', 'moved after E-stop', 1, marks=pytest.mark.soak),
    ],
)
def test_example_programs_have_different_verdicts(tmp_path, name, expected, code):
    junit = tmp_path / 'junit.xml'
    timeout = 60 if name == 'hangs' else 150
    words = [
        '--fault=estop',
        f'--timeout={timeout}',
        f'--junit={junit}',
        f'--keep={tmp_path / "kept"}',
    ]
    run = exercise(*words, *program(name))
    assert run.returncode == code, run.stdout + run.stderr
    assert verdicts(junit) == {'estop': expected}
    assert (tmp_path / 'kept' / 'estop' / 'wire.pcap').stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ('controller', 'name', 'fault', 'expected'),
    [
        ('fanuc', 'good', 'cut', 'passed'),  # serves one state client: the driver
        pytest.param(  # refused while main runs
            'spel', 'good', 'motors_off', 'passed', marks=pytest.mark.soak
        ),
        ('spel', 'repeats', 'estop', 'moved after E-stop'),
    ],
)
def test_program_is_exercised_with_every_kind_of_controller(
    tmp_path, controller, name, fault, expected
):
    junit = tmp_path / 'junit.xml'
    words = [f'--controller={controller}', f'--fault={fault}', '--timeout=150']
    run = exercise(*words, f'--junit={junit}', *program(name))
    assert run.returncode == int(expected != 'passed'), run.stdout + run.stderr
    assert verdicts(junit) == {fault: expected}


@pytest.mark.slow
def test_repeated_motion_after_a_lost_reply_is_reported(tmp_path):
    junit = tmp_path / 'junit.xml'
    run = exercise('--fault=cut', '--timeout=150', f'--junit={junit}', *program('repeats'))
    assert run.returncode == 1, run.stdout + run.stderr
    assert verdicts(junit) == {'cut': 'repeated'}


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ((), 'COMMAND is missing'),
        (('--', 'no-such-program'), 'no such program'),
        (('--fault', 'flood', '--', 'true'), "'flood': must be estop, door"),
        (('--controller', 'mars', '--', 'true'), 'no controller profile mars'),
        (('--timeout', '0', '--', 'true'), 'must be a number from 1 to 3600'),
        (('--keep', str(PROGRAMS), '--', 'true'), 'must be a new folder'),
    ],
)
def test_invalid_argument_of_exercise_is_reported(monkeypatch, capsys, words, message):
    monkeypatch.setattr(sys, 'argv', ['epson_driver exercise', *words])
    with pytest.raises(SystemExit, match='2'):
        command.main()
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_program_without_motion_is_reported():
    run = exercise('--fault=estop', '--timeout=60', '--', sys.executable, '-c', 'print("hello")')
    assert run.returncode == 2
    assert 'without moving the arm' in ' '.join(run.stdout.split())


OTHER_PACKAGE = """
import os
import subprocess
import sys

import pytest


@pytest.mark.sim_controller(arguments=['--motion=ptp'])
def test_ours(sim_controller):
    assert os.environ['ROS_DOMAIN_ID'] == str(sim_controller.domain)
    before = sim_controller.positions[0]
    run = subprocess.run([sys.executable, {program!r}], check=True, stdout=subprocess.PIPE)
    assert run.stdout.endswith(b'there\\n')
    assert abs(sim_controller.positions[0] - before - 0.6) < 0.01
    sim_controller.pendant('estop press')
    failed = subprocess.run([sys.executable, {program!r}], stdout=subprocess.PIPE)
    assert failed.returncode == 1
    assert b'E-stop' in failed.stdout
"""


@pytest.mark.slow
def test_fixture_works_in_another_package(tmp_path):
    (tmp_path / 'conftest.py').write_text(
        "pytest_plugins = ['epson_driver.exercise.pytest_plugin']\n"
    )
    (tmp_path / 'pytest.ini').write_text('[pytest]\naddopts = --strict-markers\n')
    text = OTHER_PACKAGE.format(program=str(PROGRAMS / 'good.py'))
    (tmp_path / 'test_ours.py').write_text(text)
    run = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=590,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert '1 passed' in run.stdout
