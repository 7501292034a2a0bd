# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver exercise` tells three example programs apart; the fixture for other packages."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from epson_driver.cli import exercise as command
from epson_driver.exercise.cases import CASES

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
    """Return by fault what went wrong, 'passed' if nothing did."""
    found = {}
    for case in ElementTree.parse(junit).getroot():
        failure = case.find('failure')
        found[case.get('name')] = 'passed' if failure is None else failure.get('message')
    return found


@pytest.mark.slow
@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('name', 'expected', 'code'),
    [
        pytest.param('good', 'passed', 0, marks=pytest.mark.slow),
        pytest.param('hangs', 'hung', 1, marks=pytest.mark.slow),
        ('repeats', 'moved after E-stop', 1),
    ],
)
def test_three_programs_are_told_apart(tmp_path, name, expected, code):
    junit = tmp_path / 'junit.xml'
    words = ['--fault=estop', '--timeout=150', f'--junit={junit}', f'--keep={tmp_path / "kept"}']
    run = exercise(*words, *program(name))
    assert run.returncode == code, run.stdout + run.stderr
    assert verdicts(junit) == {'estop': expected}
    assert (tmp_path / 'kept' / 'estop' / 'wire.pcap').stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ('controller', 'name', 'fault', 'expected'),
    [
        ('motoman', 'good', 'cut', 'passed'),
        ('fanuc', 'good', 'cut', 'passed'),  # serves one state client: the driver
        ('spel', 'good', 'motors_off', 'passed'),  # not taken while main runs
        ('spel', 'repeats', 'estop', 'moved after E-stop'),
    ],
)
def test_every_kind_of_controller_can_be_exercised(tmp_path, controller, name, fault, expected):
    junit = tmp_path / 'junit.xml'
    words = [f'--controller={controller}', f'--fault={fault}', '--timeout=150']
    run = exercise(*words, f'--junit={junit}', *program(name))
    assert run.returncode == int(expected != 'passed'), run.stdout + run.stderr
    assert verdicts(junit) == {fault: expected}


@pytest.mark.slow
def test_a_program_that_repeats_after_a_lost_reply_is_told(tmp_path):
    junit = tmp_path / 'junit.xml'
    run = exercise('--fault=cut', '--timeout=150', f'--junit={junit}', *program('repeats'))
    assert run.returncode == 1, run.stdout + run.stderr
    assert verdicts(junit) == {'cut': 'repeated'}


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ((), 'which program?'),
        (('--', 'no-such-program'), 'no such program'),
        (('--fault', 'flood', '--', 'true'), 'invalid choice'),
        (('--controller', 'mars', '--', 'true'), 'no mars'),
        (('--timeout', '0', '--', 'true'), 'must be a number from 1 to 3600'),
        (('--keep', str(PROGRAMS), '--', 'true'), 'is there already'),
    ],
)
def test_wrong_arguments_are_said_in_one_sentence(monkeypatch, capsys, words, said):
    monkeypatch.setattr(sys, 'argv', ['epson_driver exercise', *words])
    with pytest.raises(SystemExit, match='2'):
        command.main()
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_a_program_that_does_not_even_work_without_a_fault_is_told():
    run = exercise('--fault=estop', '--timeout=60', '--', sys.executable, '-c', 'print("hello")')
    assert run.returncode == 2
    assert 'without having moved the arm' in ' '.join(run.stdout.split())


def test_the_list_names_every_case(monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['epson_driver exercise', '--list'])
    assert command.main() == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert listed == list(CASES)


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
def test_another_package_uses_the_fixture(tmp_path):
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
