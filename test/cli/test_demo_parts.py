# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the demo refuses, and what it says of a run that was not as planned."""

import dataclasses
import io
import socket
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from support.longer_arm import arm_file

from epson_driver.cli import demo, staying
from epson_driver.cli.demo_verdict import TOO_BUSY
from epson_driver.cli.panel import INSTALL
from epson_driver.cli.processes import Ports, RunError
from epson_driver.inputs import InputError
from epson_driver.motion import Trajectory
from epson_driver.report.figures import figures
from epson_driver.report.measure import Figures, Recording, measure
from epson_driver.report.run import Plan, Run
from epson_driver.robots import load_robot_model
from epson_driver.share import share_file

MODEL = load_robot_model('c3_a601s')
FILE = share_file('config', 'trajectories', 'around_pillar_11_points.yaml')


def console():
    return Console(file=io.StringIO(), width=200)


def test_an_arm_that_is_neither_a_six_axis_one_nor_a_scara_is_refused(
    monkeypatch, capsys, tmp_path
):
    words = ['--robot', str(arm_file(tmp_path, 7)), '--trajectory', str(FILE)]
    monkeypatch.setattr(sys, 'argv', ['epson_driver demo', *words])
    with pytest.raises(SystemExit, match='2'):
        demo.main()
    said = capsys.readouterr().err
    assert 'c3_with_7_joints is neither a six-axis arm nor a SCARA' in said


def test_a_trajectory_of_another_arm_is_refused_with_the_joints_of_both():
    with pytest.raises(InputError) as error:
        demo._fitting(FILE, load_robot_model('gx4_c251s'))
    text = str(error.value)
    assert text.startswith(f'{FILE}: its joints are joint_1, ')
    assert text.endswith('joint_4: name its model with --robot')
    assert demo._fitting(FILE, MODEL).joint_names == MODEL.joint_names


def executed(**figures):
    """Return a run with these figures; of the rest it is as planned."""
    fields = {each.name: 0 for each in dataclasses.fields(Figures)}
    found = Figures(**fields | {'planned': 1.0} | figures)
    still = Recording(np.array([0.0, 1.0]), np.zeros((2, 6)), np.zeros((2, 6)))
    return demo.Run('smooth', still, found, 'there', {}, [1e-3], 0, (None, None))


@pytest.mark.parametrize(
    ('figures', 'faults'),
    [
        ({}, []),
        ({'stops': 1}, ['the arm stopped once on the way']),
        ({'stops': 3}, ['the arm stopped 3 times on the way']),
        (
            {'waypoint_deviation': 0.25},
            [f'a waypoint was missed by 0.2500 rad, {demo.MAX_DEVIATION_RAD:g} rad are allowed'],
        ),
    ],
)
def test_what_was_not_as_planned_is_a_sentence_each(figures, faults):
    assert executed(**figures).faults == faults


@pytest.mark.parametrize(
    ('found', 'commanded', 'motions', 'standstills', 'told'),
    [
        (0, 0, [2], 0, 2),
        (1, 0, [0], 0, 1),
        (0, 0, [None], 0, 0),
        (0, 0, [], 1, 1),
        (0, 2, [0], 2, 0),
        (0, 1, [0], 3, 2),
    ],
)
def test_the_verdict_tells_of_the_stops_that_the_page_tells_of(
    found, commanded, motions, standstills, told
):
    numbers = executed(stops=found, commanded_stops=commanded).figures
    stood = [(0.1, 0.08)] * standstills
    page = SimpleNamespace(motions=[SimpleNamespace(stops=m) for m in motions], stops=stood)
    assert demo.as_on_page(numbers, page).stops == told


def test_a_rest_behind_a_slow_beginning_is_a_stop():
    """As it was once on a busy machine: the points came late behind the first one."""
    times = np.arange(0.0, 3.0, 0.0055)
    speed = np.interp(
        times,
        [0.1, 0.13, 0.32, 0.35, 0.45, 0.5, 1.5, 2.5],
        [0.0, 0.05, 0.05, 0.0, 0.0, 0.3, 1.2, 0.0],
    )
    positions = np.zeros((len(times), 6))
    positions[:, 0] = np.cumsum(speed) * 0.0055
    plan = Trajectory(MODEL.joint_names, np.array([0.0, 2.5]), positions[[0, -1]])
    found = measure(plan, Recording(times, positions, np.zeros_like(positions)))
    sent = Plan(0.05, plan.times, plan.positions)
    page = figures(Run('busy', 0, MODEL.joint_names, times, positions, plans=[sent]))
    assert found.stops == 0
    assert demo.as_on_page(found, page).stops == 1


def test_stops_that_the_plan_asks_for_are_told_apart():
    plan = demo._fitting(FILE, MODEL)
    rows = dict(demo._rows(MODEL, plan, executed(stops=1, commanded_stops=2)))
    assert rows['stops on the way'] == '1, and 2 that the plan asks for'
    assert dict(demo._rows(MODEL, plan, executed()))['stops on the way'] == '0'


def test_a_report_that_cannot_be_written_hides_no_verdict(monkeypatch):
    def fails(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(demo, 'figures', lambda *_: None)
    monkeypatch.setattr(demo, 'write_report', fails)
    out = console()
    error = demo._GoalError('goal aborted: E-stop', 0, None)
    code = demo._unfinished(error, MODEL, Path('demo.html'), out)
    said = out.file.getvalue()
    assert code not in (0, TOO_BUSY)
    assert 'no report: ' in said
    assert 'No space left on device' in said
    assert 'goal aborted: E-stop' in said


def test_a_controller_that_closes_its_io_port_is_told():
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]

        def once():
            connection, _ = server.accept()
            with connection:
                connection.recv(4096)

        thread = threading.Thread(target=once)
        thread.start()
        with pytest.raises(RunError, match='the controller closed its I/O port'):
            demo._ping(Ports(0, 0, port, 0))
        thread.join()


# --- --panel and --stay -----------------------------------------------------------------------


def test_without_the_panel_s_libraries_the_demo_goes_on_and_says_what_to_install(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(staying, 'missing', lambda: True)
    out = console()
    driver = SimpleNamespace(domain=1)
    with staying.panel_beside(tmp_path, driver, out, wanted=True) as address:
        assert address is None
    assert out.file.getvalue().split() == INSTALL.split()


@pytest.mark.invariant(9)
def test_a_driver_that_ends_while_a_person_uses_it_is_an_error(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

    def ended():
        raise RunError('client ended with 1')

    process = SimpleNamespace(wait=lambda: 1, check_alive=ended)
    out = console()
    with pytest.raises(RunError, match='client ended with 1'):
        staying.stay(SimpleNamespace(process=process), 'http://127.0.0.1:8080/', out)
    said = out.file.getvalue()
    assert 'export ROS_DOMAIN_ID=7' in said
    assert 'panel: http://127.0.0.1:8080/' in said
