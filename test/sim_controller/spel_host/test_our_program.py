# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""controller_program/ on the simulated controller: its arm, reboots, the state, pauses."""

import logging
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import FAILURE, MODEL, STOP, SUCCESS, point
from support.examples import one_in
from support.longer_arm import arm_model
from support.sim_process import COMMAND
from support.spel_program_harness import STEP_S, OurProgramHarness

from epson_driver.driver.smoothing import Smoothing
from epson_driver.driver.smoothing_worker import smoothed_trajectory
from epson_driver.inputs import InputError
from epson_driver.motion import Trajectory
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.report.measure import Recording, measure
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path
from epson_driver.sim_controller.assembly import profile_project
from epson_driver.simple_message import JointPosition, Status
from epson_driver.trajectory_file import read_trajectory

PROFILE = load_controller_profile('spel')
HOME = [0.0] * 6
FAR = [1.5, -0.2, 0.3, 0.1, 0.5, 0.2]


def plan(name='around_pillar_11_points'):
    return read_trajectory(share_path('config', 'trajectories', f'{name}.yaml'))


def smoothed_by_the_driver(trajectory):
    program = PROFILE.program
    how = Smoothing(program.resample_period, thin=True, deviation=program.thin_deviation)
    return smoothed_trajectory(trajectory, trajectory.positions[0], MODEL.limits, how)[0]


def slow_trajectory(end, seconds, count=31):
    """Return a slow trajectory from HOME, straight in joint space."""
    shares = np.linspace(0.0, 1.0, count)[:, None]
    return Trajectory(MODEL.limits.names, shares[:, 0] * seconds, shares * np.array(end))


def moving(**options):
    """Return a harness in motion, and its motion client."""
    harness = OurProgramHarness(**options)
    client = harness.ready()
    for number, joints in enumerate(slow_trajectory(FAR, 12.0).positions[:20].tolist()):
        client.send_bytes(point(number, joints, 0.0, 0.4))
    harness.until(lambda: harness.position[0] > 0.2)
    return harness, client


def assert_still(harness):
    harness.rest()
    stopped = harness.position
    harness.step(2.0)
    assert np.array_equal(harness.position, stopped)


def assert_moves(harness, client):
    """Assert that a new trajectory of the client is executed."""
    client.raw()
    target = harness.position + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert client.stream(point(0, target.tolist(), 0.0, 1.0)) == [(0, SUCCESS)]
    harness.until(lambda: np.abs(harness.position - target).max() < 1e-6)
    harness.rest()


def newest(state, kind):
    """Return the newest message of a kind that a state client has got."""
    messages = [packet.message for packet in state.packets()]
    return next(message for message in reversed(messages) if isinstance(message, kind))


@pytest.mark.parametrize(
    ('name', 'slower', 'deviation'),
    one_in(
        2,
        [('around_pillar_11_points', 1.1, 0.01), ('pick_and_place_20ms', 1.2, 0.02)],
        several=True,
    ),
)
@pytest.mark.invariant(2)
def test_inv2_plan_is_executed_smoothly_within_limits(name, slower, deviation):
    """No interior stop, in little more than the planned time."""
    planned = plan(name)
    harness = OurProgramHarness(planned.positions[0])
    client = harness.ready()
    start = len(harness.positions)
    client.execute(smoothed_by_the_driver(planned))
    harness.rest()
    positions = np.array(harness.positions[start:])
    times = np.arange(len(positions)) * STEP_S
    run = Recording(times, positions, np.gradient(positions, times, axis=0))
    figures = measure(planned, run)
    assert figures.stops <= figures.commanded_stops
    assert figures.moved < slower * planned.duration
    assert figures.waypoint_deviation < deviation
    assert figures.end_deviation < 1e-6
    harness.assert_within_limits()


@pytest.mark.invariant(8)
def test_inv8_state_is_the_encoder_position():
    """JOINT_POSITION contains whole encoder pulses, converted to binary32."""
    harness = OurProgramHarness()
    client, state = harness.ready(), harness.connect('state')
    client.execute(slow_trajectory([0.7, -0.3, 0.4, 0.2, 0.6, -0.9], 3.0, 11))
    harness.rest()
    harness.step(0.6)
    shown = np.array(newest(state, JointPosition).joints[:6])
    pulses = np.rint(harness.controller.servo.position * MODEL.pulses_per_unit)
    assert np.abs(shown - pulses / MODEL.pulses_per_unit).max() < 1e-7


@pytest.mark.invariant(3)
def test_inv3_stop_brakes_within_limits():
    harness, client = moving()
    client.raw()
    client.send_bytes(point(STOP))
    harness.until(lambda: (STOP, SUCCESS) in client.replies(), 0.1)
    start = len(harness.positions)
    harness.until(lambda: not harness.controller.in_motion, 1.0)
    assert (len(harness.positions) - start) * STEP_S < 0.5
    assert_still(harness)
    harness.assert_within_limits()
    assert_moves(harness, client)


@pytest.mark.invariant(4)
def test_inv4_reboot_restarts_the_program():
    """Also at times affected by rounding, because the tasks' time starts at the boot."""
    harness, _ = moving()
    harness.controller.reboot(0.3)
    assert_still(harness)
    assert not harness.controller.condition.powered
    for seconds in (0.1, 0.37):
        harness.controller.step(seconds / 3.0)
        harness.controller.reboot(seconds)
        harness.step(1.0)
    client, state = harness.ready(), harness.connect('state')
    assert_still(harness)
    assert newest(state, Status).motion_possible == 1
    assert_moves(harness, client)


def test_shipped_program_moves_at_low_power_and_logs_it(caplog):
    caplog.set_level(logging.INFO)
    harness = OurProgramHarness(caplog=caplog, FULL_POWER='')
    client = harness.ready()
    start = harness.now
    client.execute(slow_trajectory([1.0, *HOME[1:]], 0.5, 3))
    harness.rest()
    assert harness.now - start > 2.0
    velocity, _ = harness.within_limits()
    assert velocity <= 0.0501
    assert harness.printed == ['Low power, slower than planned: FULL_POWER is off in config.inc']


def test_config_gets_the_speeds_of_the_robot():
    files = profile_project(PROFILE, load_robot_model('c8_c901s'))
    assert '#define J1_SPEED 294' in files['config.inc']
    assert '#define FULL_POWER 1' in files['config.inc']


def test_program_gets_the_client_timeout_of_the_profile():
    server = replace(PROFILE.server, client_timeout=2.0)
    files = profile_project(replace(PROFILE, server=server), MODEL)
    assert '#define CLIENT_TIMEOUT 2\n' in files['config.inc']


def test_robot_with_seven_joints_is_refused(tmp_path):
    with pytest.raises(InputError, match='has 7 joints: the project is for six axes, or a SCARA'):
        profile_project(PROFILE, arm_model(tmp_path, 7))


def test_scara_moves_and_reports_its_joints():
    """Joint 3 is in metres on the wire, in mm in the program."""
    model = load_robot_model('gx4_c251s')
    files = profile_project(PROFILE, model)
    assert '#define JOINT_COUNT 4' in files['config.inc']
    harness = OurProgramHarness(start=[0.1, 0.2, -0.05, 0.3], model=model)
    client, state = harness.ready(), harness.connect('state')
    assert client.stream(point(0, (0.3, -0.4, -0.1, 1.0), 0.0, 1.0)) == [(0, SUCCESS)]
    harness.rest()
    assert harness.position == pytest.approx([0.3, -0.4, -0.1, 1.0], abs=1e-5)
    assert newest(state, JointPosition).joints == pytest.approx(
        [0.3, -0.4, -0.1, 1.0, *[0.0] * 6], abs=1e-5
    )
    assert client.stream(point(0, (0.3, -0.4, 0.02, 1.0), 0.0, 1.0)) == [(0, FAILURE)]


@pytest.mark.parametrize(
    ('arguments', 'words'),
    one_in(
        4,
        [
            (
                ['--motion', 'ptp'],
                '--motion cannot be set for a SPEL+ program, which determines its motion itself',
            ),
            (['--define', 'FULL_POWER'], 'must be NAME=VALUE'),
            (['--define', 'FULLPOWER=1'], "no file of the project has a line #define 'FULLPOWER'"),
            (
                ['--state-period', '0.01'],
                'a SPEL+ program, which determines itself when it sends states',
            ),
        ],
        several=True,
    ),
)
def test_arguments_invalid_for_a_program_are_refused(arguments, words):
    process = subprocess.run(
        [*COMMAND, '--controller=spel', *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert process.returncode == 2
    assert words in process.stderr
