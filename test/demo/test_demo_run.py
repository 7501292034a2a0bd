# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The demo's runs, verdicts and ROS client."""

import dataclasses
import io
import socket
import struct
import sys
import threading
from contextlib import suppress
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer
from rclpy.executors import MultiThreadedExecutor
from rich.console import Console
from sensor_msgs.msg import JointState
from support.longer_arm import arm_file
from support.spin_thread import SpinThread

from epson_driver.cli import demo
from epson_driver.demo import cell, ros_client, run
from epson_driver.demo.ros_client import RosClient
from epson_driver.demo.run import MAX_GAP_S, TOO_BUSY, deadlines_missed, verdict
from epson_driver.inputs import InputError
from epson_driver.motion import Trajectory
from epson_driver.panel import INSTALL
from epson_driver.processes import processes
from epson_driver.processes.processes import Ports, RunError, free_ros_domain, ros_environment
from epson_driver.report.figures import figures
from epson_driver.report.measure import Figures, Recording, measure
from epson_driver.report.run import Plan, Run
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path

MODEL = load_robot_model('c3_a601s')
FILE = share_path('config', 'trajectories', 'around_pillar_11_points.yaml')


def console():
    return Console(file=io.StringIO(), width=200)


def test_seven_axis_arm_is_refused(monkeypatch, capsys, tmp_path):
    words = ['--robot', str(arm_file(tmp_path, 7)), '--trajectory', str(FILE)]
    monkeypatch.setattr(sys, 'argv', ['epson_driver demo', *words])
    with pytest.raises(SystemExit, match='2'):
        demo.main()
    output = capsys.readouterr().err
    assert 'c3_with_7_joints is neither a six-axis arm nor a SCARA' in output


def test_trajectory_of_another_arm_is_refused():
    with pytest.raises(InputError) as error:
        demo._fitting(FILE, load_robot_model('gx4_c251s'))
    text = str(error.value)
    assert text.startswith(f'{FILE}: its joints are joint_1, ')
    assert text.endswith('joint_4: select its model with --robot')
    assert demo._fitting(FILE, MODEL).joint_names == MODEL.joint_names


def executed(**figures):
    """Return a run with these figures, and otherwise as planned."""
    fields = {field.name: 0 for field in dataclasses.fields(Figures)}
    result = Figures(**fields | {'planned': 1.0} | figures)
    still = Recording(np.array([0.0, 1.0]), np.zeros((2, 6)), np.zeros((2, 6)))
    return run.Run('smooth', still, result, 'there', {}, [1e-3], 0, (None, None))


@pytest.mark.parametrize(
    ('figures', 'faults'),
    [
        ({}, []),
        ({'stops': 1}, ['the arm stopped once during the motion']),
        ({'stops': 3}, ['the arm stopped 3 times during the motion']),
        (
            {'waypoint_deviation': 0.25},
            [f'a waypoint was missed by 0.2500 rad (allowed: {run.MAX_DEVIATION_RAD:g} rad)'],
        ),
    ],
)
def test_deviation_from_the_plan_is_reported(figures, faults):
    assert executed(**figures).faults == faults


@pytest.mark.parametrize(
    ('found', 'commanded', 'motions', 'standstills', 'reported'),
    [
        (0, 0, [2], 0, 2),
        (1, 0, [0], 0, 1),
        (0, 0, [None], 0, 0),
        (0, 0, [], 1, 1),
        (0, 2, [0], 2, 0),
        (0, 1, [0], 3, 2),
    ],
)
def test_verdict_counts_the_stops_of_the_page(found, commanded, motions, standstills, reported):
    numbers = executed(stops=found, commanded_stops=commanded).figures
    stood = [(0.1, 0.08)] * standstills
    page = SimpleNamespace(motions=[SimpleNamespace(stops=m) for m in motions], stops=stood)
    assert run.as_on_page(numbers, page).stops == reported


def test_pause_after_a_slow_start_is_a_stop():
    """On a busy machine the points after the first one were late."""
    times = np.arange(0.0, 3.0, 0.0055)
    speed = np.interp(
        times,
        [0.1, 0.13, 0.32, 0.35, 0.45, 0.5, 1.5, 2.5],
        [0.0, 0.05, 0.05, 0.0, 0.0, 0.3, 1.2, 0.0],
    )
    positions = np.zeros((len(times), 6))
    positions[:, 0] = np.cumsum(speed) * 0.0055
    plan = Trajectory(MODEL.joint_names, np.array([0.0, 2.5]), positions[[0, -1]])
    result = measure(plan, Recording(times, positions, np.zeros_like(positions)))
    sent = Plan(0.05, plan.times, plan.positions)
    page = figures(Run('busy', 0, MODEL.joint_names, times, positions, plans=[sent]))
    assert result.stops == 0
    assert run.as_on_page(result, page).stops == 1


@pytest.mark.parametrize(('hung', 'expected'), [(0.01, 1), (0.72, TOO_BUSY)])
def test_unwritable_report_does_not_hide_the_verdict(monkeypatch, hung, expected):
    def fails(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(run, 'figures', lambda *_: None)
    monkeypatch.setattr(run, 'write_report', fails)
    out = console()
    wire = SimpleNamespace(times=np.cumsum([0.01] * 9 + [hung]))
    error = run._GoalError('goal aborted: E-stop', 0, wire)
    code = run._unfinished(error, MODEL, Path('demo.html'), out)
    output = out.file.getvalue()
    assert code == expected
    assert 'no report: ' in output
    assert 'No space left on device' in output
    assert 'goal aborted: E-stop' in output


def pinged(*handlers):
    """Ping a port. Each client gets the next handler, and all further clients the last one."""
    with socket.create_server(('127.0.0.1', 0)) as server:

        def serve():
            for handler in chain(handlers[:-1], repeat(handlers[-1])):
                try:
                    connection, _ = server.accept()
                except OSError:  # the test has ended
                    return
                with connection, suppress(ConnectionError):
                    handler(connection)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            return run._ping(Ports(0, 0, server.getsockname()[1], 0))
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()


def leaves(connection):
    connection.recv(4096)


def resets(connection):
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))


def echoes(connection):
    while output := connection.recv(4096):
        connection.sendall(output)


def test_io_port_closed_by_the_controller_is_reported(monkeypatch):
    monkeypatch.setattr(run, 'TIMEOUT_S', 0.3)
    with pytest.raises(RunError, match='the controller closed its I/O port: it ended the'):
        pinged(leaves)


def test_ping_is_repeated_after_a_disconnect():
    assert len(pinged(resets, leaves, echoes)) == run.PINGS


# --- --panel and --stay -----------------------------------------------------------------------


def test_missing_panel_libraries_are_reported(monkeypatch, tmp_path):
    monkeypatch.setattr(cell, 'missing', lambda: True)
    out = console()
    driver = SimpleNamespace(domain=1)
    with cell.panel_beside(tmp_path, driver, out, enabled=True) as address:
        assert address is None
    assert out.file.getvalue().split() == INSTALL.split()


@pytest.mark.invariant(9)
def test_end_of_the_driver_is_an_error_with_the_option_stay(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

    def ended():
        raise RunError('client ended with 1')

    process = SimpleNamespace(wait=lambda: 1, check_alive=ended)
    out = console()
    with pytest.raises(RunError, match='client ended with 1'):
        cell.stay(SimpleNamespace(process=process), 'http://127.0.0.1:8080/', out)
    output = out.file.getvalue()
    assert 'export ROS_DOMAIN_ID=7' in output
    assert 'panel: http://127.0.0.1:8080/' in output


FAULT = 'smooth: the arm stopped once during the motion'


@pytest.mark.parametrize(
    ('faults', 'missed', 'gap', 'code', 'words'),
    [
        ([], 0, 0.01, 0, 'the arm followed the plan'),
        ([], 900, 3.0, 0, 'the arm followed the plan'),
        ([FAULT], 0, 0.01, 1, f'the motion differs from the plan: {FAULT}'),
        ([FAULT], 0, MAX_GAP_S, 1, f'the motion differs from the plan: {FAULT}'),
        (
            [FAULT],
            1,
            0.01,
            TOO_BUSY,
            'too busy to judge the motion: the simulated controller missed 1',
        ),
        ([FAULT], 0, 0.25, TOO_BUSY, 'joint states were up to 250 ms apart'),
    ],
)
def test_missed_deadlines_make_the_verdict_too_busy(faults, missed, gap, code, words):
    result, sentence = verdict(faults, missed, gap)
    assert result == code
    assert words in sentence
    assert '\n' not in sentence


def test_sim_controller_reports_missed_deadlines(tmp_path):
    controller = processes.sim_controller(tmp_path / 'log', start=[0.0] * 6)
    with processes.ended_at_exit(controller):
        assert deadlines_missed(controller.ports().remote) >= 0


NAMES = ('joint_1', 'joint_2')


class LateStates:
    """A driver whose joint states arrive after the goal's result, which DDS allows."""

    def __init__(self, context):
        self.over = threading.Event()
        self.later = threading.Thread(target=self._later)
        self.node = rclpy.create_node('epson_driver', context=context)
        self.publisher = self.node.create_publisher(JointState, 'joint_states', 200)
        self.server = ActionServer(
            self.node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory', self._execute
        )

    def publish(self, position):
        state = JointState(name=NAMES, position=[position, 0.0], velocity=[0.0, 0.0])
        state.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(state)

    def _execute(self, handle):
        self.publish(0.1)
        handle.succeed()
        self.later.start()
        return FollowJointTrajectory.Result()

    def _later(self):
        while not self.over.wait(0.01):
            self.publish(0.5)


def test_recording_includes_states_after_the_result(monkeypatch):
    """A result may overtake joint states, and the end position must not count as missed."""
    domain = free_ros_domain()
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    driver = LateStates(context)
    executor = MultiThreadedExecutor(context=context)
    executor.add_node(driver.node)
    thread = SpinThread(executor)
    thread.start()
    user = RosClient(NAMES, lambda: None)
    try:
        plan = Trajectory(NAMES, np.array([1.0]), np.array([[0.5, 0.0]]))
        _, succeeded = user.follow(plan, lambda _: None)
        assert succeeded
        assert user.recording().positions[-1].tolist() == [0.5, 0.0]
    finally:
        driver.over.set()
        if driver.later.ident is not None:
            driver.later.join()
        user.close()
        thread.end()
        driver.server.destroy()
        driver.node.destroy_node()
        context.try_shutdown()


@pytest.fixture
def client(monkeypatch):
    """A ROS client without a driver."""
    for name, value in ros_environment(free_ros_domain()).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(ros_client, 'READY_TIMEOUT_S', 0.05)
    result = RosClient(NAMES, lambda: None)
    yield result
    result.close()
