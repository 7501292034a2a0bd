# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Velocities and ages of joints over networks with delay, bursts and stalls (invariants 6, 8).

The controller sends by its clock, ten joints and then a STATUS. `PATHS` maps send to arrival times
on a manual clock. A velocity is a mean over a window, so it must be between the slowest and the
fastest true velocity in the window, within 2 % of the motion's maximum.
"""

import itertools
import math
import random

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.plausibility import Margins
from epson_driver.driver.state.robot_state import RobotState, StateRules
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import Status, joint_data

pytestmark = pytest.mark.invariant(6, 8)

LIMITS = load_robot_model('c3_a601s').limits
BEGIN = 1000.0
RATES = {'nominal': 200.0, '182 joints/s': 182.0 * 11 / 10, '179 joints/s': 179.0 * 11 / 10}


def sine(t):
    return math.sin(math.pi * t)


def there_and_back(t):
    """Return a trapezoid with 2 rad/s, 10 rad/s² and 0.5 s of rest, back and forth every 2.5 s."""
    back, t = divmod(t, 2.5)
    t = min(t, 2.0)
    distance = 5 * t * t if t < 0.2 else 2 * t - 0.2
    distance = 3.6 - 5 * (2.0 - t) ** 2 if t > 1.8 else distance
    return distance / 2 if back % 2 == 0 else (3.6 - distance) / 2


MOTIONS = {'sine': sine, 'there and back': there_and_back}


def bursts(gathered):
    return lambda t: math.floor(t / gathered + 1.0) * gathered


def late_by(chance, longest):
    return lambda t: t + chance.uniform(0.0, longest)


def stall(start, end):
    """Return the arrival times with a reader that stalls from `start` to `end`."""
    return lambda t: end if start < t < end else t


PATHS = {
    'regular': lambda t: t,
    'jitter of 2 ms': late_by(random.Random(1), 0.002),
    'jitter of 15 ms': late_by(random.Random(2), 0.015),
    'bursts of 50 ms': bursts(0.05),
    'bursts of 100 ms': bursts(0.1),
    'bursts of 200 ms': bursts(0.2),
    'bursts of 0.5 s': bursts(0.5),
    'read late by 0.3 s': stall(2.0, 2.3),
    'read late by 3 s': stall(1.5, 4.5),
    '50 ms more delay for 2 s': lambda t: t + (0.05 if 2.0 < t < 4.0 else 0.0),
}


def received(motion, path, *, rate=200.0, seconds=6.0, pauses=(), profile=0.005, state=None):
    """Return the state and a row for each sample: sent, arrival, velocity, measured (s, rad/s).

    pauses: (time, duration) in which the controller sends nothing, s. Times start at 0.
    """
    state = state or RobotState(1, rules=StateRules(profile))
    rows, arrival, sent = [], 0.0, 0.0
    pauses = list(pauses)
    for slot in range(round(seconds * rate)):
        sent += 1.0 / rate
        if pauses and sent >= pauses[0][0]:
            sent += pauses.pop(0)[1]
        arrival = max(arrival, path(sent))
        if slot % 11 == 10:
            state.on_status(Status(), BEGIN + arrival)
            continue
        sample = state.on_joints(joint_data([float(np.float32(motion(sent)))]), BEGIN + arrival)
        if sample is not None:
            rows.append((sent, arrival, sample.velocities[0], sample.measured - BEGIN))
    return np.array(rows), state


def errors(rows, motion, window=VELOCITY_WINDOW_S):
    """Return the distance of each velocity to the range of true ones in its window, rad/s."""
    result = []
    for sent, _, velocity, _ in rows:
        times = np.linspace(sent - window - 0.001, sent, 60)
        true = np.diff([motion(time) for time in times]) / np.diff(times)
        result.append(max(true.min() - velocity, velocity - true.max(), 0.0))
    return np.array(result)


@pytest.mark.parametrize('rate', RATES.values(), ids=RATES)
@pytest.mark.parametrize('path', one_in(4, PATHS.values()), ids=PATHS)
@pytest.mark.parametrize('motion', MOTIONS.values(), ids=MOTIONS)
def test_inv8_velocities_match_the_motion_over_any_network(motion, path, rate):
    """This includes the first second, in which the period is the profile's."""
    rows, _ = received(motion, path, rate=rate)
    fastest = math.pi if motion is sine else 1.0
    assert errors(rows, motion).max() < 0.02 * fastest


@pytest.mark.parametrize('path', PATHS.values(), ids=PATHS)
def test_inv8_every_sample_of_a_motion_has_its_velocity(path):
    """No velocity is 0 for lack of data, not even the first one."""
    rows, _ = received(lambda t: 0.3 * t, path)
    assert rows[:, 2] == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize('path', PATHS.values(), ids=PATHS)
def test_inv6_age_of_a_sample_is_known_to_two_periods(path):
    """A delayed sample does not count as fresh."""
    rows, _ = received(sine, path, rate=RATES['182 joints/s'])
    sent, arrival, _, measured = rows[rows[:, 0] > 1.5].T
    assert np.all(measured <= arrival + 1e-9)
    assert np.all(np.diff(measured) >= 0.0)
    slack = 0.051 if path(3.0) == 3.05 else 0.0  # a longer delay cannot be detected
    least = min(path(t) - t for t in np.linspace(1.0, 2.0, 5000))
    assert np.all(np.abs(measured - sent - least) < 0.012 + slack)


def test_inv6_sample_delayed_by_three_seconds_is_three_seconds_old():
    rows, _ = received(sine, stall(1.5, 4.5))
    first_read = rows[np.argmax(rows[:, 1] == 4.5)]
    assert first_read[1] - first_read[3] == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize('length', [0.02, 0.05, 0.3])
@pytest.mark.parametrize('path', ['regular', 'bursts of 100 ms'])
def test_clock_recovers_after_a_pause_of_the_controller(path, length):
    """The velocity across the pause is the mean over it."""
    pause = (2.0, length)
    rows, state = received(there_and_back, PATHS[path], pauses=[pause])
    after = rows[:, 0] > 2.0 + length + 0.5
    assert errors(rows[after], there_and_back).max() < 0.02
    around = (rows[:, 0] >= 2.0) & ~after
    assert np.abs(rows[around, 2]).max() < 1.05
    age = rows[:, 1] - rows[:, 3]
    assert age[-1] < 0.11
    assert state._clock.period == pytest.approx(0.005, rel=0.01)


@pytest.mark.parametrize('period', [0.0025, 0.007, 0.012, 0.02, 0.1, 1.0])
@pytest.mark.parametrize('profile', [0.005, 0.02])
def test_actual_period_is_estimated(profile, period):
    rows, _ = received(
        lambda t: 0.2 * t,
        PATHS['regular'],
        rate=1 / period,
        seconds=120 * period + 2,
        profile=profile,
    )
    late = rows[30:] if period >= 0.1 else rows[rows[:, 0] > 1.0]
    assert late[:, 2] == pytest.approx(0.2, rel=0.02)


def test_status_in_the_same_slot_as_joints_does_not_distort_velocities():
    """Some controllers have no separate slot for the STATUS."""
    state = RobotState(1)
    samples = []
    for count in range(400):
        samples.append(state.on_joints(joint_data([0.4 * count * 0.02]), BEGIN + count * 0.02))
        state.on_status(Status(), BEGIN + count * 0.02)
    for sample in samples[100:]:
        assert sample.velocities[0] == pytest.approx(0.4, rel=0.02)
        assert sample.time - sample.measured < 0.021


def test_inv8_velocity_is_bounded_by_the_joint_limit():
    """Implausible velocities are bounded and counted."""
    limits = LIMITS
    state = RobotState(6, rules=StateRules(0.005, limits, Margins(velocity=1.5)))
    bound = 1.5 * limits.velocity[0]
    arrival = BEGIN
    for count in range(100):
        arrival += 0.2 if count % 20 == 0 else 0.0
        # a controller that is slower than its profile, read in bursts
        sample = state.on_joints(joint_data([-2.0 + 0.04 * count]), arrival)
        assert sample is None or abs(sample.velocities[0]) <= bound
    assert state.bounded == 0
    for count in range(20):
        state.on_joints(joint_data([2.0 - 0.2 * count]), arrival + 0.2)
        assert abs(state.sample.velocities[0]) <= bound
    assert state.bounded > 0
    assert state.why_not_at_rest(0.01) is not None


def test_controller_time_stamps_are_used():
    """JOINT_FEEDBACK has positions and times, here with an irregular period."""
    state, chance, t = RobotState(1), random.Random(3), 0.0
    for _ in range(300):
        t += chance.uniform(0.002, 0.014)
        sample = state.on_joints(joint_data([0.7 * t]), BEGIN + bursts(0.1)(t), None, t)
        if sample is not None:
            assert sample.velocities[0] == pytest.approx(0.7, rel=1e-6)


@pytest.mark.parametrize('unit', [1e3, 1e-3, 0.0, -1.0, math.nan])
def test_implausible_controller_time_is_ignored(unit):
    state = RobotState(1)
    for count in range(300):
        t = count * 0.005
        sample = state.on_joints(joint_data([0.7 * t]), BEGIN + t, None, t * unit)
        if sample is not None:
            assert sample.velocities[0] == pytest.approx(0.7, rel=1e-6)


def test_too_coarse_controller_time_is_ignored():
    """A float32 has seven digits, which is too coarse after a day."""
    state = RobotState(1)
    for count in range(300):
        t = count * 0.005
        stamp = float(np.float32(86400.0 + t))
        sample = state.on_joints(joint_data([0.7 * t]), BEGIN + t, None, stamp)
        if sample is not None:
            assert sample.velocities[0] == pytest.approx(0.7, rel=1e-6)


# --- implausible joints


def model_state(**margins):
    state = RobotState(6, rules=StateRules(0.005, LIMITS, Margins(**margins)))
    for count in range(20):
        state.on_joints(joint_data([0.0] * 6), BEGIN + count * 0.005)
    return state, BEGIN + 0.1


@pytest.mark.parametrize(
    ('positions', 'text'),
    [
        ([0.0, 1e10], 'joint_2 is reported at 1e+10 rad, outside its range with margin, -2.89253'),
        ([0.0, 0.0, 0.0, 0.0, 0.0, -6.5], 'joint_6 is reported at -6.5 rad'),
        ([0.0, 0.0, 1.0], r'joint_3 is reported to have jumped by 1 rad in 0.005 s'),
        ([math.nan], 'joint 1: position nan is not finite'),
    ],
)
def test_inv6_implausible_joints_are_refused_and_inhibit_motion(positions, text):
    """The text has joint, value and limit, and the previous sample stays."""
    state, now = model_state()
    before = state.sample
    assert state.why_not_ready(now) is None
    with pytest.raises(ValueError, match='^' + text.replace('+', r'\+')):
        state.on_joints(joint_data(positions), now)
    assert state.sample is before
    assert text[:8] in state.why_not_ready(now)
    for count in range(1, 300):  # valid joints again, not trusted for 1 s
        state.on_joints(joint_data([0.0] * 6), now + count * 0.005)
        assert not state.sample.velocities.any()
        assert (state.why_not_ready(now + count * 0.005) is None) == (count >= 200)


def test_position_within_the_margin_is_accepted():
    state, now = model_state(position=0.5)
    high = LIMITS.position_max[1]
    for count in range(100):
        at = (high + 0.45) * count / 99
        state.on_joints(joint_data([0.0, at]), now + count * 0.005)
    with pytest.raises(ValueError, match='joint_2 is reported at'):
        state.on_joints(joint_data([0.0, high + 0.51]), now + 0.5)


def test_implausible_velocity_is_refused():
    state, now = model_state(velocity=2.0)
    fastest = LIMITS.velocity[3]
    valid = joint_data([0.0, 0.0, 0.0, -1.99 * fastest])
    assert state.on_joints(joint_data([0.0]), now, valid).velocities[3] == valid[3]
    with pytest.raises(ValueError, match='joint_4 is reported to move at'):
        state.on_joints(joint_data([0.0]), now + 0.005, joint_data([0.0] * 3 + [2.01 * fastest]))


@pytest.mark.parametrize('path', PATHS.values(), ids=PATHS)
@pytest.mark.parametrize('rate', [100.0, 200.0, 300.0])
def test_fastest_motion_is_plausible_over_any_network(path, rate):
    """A false alarm stops a robot in production."""
    v, reach = LIMITS.velocity[5], 5.0

    def fast(t):  # back and forth at full speed
        turn = 2 * reach / v
        phase = (t / turn) % 2.0
        return -reach + 2 * reach * (phase if phase < 1.0 else 2.0 - phase)

    state = RobotState(6, rules=StateRules(0.005, LIMITS))
    arrival, seen = 0.0, 0
    for slot in range(round(6.0 * rate)):
        sent = slot / rate
        arrival = max(arrival, path(sent))
        seen += state.on_joints(joint_data([0.0] * 5 + [fast(sent)]), BEGIN + arrival) is not None
    assert seen == round(6.0 * rate) - 1


def test_late_message_after_a_stall_of_the_controller_is_not_a_jump():
    """The controller stalls between measuring and sending, then sends the current position."""
    state, now = model_state()
    speed = LIMITS.velocity[0]
    for measured, arrival in ((0.0, 0.0), (0.005, 0.2), (0.235, 0.24)):
        state.on_joints(joint_data([speed * measured]), now + arrival)
    assert state.sample.positions[0] == pytest.approx(speed * 0.235)
    arrival = now + 0.24
    for _ in range(20):
        arrival += 0.005
        state.on_joints(joint_data([speed * 0.235]), arrival)
    with pytest.raises(ValueError, match='joint_1 is reported to have jumped'):
        state.on_joints(joint_data([speed * 0.235 - 0.2]), arrival + 0.005)


def test_implausible_jump_is_accepted_once_the_joint_could_have_moved_there():
    state, now = model_state()
    outcomes = []
    for count in range(100):
        try:
            state.on_joints(joint_data([1.0]), now + count * 0.005)
            outcomes.append(True)
        except ValueError:
            outcomes.append(False)
    first = outcomes.index(True)
    assert first * 0.005 == pytest.approx(0.95 / (1.5 * LIMITS.velocity[0]), abs=0.01)
    assert all(outcomes[first:])


# --- fresh joints and rest -----------------------------------------------------------


def test_inv6_old_joint_positions_do_not_permit_motion():
    state, now = model_state()
    assert state.why_not_ready(now) is None
    for count in range(200):  # the STATUS continues
        state.on_status(Status(), now + count * 0.005)
    assert state.stale(now + 1.0)
    assert state.why_not_ready(now + 1.0) == 'the newest joint state is 1 s old'


def test_inv6_delayed_joint_positions_are_stale_although_just_received():
    """It was delayed by 2 s."""
    state, now = model_state()
    state.on_joints(joint_data([0.0]), now + 2.0)
    assert state.stale(now + 2.0)
    for _ in range(400):
        state.on_joints(joint_data([0.0]), now + 2.0)
    assert not state.stale(now + 2.0)


@pytest.mark.parametrize('period', [0.05, 0.2])
def test_joint_positions_received_in_bursts_are_fresh(period):
    rows, _ = received(sine, bursts(period))
    newest = [
        list(group)[-1] for _, group in itertools.groupby(rows[200:], key=lambda row: row[1])
    ]
    worst = max(row[1] + period - row[3] for row in newest)
    assert worst < 0.3


def test_rest_requires_status_velocity_and_positions_to_agree():
    state, now = model_state()
    assert state.why_not_at_rest(0.01) is None
    state.on_status(Status(in_motion=1), now)
    assert state.why_not_at_rest(0.01) == 'in_motion of the controller'
    state.on_status(Status(in_motion=0), now + 0.005)
    assert state.why_not_at_rest(0.01) is None
    for count in range(6):  # back and forth within the window: the mean is 0
        at = (0.0, 0.01, 0.02, 0.02, 0.01, 0.0)[count]
        state.on_joints(joint_data([at]), now + 0.01 + count * 0.005)
    assert state.sample.velocities[0] == 0.0
    assert state.why_not_at_rest(0.01) == 'joint_1 just now by 0.02 rad'
    for count in range(4):
        state.on_joints(joint_data([0.0, 0.01 * count]), now + 0.04 + count * 0.005)
    assert state.why_not_at_rest(0.01).startswith('joint_2 at ')
    assert RobotState(1).why_not_at_rest(0.01) == 'no joint state from the controller'
