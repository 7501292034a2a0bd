# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""lerobot with simulated arms: its commands, and malicious actions.

pytest -m '' variants/lerobot_robot_epson, where lerobot and this package are installed. Rates and
delays depend on the machine and are only printed. test/api/test_lerobot_arm.py checks them in
virtual time.
"""

import math
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('lerobot', reason='lerobot is not installed, see README.md')

import pandas as pd
from lerobot_robot_epson import EpsonRobot, EpsonRobotConfig

from epson_driver.error_texts import load_error_texts
from epson_driver.report.trace_run import read_trace

pytestmark = pytest.mark.slow

PERIOD_S = 1 / 30
ROUNDING = 1e-6
MOVING = 0.01
AMPLITUDE, MOVED, NEAR = 0.4, 0.05, 0.03
README = Path(__file__).parents[1] / 'README.md'


def commands():
    """Return the README's session, command by command."""
    session = README.read_text(encoding='utf-8').split('## A session')[1]
    block = re.search(r'```sh\n(.*?)```', session, re.DOTALL)[1].replace('\\\n', '')
    return dict(line.split(' ', 1) for line in block.splitlines())


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('session')


def run(name, folder, *more):
    words = shlex.split(commands()[name])
    here = Path(sys.executable).parent / name
    done = subprocess.run(
        [here, *words, *more], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_teleoperation_moves_joint_1(folder):
    run('lerobot-teleoperate', folder, '--robot.trace_file=led.pcap', '--teleop_time_s=5')
    _, joints = measured(folder / 'led.pcap')
    print(f'led to {joints[:, 0].max():.4f} rad')
    assert MOVED < joints[:, 0].max() < AMPLITUDE + NEAR
    assert np.ptp(joints[:, 1:], axis=0).max() < NEAR


def test_example_policy_runs():
    example = Path(__file__).parents[3] / 'examples' / 'lerobot_policy.py'
    run = subprocess.run([sys.executable, example], capture_output=True, text=True, check=True)
    assert run.stdout.endswith('done\n')


def test_recorded_motion_is_replayed(folder):
    run('lerobot-record', folder)
    tables = sorted((folder / 'wave' / 'data').rglob('*.parquet'))
    frames = pd.concat(pd.read_parquet(table) for table in tables)
    actions, seen = np.stack(frames['action']), np.stack(frames['observation.state'])
    print(f'{len(frames)} frames in 8 s')
    assert MOVED < actions[:, 0].max() < AMPLITUDE + NEAR
    run('lerobot-replay', folder, '--robot.trace_file=replay.pcap')
    _, joints = measured(folder / 'replay.pcap')
    went, should = np.ptp(joints, axis=0), np.ptp(seen, axis=0)
    print(f'replayed: peak to peak {went[0]:.4f} rad, recorded {should[0]:.4f} rad')
    assert went[0] > MOVED
    assert (joints > actions.min(axis=0) - NEAR).all()
    assert (joints < actions.max(axis=0) + NEAR).all()
    print(f'end: {np.abs(joints[-1] - actions[-1]).max():.4f} rad from the last action')


def measured(trace):
    """Return times, s, and joints of a trace, from the wire."""
    limits = EpsonRobot(EpsonRobotConfig()).limits
    run = read_trace(trace, limits, load_error_texts('epson'))
    return run.times, run.positions


@pytest.fixture(scope='module')
def connected():
    with EpsonRobot(EpsonRobotConfig()) as robot:
        yield robot


@pytest.fixture
def robot(connected):
    connected.arm.enable()
    return connected


FAR = np.array([3.0, -3.0, 3.0, -3.0, 2.0, 6.0])

HOSTILE = {
    'jumps of 3 rad': lambda step: FAR,
    'forth and back': lambda step: FAR * (-1) ** step,
    'random': lambda step: np.random.default_rng(step).uniform(-7, 7, 6),
    'huge values': lambda step: np.full(6, 1e300),
}


def sent(robot, policy, steps):
    """Send actions at 30 Hz. Return the time of day of the last action, s."""
    start = time.monotonic()
    for step in range(steps):
        last = time.time()
        robot.send_action(dict(zip(robot.action_features, policy(step), strict=True)))
        time.sleep(max(start + (step + 1) * PERIOD_S - time.monotonic(), 0.0))
    return last


def checked(robot, samples, last):
    """Check samples against the limits. Return the highest speed fraction and the time to rest."""
    limits = robot.limits
    positions = np.array([sample.positions for sample in samples])
    assert (positions >= limits.position_min - ROUNDING).all()
    assert (positions <= limits.position_max + ROUNDING).all()
    speeds = np.abs([sample.velocities for sample in samples])
    moving = [
        sample.time for sample, speed in zip(samples, speeds, strict=True) if speed.max() > MOVING
    ]
    return float((speeds / limits.velocity).max()), max(moving, default=last) - last


@pytest.mark.parametrize('name', HOSTILE)
def test_malicious_actions_respect_the_limits(robot, name):
    samples = []
    forget = robot.arm.on_joints(samples.append)
    last = sent(robot, HOSTILE[name], 60)
    time.sleep(1.5)
    forget()
    fastest, rest = checked(robot, samples, last)
    print(f'{name}: {fastest:.3f} of the velocity limits, at rest after {rest:.3f} s')
    assert 0.0 < fastest < 0.25


def test_late_chunks_respect_the_limits(robot):
    samples = []
    forget = robot.arm.on_joints(samples.append)
    start = robot.arm.joints
    for chunk in range(4):
        last = sent(robot, lambda step, chunk=chunk: start + 0.2 * chunk + 0.02 * step, 10)
        time.sleep(0.4)
    time.sleep(1.0)
    forget()
    fastest, rest = checked(robot, samples, last)
    print(f'late chunks: {fastest:.3f} of the velocity limits, at rest {rest:.3f} s')
    assert fastest < 0.25


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_non_finite_action_is_refused_without_motion(robot, value):
    here = robot.arm.joints
    with pytest.raises(
        ValueError, match=r'joint_3\.pos = -?(inf|nan): an action has all joints, finite'
    ):
        robot.send_action({**robot.get_observation(), 'joint_3.pos': value})
    with pytest.raises(ValueError, match=r'joint_2\.pos = None: an action has all joints'):
        robot.send_action({'joint_1.pos': 0.1})
    time.sleep(0.3)
    assert robot.arm.joints == pytest.approx(here, abs=1e-4)


def test_estop_ends_the_stream_with_a_reason(robot):
    robot.arm.simulation.estop()
    robot.arm.wait_until(lambda sample: sample.status.e_stopped, timeout=10.0)
    with pytest.raises(RuntimeError, match='E-stop'):
        sent(robot, lambda step: np.full(6, 0.1), 60)
