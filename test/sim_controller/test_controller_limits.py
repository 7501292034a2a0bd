# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The limits of the simulated controller, with six joints and with seven."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.controller_harness import (
    LIMITS,
    PROFILE,
    STOP,
    Harness,
    InlinePlanner,
    Remote,
    assert_within_limits,
    point,
)
from support.examples import examples, one_in
from support.longer_arm import arm_model

from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import Motors, RejectedError
from epson_driver.sim_controller.faults.fault_kinds import FaultError, parse
from epson_driver.simple_message import FrameError

DT = 0.001
SLACK = 1e-5  # of each limit, for the rounding of third differences

fractions = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)
STOPS = {
    'STOP': lambda harness: harness.send(point(STOP)),
    'wrong sequence': lambda harness: harness.send(point(77)),
    'motors off': lambda harness: harness.do('motors off'),
    'client lost': lambda harness: harness.disconnect(),
    'E-stop': lambda harness: harness.do('E-stop press'),
    'nothing': lambda harness: None,
}


def angles(parts):
    return LIMITS.position_min + np.array(parts) * (LIMITS.position_max - LIMITS.position_min)


@pytest.mark.invariant(2, 3)
@settings(max_examples=examples(300))
@given(
    start=fractions,
    targets=st.lists(fractions, min_size=1, max_size=3),
    velocity=st.sampled_from([0.0, 0.05, 1.0]),
    offset=st.floats(0.0, DT),
    steps=st.integers(0, 900),
    stop=st.sampled_from(sorted(STOPS)),
)
def test_inv2_and_3_every_stop_respects_every_limit(start, targets, velocity, offset, steps, stop):
    harness = Harness(start=angles(start))
    harness.send(*(point(i, angles(target), velocity) for i, target in enumerate(targets)))
    harness.controller.step(offset)
    samples = [harness.joints]
    for _ in range(steps):
        harness.controller.step(DT)
        samples.append(harness.joints)
    STOPS[stop](harness)
    while harness.controller.in_motion and len(samples) < 1500:
        harness.controller.step(DT)
        samples.append(harness.joints)
    assert_within_limits(samples, DT, SLACK)
    if stop != 'nothing':
        assert not harness.controller.in_motion


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('stop', sorted(STOPS))
@pytest.mark.parametrize('seed', one_in(2, range(2)))
def test_inv2_and_3_every_stop_of_smooth_motion_respects_every_limit(stop, seed):
    random = np.random.default_rng(seed)
    start, *targets = random.uniform(0.25, 0.75, (6, 6))
    duration, delay = random.choice([0.0, 0.05, 0.5]), random.choice([0.0, 0.02, 0.1])
    harness = Harness(start=angles(start), planner=InlinePlanner(delay))
    for index, target in enumerate(targets):
        harness.send(point(index, angles(target), 0.0, duration))
    samples = [harness.joints]
    for _ in range(random.integers(20, 200)):
        harness.step(0.004)
        samples.append(harness.joints)
    STOPS[stop](harness)
    samples.extend(harness.run()[1:])
    assert_within_limits(samples)
    if stop == 'nothing':
        np.testing.assert_allclose(harness.joints, angles(targets[-1]), atol=1e-6)


@pytest.mark.invariant(7)
@settings(max_examples=examples(300))
@given(st.lists(st.binary(max_size=200), max_size=5))
def test_inv7_arm_does_not_move_for_random_bytes(chunks):
    harness = Harness()
    try:
        harness.send(*chunks)
    except FrameError:
        assert harness.condition.motors is Motors.OFF
    assert not harness.controller.in_motion
    assert harness.joints.tolist() == [0.0] * 6


@pytest.mark.invariant(7)
@settings(max_examples=examples(300))
@given(
    st.lists(st.tuples(st.integers(0, 67), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(0, 67),
)
def test_inv7_corrupted_point_stays_within_the_limits(changes, cut):
    harness = Harness()
    data = bytearray(point(0, (0.5, 0.5, 0.5), 0.1, 1.0))
    for index, value in changes:
        data[index] = value
    try:
        harness.send(bytes(data[:cut]), bytes(data[cut:]))
    except FrameError:
        return
    for _ in range(50):
        harness.controller.step(0.02)
        assert np.all(harness.joints >= LIMITS.position_min)
        assert np.all(harness.joints <= LIMITS.position_max)


@settings(max_examples=examples(50))
@given(st.lists(st.integers(-4, 12), max_size=60), st.floats(0.0, 0.05))
def test_every_request_is_answered_once_and_in_order(sequences, pause):
    harness = Harness()
    for index, sequence in enumerate(sequences):
        harness.send(point(sequence, (0.01 * index,)))
        harness.controller.step(pause)
    harness.step(1.0)  # the dead time of downloads
    harness.rest()
    assert [sequence for sequence, _ in harness.codes()] == sequences


GOAL = (0.1, -0.2, 0.3, -0.1, 0.2, -0.3, 0.5)


@pytest.fixture
def model(tmp_path):
    return arm_model(tmp_path, 7)


@pytest.mark.parametrize('smooth', [False, True])
def test_seven_joints_reach_a_point_within_their_limits(model, smooth):
    harness = Harness(model=model, planner=InlinePlanner() if smooth else None)
    harness.send(point(0, GOAL))
    trace = harness.run(dt=0.001)
    assert harness.joints == pytest.approx(GOAL, abs=1e-6)
    assert trace.shape[1] == 7
    assert np.all(np.abs(np.diff(trace, axis=0)) <= model.limits.velocity * 0.001 * 1.001)
    message = harness.controller.joint_position()
    assert message.joints[7:] == (0.0, 0.0, 0.0)
    harness.send(point(1, (*GOAL[:6], 7.0)))
    assert [reply.reply_code for reply in harness.replies()][-1] == 2
    assert harness.error == 4001


def test_remote_commands_know_the_seventh_joint(model):
    remote = Remote(Harness(model=model, motors=False))
    assert remote('Sim,print,Agl(7)') == '#Sim,0'
    assert remote('Sim,print,Agl(8)') == '!Sim,99'
    assert remote('Execute,"HomeSet 0,0,0,0,0,0,100"') == '#Execute,0'
    assert remote('Execute,"HomeSet 0,0,0,0,0,0"') == '!Execute,99'
    assert remote('Sim,disturb,7,3.0') == '#Sim,0'
    assert remote('Sim,print,Agl(7)') == '#Sim,3'


def test_faults_reach_the_seventh_joint_and_no_other(model):
    harness = Harness(model=model)
    harness.controller.faults.start(parse('servo_error 7'))
    assert harness.error == 5042
    with pytest.raises(FaultError, match='the robot has 7 joints'):
        harness.controller.faults.start(parse('servo_error 8'))


def test_ten_joints_are_served_and_more_than_a_message_carries_are_refused(tmp_path):
    assert len(Harness(model=arm_model(tmp_path, 10)).joints) == 10
    with pytest.raises(ValueError, match='joints: 11 joints: a message carries at most 10'):
        new_controller(arm_model(tmp_path, 11), PROFILE)


MODEL = load_robot_model('gx4_c251s')

START = np.array([0.5, -0.25, -0.05, 1.0])


@pytest.fixture
def remote() -> Remote:
    controller = new_controller(MODEL, load_controller_profile('simulated'), START)
    return Remote(SimpleNamespace(controller=controller))


def test_agl_and_pls_of_a_linear_joint_use_mm(remote: Remote) -> None:
    assert remote('Sim,print,Agl(1),Agl(3)') == '#Sim,28.64789 -50'
    # 131072 pulses in 11.52 mm
    assert remote('Sim,print,Pls(3)') == f'#Sim,{round(-50.0 * 131072 / 11.52)}'


def test_homeset_beyond_the_stroke_is_refused(remote: Remote) -> None:
    assert remote('Execute,"HomeSet 0,0,-1706666,0"') == '#Execute,0'
    assert remote('Execute,"HomeSet 0,0,-1706669,0"') == '!Execute,99'
    assert 'HomeSet: joint_3' in remote('Sim,why')


def test_push_of_a_linear_joint_is_in_mm(remote: Remote) -> None:
    assert remote('Sim,disturb,3,-10') == '#Sim,0'
    assert remote.controller.joint_position().joints[2] == pytest.approx(-0.06, abs=1e-7)
    with pytest.raises(
        RejectedError, match=r'joint_3 = 0\.04 m is outside the limits -0\.15 … 0 m'
    ):
        remote.controller.disturb(2, 0.1)
