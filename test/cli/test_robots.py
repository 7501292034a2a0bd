# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver robots`: the list, one model, pipes, terminals and unknown models."""

import os
import pty
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.here import run_here
from support.longer_arm import arm_model

from epson_driver.cli import robots
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.reader import MARKS

COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'robots']


run = partial(run_here, robots.main)


def tables(text: str) -> dict[str, dict[str, list[str]]]:
    """Return plain text as rows by their first word, by table title."""
    result = {}
    for block in text.strip().split('\n\n'):
        title, _, *rows = block.splitlines()
        result[title.removeprefix('# ')] = {
            row.split('\t')[0]: row.split('\t')[1:] for row in rows
        }
    return result


@pytest.fixture(scope='module')
def c3() -> dict[str, dict[str, list[str]]]:
    return tables(run('c3_a601s').stdout)


def test_list_in_a_pipe_is_separated_by_tabs() -> None:
    done = run()
    assert (done.returncode, done.stderr) == (0, '')
    head, *lines = done.stdout.splitlines()
    assert head == '\t'.join(('name', 'kind', 'axes', 'reach [mm]', 'payload [kg]', *MARKS))
    rows = [line.split('\t') for line in lines]
    assert [row[0] for row in rows] == list(robot_models())
    for name, kind, axes, reach, payload, *marks in rows:
        model = load_robot_model(name)
        assert (kind, axes) == (model.kind, str(len(model.joint_names)))
        assert float(reach) == pytest.approx(model.reach[0] * 1e3, abs=0.5)
        assert float(payload) == model.payload
        for level, listed in zip(MARKS, marks, strict=True):
            assert [*filter(None, listed.split(', '))] == [
                quantity for quantity, origin in model.provenance.items() if origin.worst == level
            ]
    confirmed, *_, estimated = next(row[5:] for row in rows if row[0] == 'c3_a601s')
    assert 'range' in confirmed.split(', ')
    assert {'acceleration', 'jerk', 'payload'} <= set(estimated.split(', '))


def test_model_is_shown_in_degrees_and_si_units(c3: dict[str, dict[str, list[str]]]) -> None:
    joints = c3['Joints']
    assert joints['position min [degrees]'] == ['-170', '-160', '-51', '-200', '-135', '-360']
    assert float(joints['position max [rad]'][1]) == pytest.approx(np.radians(65.0), rel=1e-6)
    speeds = [float(word) for word in joints['velocity [rad/s]']]
    assert speeds == pytest.approx([7.85, 7.85, 8.97, 9.65, 9.65, 12.56], rel=1e-6)
    assert float(joints['velocity [degrees/s]'][0]) == pytest.approx(450.0, abs=0.3)
    assert joints['acceleration [rad/s²]'][0] == '49.19'
    assert joints['pulses per degree'][0] == '29127.11'
    assert joints['reach [m]'] == ['0.665', '0.565', '0.315', '0.065', '0.065', '0']
    assert c3['c3_a601s: EPSON C3-A601S, six-axis, table top mount']['payload'] == ['3 kg']
    chain = c3['Chain, in base_link, m']
    assert chain['joint_2, revolute'] == ['0.1 0 0.1235', '0 -1 0']
    assert chain['tool0, in the last link'] == ['0.005 0 0', '3.141593 -1.570796 0']
    assert c3['OPW lengths, m']['c1'] == ['0.32']


def test_every_quantity_has_its_source(c3: dict[str, dict[str, list[str]]]) -> None:
    model = load_robot_model('c3_a601s')
    assert list(c3['Sources']) == list(model.provenance)
    for quantity, (mark, source) in c3['Sources'].items():
        origin = model.provenance[quantity]
        assert source == origin.source
        assert set(mark.split(', ')) == set(origin.marks)


def test_scara_is_shown_in_mm_and_m() -> None:
    shown = tables(run('gx4_c251s').stdout)
    joints = shown['Joints']
    assert joints['position min [degrees or mm]'] == ['-50', '-141', '-150', '-360']
    assert joints['position min [rad or m]'][2] == '-0.15'
    assert joints['velocity [degrees/s or mm/s]'][2] == '1152'
    assert joints['reach [m or 1]'] == ['0.25', '0.126', '1', '0']
    lengths = {'arm_1': ['0.124'], 'arm_2': ['0.126'], 'height': ['0.124']}
    assert shown['SCARA lengths, m'] == lengths


@pytest.mark.parametrize(
    ('arguments', 'found', 'not_found'),
    [
        (('--search', 't6'), {'t6_602s', 't6_b602s'}, {'t3_401s', 'c3_a601s'}),
        (('--search', 'VT6L'), {'vt6_a901s'}, {'c3_a601s'}),
        (('--search', 'ceiling'), {'gx8_c552sr', 'cx4_a601cr'}, {'gx8_c552s'}),
        (('--payload', '3', '--reach', '600'), {'t6_602s', 'c3_a601s'}, {'t3_401s', 'gx8_c552s'}),
        (('--search', 'nothing-like-it'), set(), {'c3_a601s'}),
    ],
)
def test_list_can_be_filtered(
    arguments: tuple[str, ...], found: set[str], not_found: set[str]
) -> None:
    names = {line.split('\t')[0] for line in run(*arguments).stdout.splitlines()[1:]}
    assert found <= names
    assert not found or not names & not_found
    assert len(names) < len(robot_models())


def test_model_file_is_shown(tmp_path: Path) -> None:
    mine = tmp_path / 'mine.yaml'
    mine.write_text('name: mine\nlike: C3-A601S\npayload_kg: 2.5\n', encoding='utf-8')
    assert run(str(mine)).stdout.startswith('# mine: six-axis, table top mount')
    mine.write_text('name: mine\nlike: C3-A601S\npayload_kg: heavy\n', encoding='utf-8')
    done = run(str(mine))
    assert done.returncode == 2
    assert f"{mine}, line 3: payload_kg = 'heavy': must be a number" in done.stderr


def test_unknown_model_is_an_error() -> None:
    done = run('c5')
    assert done.returncode == 2
    assert done.stdout == ''
    assert 'no robot model c5; ' in done.stderr
    assert 'Traceback' not in done.stderr


def on_a_terminal(*arguments: str) -> str:
    """Return the command's output on a terminal of 150 columns."""
    ours, theirs = pty.openpty()
    environment = os.environ | {'COLUMNS': '150', 'TERM': 'xterm-256color'}
    with subprocess.Popen([*COMMAND, *arguments], stdout=theirs, env=environment) as shown:
        os.close(theirs)
        text = b''
        try:
            while part := os.read(ours, 65536):
                text += part
        except OSError:  # the other end is closed
            pass
        os.close(ours)
    assert shown.returncode == 0
    return text.decode()


@pytest.mark.slow
def test_terminal_shows_coloured_tables_unless_plain() -> None:
    text = on_a_terminal('c3_a601s')
    assert '┃' in text
    assert 'position min [degrees]' in text  # brackets are no markup
    assert '\x1b[31mestimated' in text
    assert '\x1b[32mconfirmed' in text
    plain = on_a_terminal('c3_a601s', '--plain')
    assert plain.replace('\r\n', '\n') == run('c3_a601s').stdout


def test_arm_without_closed_form_kinematics_gives_the_reason(tmp_path: Path) -> None:
    ((name, why),) = robots._lengths(arm_model(tmp_path, 7))
    assert (name, 'c3_with_7_joints' in why) == ('none', True)
    known = dict(robots._lengths(load_robot_model('c3_a601s')))
    assert 'none' not in known
    assert all(float(value) is not None for value in known.values())
