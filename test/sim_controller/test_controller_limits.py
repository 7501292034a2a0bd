# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever is sent and whenever it is stopped: the arm stays within every limit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.controller_harness import LIMITS, STOP, Harness, InlinePlanner, point
from support.examples import examples

from epson_driver.sim_controller.condition.states import Motors, RejectedError
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


def assert_within_limits(samples, dt=DT, slack=SLACK):
    """Divided differences are means of the derivatives, so no limit allows them to be larger."""
    path = np.array(samples)
    assert np.all(path >= LIMITS.position_min)
    assert np.all(path <= LIMITS.position_max)
    for order, limit in enumerate((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1):
        differences = np.abs(np.diff(path, order, axis=0)) / dt**order
        assert np.all(differences <= limit * (1.0 + slack)), f'derivative {order}'


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
def test_invariant_2_and_3_every_stop_keeps_every_limit(
    start, targets, velocity, offset, steps, stop
):
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
    assert_within_limits(samples)
    if stop != 'nothing':
        assert not harness.controller.in_motion


ACTIONS = st.one_of(
    st.tuples(st.just('point'), st.integers(-5, 6), fractions, st.floats(-0.125, 1.125, width=32)),
    st.tuples(st.just('next'), fractions),
    st.tuples(st.just('step'), st.floats(0.0, 0.3)),
    st.tuples(
        st.sampled_from(['motors on', 'motors off', 'E-stop press', 'E-stop release', 'reset'])
    ),
    st.tuples(st.just('reconnect')),
    st.tuples(st.just('garbage'), st.binary(min_size=1, max_size=80)),
)


@pytest.mark.invariant(1, 2, 3, 4, 7)
@settings(max_examples=examples(200))
@given(st.lists(ACTIONS, max_size=40))
def test_invariants_1_to_4_and_7_hold_through_any_sequence_of_actions(actions):
    assert_invariants(Harness(), actions)


@pytest.mark.invariant(1, 2, 3, 4, 7)
@settings(max_examples=examples(60))
@given(st.lists(ACTIONS, max_size=40))
def test_invariants_1_to_4_and_7_hold_in_smooth_motion_too(actions):
    assert_invariants(Harness(planner=InlinePlanner()), actions)


def assert_invariants(harness, actions):
    controller = harness.controller
    sequence = 0
    asked = False
    for action, *arguments in actions:
        before, was_moving = harness.joints, controller.in_motion
        try:
            if action == 'step':
                controller.step(*arguments)
            elif action == 'reconnect':
                harness.disconnect()
                harness.connect()
            elif action == 'garbage':
                harness.send(*arguments)
            elif action == 'point':
                number, parts, velocity = arguments
                harness.send(point(number, angles(parts), velocity))
            elif action == 'next':
                harness.send(point(sequence, angles(arguments[0])))
            else:
                harness.do(action)
        except RejectedError as rejection:
            assert len(str(rejection)) > 20  # noqa: PT017  the sentence
        except FrameError:
            harness.connect()
        status = controller.status()
        assert status.in_motion == controller.in_motion
        assert status.in_error == (status.error_code != 0)
        assert status.e_stopped == (status.error_code == 2261)
        if action != 'step':
            asked = action in ('point', 'next')
        if (
            not was_moving
        ):  # only an accepted point begins a motion, at once or when its time comes
            assert harness.joints.tolist() == before.tolist() or asked
            assert not controller.in_motion or (asked and controller.condition.motors is Motors.ON)
        assert np.all(harness.joints >= LIMITS.position_min)
        assert np.all(harness.joints <= LIMITS.position_max)
        sequence = sequence + 1 if action == 'next' else 0
    if controller.condition.motors is not Motors.ON:
        assert harness.rest() < 1.0


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('stop', sorted(STOPS))
@pytest.mark.parametrize('seed', range(2))
def test_invariant_2_and_3_every_stop_of_smooth_motion_keeps_every_limit(stop, seed):
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
    assert_within_limits(samples, 0.004, slack=1e-3)
    if stop == 'nothing':
        np.testing.assert_allclose(harness.joints, angles(targets[-1]), atol=1e-6)


@pytest.mark.invariant(7)
@settings(max_examples=examples(300))
@given(st.lists(st.binary(max_size=200), max_size=5))
def test_invariant_7_any_bytes_no_crash_no_motion(chunks):
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
def test_invariant_7_a_point_with_wrong_bytes_never_leaves_the_limits(changes, cut):
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
