# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever is sent and whenever it is stopped: the arm stays within every limit."""

import numpy as np
import pytest
from controller_bench import LIMITS, STOP, Bench, InlinePlanner, point
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.controller.states import Motors, RefusedError
from epson_driver.simple_message import FrameError

DT = 0.001
SLACK = 1e-5  # of each limit, for the rounding of third differences

fractions = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)
STOPS = {
    'STOP': lambda bench: bench.send(point(STOP)),
    'wrong sequence': lambda bench: bench.send(point(77)),
    'motors off': lambda bench: bench.do('motors off'),
    'client lost': lambda bench: bench.disconnect(),
    'E-stop': lambda bench: bench.do('E-stop press'),
    'nothing': lambda bench: None,
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
    bench = Bench(start=angles(start))
    bench.send(*(point(i, angles(target), velocity) for i, target in enumerate(targets)))
    bench.controller.step(offset)
    samples = [bench.joints]
    for _ in range(steps):
        bench.controller.step(DT)
        samples.append(bench.joints)
    STOPS[stop](bench)
    while bench.controller.in_motion and len(samples) < 1500:
        bench.controller.step(DT)
        samples.append(bench.joints)
    assert_within_limits(samples)
    if stop != 'nothing':
        assert not bench.controller.in_motion


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
    assert_invariants(Bench(), actions)


@pytest.mark.invariant(1, 2, 3, 4, 7)
@settings(max_examples=examples(60))
@given(st.lists(ACTIONS, max_size=40))
def test_invariants_1_to_4_and_7_hold_in_smooth_motion_too(actions):
    assert_invariants(Bench(planner=InlinePlanner()), actions)


def assert_invariants(bench, actions):
    controller = bench.controller
    sequence = 0
    for action, *arguments in actions:
        before, was_moving = bench.joints, controller.in_motion
        try:
            if action == 'step':
                controller.step(*arguments)
            elif action == 'reconnect':
                bench.disconnect()
                bench.connect()
            elif action == 'garbage':
                bench.send(*arguments)
            elif action == 'point':
                number, parts, velocity = arguments
                bench.send(point(number, angles(parts), velocity))
            elif action == 'next':
                bench.send(point(sequence, angles(arguments[0])))
            else:
                bench.do(action)
        except RefusedError as refusal:
            assert len(str(refusal)) > 20  # noqa: PT017  the sentence
        except FrameError:
            bench.connect()
        status = controller.status()
        assert status.in_motion == controller.in_motion
        assert status.in_error == (status.error_code != 0)
        assert status.e_stopped == (status.error_code == 2261)
        if not was_moving:  # only an accepted point begins a motion
            assert bench.joints.tolist() == before.tolist() or action in ('point', 'next')
            assert not controller.in_motion or (
                action in ('point', 'next') and controller.condition.motors is Motors.ON
            )
        assert np.all(bench.joints >= LIMITS.position_min)
        assert np.all(bench.joints <= LIMITS.position_max)
        sequence = sequence + 1 if action == 'next' else 0
    if controller.condition.motors is not Motors.ON:
        assert bench.rest() < 1.0


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('stop', sorted(STOPS))
@pytest.mark.parametrize('seed', range(2))
def test_invariant_2_and_3_every_stop_of_smooth_motion_keeps_every_limit(stop, seed):
    random = np.random.default_rng(seed)
    start, *targets = random.uniform(0.25, 0.75, (6, 6))
    duration, delay = random.choice([0.0, 0.05, 0.5]), random.choice([0.0, 0.02, 0.1])
    bench = Bench(start=angles(start), planner=InlinePlanner(delay))
    for index, target in enumerate(targets):
        bench.send(point(index, angles(target), 0.0, duration))
    samples = [bench.joints]
    for _ in range(random.integers(20, 200)):
        bench.step(0.004)
        samples.append(bench.joints)
    STOPS[stop](bench)
    samples.extend(bench.run()[1:])
    assert_within_limits(samples, 0.004, slack=1e-3)
    if stop == 'nothing':
        np.testing.assert_allclose(bench.joints, angles(targets[-1]), atol=1e-6)


@pytest.mark.invariant(7)
@settings(max_examples=examples(300))
@given(st.lists(st.binary(max_size=200), max_size=5))
def test_invariant_7_any_bytes_no_crash_no_motion(chunks):
    bench = Bench()
    try:
        bench.send(*chunks)
    except FrameError:
        assert bench.condition.motors is Motors.OFF
    assert not bench.controller.in_motion
    assert bench.joints.tolist() == [0.0] * 6


@pytest.mark.invariant(7)
@settings(max_examples=examples(300))
@given(
    st.lists(st.tuples(st.integers(0, 67), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(0, 67),
)
def test_invariant_7_a_point_with_wrong_bytes_never_leaves_the_limits(changes, cut):
    bench = Bench()
    data = bytearray(point(0, (0.5, 0.5, 0.5), 0.1, 1.0))
    for index, value in changes:
        data[index] = value
    try:
        bench.send(bytes(data[:cut]), bytes(data[cut:]))
    except FrameError:
        return
    for _ in range(50):
        bench.controller.step(0.02)
        assert np.all(bench.joints >= LIMITS.position_min)
        assert np.all(bench.joints <= LIMITS.position_max)


@settings(max_examples=examples(50))
@given(st.lists(st.integers(-4, 12), max_size=60), st.floats(0.0, 0.05))
def test_every_request_is_answered_once_and_in_order(sequences, pause):
    bench = Bench()
    for index, sequence in enumerate(sequences):
        bench.send(point(sequence, (0.01 * index,)))
        bench.controller.step(pause)
    bench.step(1.0)  # the dead time of downloads
    bench.rest()
    assert [sequence for sequence, _ in bench.codes()] == sequences
