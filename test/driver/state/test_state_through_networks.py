# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Velocities and ages of joints that a network delays, bunches up and stops (invariants 6 and 8).

The controller sends by its own clock, ten joints and a STATUS in turn; `ways` says when each
message arrives, on a manual clock. A velocity is the mean over a window, so it must lie between
the slowest and the fastest that the joint was in the window, within 2 % of the motion's fastest.
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
    """Two seconds of a trapezoid of 2 rad/s and 10 rad/s², half a second of rest; then back."""
    back, t = divmod(t, 2.5)
    t = min(t, 2.0)
    way = 5 * t * t if t < 0.2 else 2 * t - 0.2
    way = 3.6 - 5 * (2.0 - t) ** 2 if t > 1.8 else way
    return way / 2 if back % 2 == 0 else (3.6 - way) / 2


MOTIONS = {'sine': sine, 'there and back': there_and_back}


def bursts(gathered):
    return lambda t: math.floor(t / gathered + 1.0) * gathered


def late_by(chance, longest):
    return lambda t: t + chance.uniform(0.0, longest)


def stall(begin, end):
    """What comes meanwhile is read when it is over."""
    return lambda t: end if begin < t < end else t


WAYS = {
    'regular': lambda t: t,
    'jitter of 2 ms': late_by(random.Random(1), 0.002),
    'jitter of 15 ms': late_by(random.Random(2), 0.015),
    'bursts of 50 ms': bursts(0.05),
    'bursts of 100 ms': bursts(0.1),
    'bursts of 200 ms': bursts(0.2),
    'bursts of 0.5 s': bursts(0.5),
    'read late by 0.3 s': stall(2.0, 2.3),
    'read late by 3 s': stall(1.5, 4.5),
    'a way longer by 50 ms for a while': lambda t: t + (0.05 if 2.0 < t < 4.0 else 0.0),
}


def received(motion, way, *, rate=200.0, seconds=6.0, pauses=(), profile=0.005, state=None):
    """Return a row for each sample, and the state: sent, arrival, velocity, measured (s, rad/s).

    pauses: (when, how long) the controller sends nothing, s. Times are from the beginning.
    """
    state = state or RobotState(1, rules=StateRules(profile))
    rows, arrival, sent = [], 0.0, 0.0
    pauses = list(pauses)
    for slot in range(round(seconds * rate)):
        sent += 1.0 / rate
        if pauses and sent >= pauses[0][0]:
            sent += pauses.pop(0)[1]
        arrival = max(arrival, way(sent))
        if slot % 11 == 10:
            state.on_status(Status(), BEGIN + arrival)
            continue
        sample = state.on_joints(joint_data([float(np.float32(motion(sent)))]), BEGIN + arrival)
        if sample is not None:
            rows.append((sent, arrival, sample.velocities[0], sample.measured - BEGIN))
    return np.array(rows), state


def errors(rows, motion, window=VELOCITY_WINDOW_S):
    """Return how far each velocity is outside what the joint did in the window, rad/s."""
    found = []
    for sent, _, velocity, _ in rows:
        times = np.linspace(sent - window - 0.001, sent, 60)
        true = np.diff([motion(time) for time in times]) / np.diff(times)
        found.append(max(true.min() - velocity, velocity - true.max(), 0.0))
    return np.array(found)


@pytest.mark.parametrize('rate', RATES.values(), ids=RATES)
@pytest.mark.parametrize('way', one_in(4, WAYS.values()), ids=WAYS)
@pytest.mark.parametrize('motion', MOTIONS.values(), ids=MOTIONS)
def test_inv8_velocities_are_those_of_the_motion_whatever_the_network_does(motion, way, rate):
    """docs/invariants.md, 8: also in the first second, in which the period is the profile's."""
    rows, _ = received(motion, way, rate=rate)
    fastest = math.pi if motion is sine else 1.0
    assert errors(rows, motion).max() < 0.02 * fastest


@pytest.mark.parametrize('way', WAYS.values(), ids=WAYS)
def test_inv8_a_joint_that_moves_has_a_velocity(way):
    """docs/invariants.md, 8: none is 0 for want of data, the first one neither."""
    rows, _ = received(lambda t: 0.3 * t, way)
    assert rows[:, 2] == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize('way', WAYS.values(), ids=WAYS)
def test_inv6_the_age_of_a_sample_is_known_to_two_periods(way):
    """docs/invariants.md, 6: what waited on its way is not taken for fresh."""
    rows, _ = received(sine, way, rate=RATES['182 joints/s'])
    sent, arrival, _, measured = rows[rows[:, 0] > 1.5].T
    assert np.all(measured <= arrival + 1e-9)
    assert np.all(np.diff(measured) >= 0.0)
    slack = 0.051 if 'longer' in str(way) or way(3.0) == 3.05 else 0.0  # it cannot be told
    least = min(way(t) - t for t in np.linspace(1.0, 2.0, 5000))
    assert np.all(np.abs(measured - sent - least) < 0.012 + slack)


def test_inv6_what_waited_for_three_seconds_is_three_seconds_old():
    """docs/invariants.md, 6."""
    rows, _ = received(sine, stall(1.5, 4.5))
    first_read = rows[np.argmax(rows[:, 1] == 4.5)]
    assert first_read[1] - first_read[3] == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize('length', [0.02, 0.05, 0.3])
@pytest.mark.parametrize('way', ['regular', 'bursts of 100 ms'])
def test_a_controller_that_pauses_is_followed(way, length):
    """Between the samples beside the pause there is the mean over it; then all is as before."""
    pause = (2.0, length)
    rows, state = received(there_and_back, WAYS[way], pauses=[pause])
    after = rows[:, 0] > 2.0 + length + 0.5
    assert errors(rows[after], there_and_back).max() < 0.02
    beside = (rows[:, 0] >= 2.0) & ~after
    assert np.abs(rows[beside, 2]).max() < 1.05
    age = rows[:, 1] - rows[:, 3]
    assert age[-1] < 0.11
    assert state._clock.period == pytest.approx(0.005, rel=0.01)


@pytest.mark.parametrize('period', [0.0025, 0.007, 0.012, 0.02, 0.1, 1.0])
@pytest.mark.parametrize('profile', [0.005, 0.02])
def test_a_period_that_is_not_the_profiles_is_found(profile, period):
    rows, _ = received(
        lambda t: 0.2 * t,
        WAYS['regular'],
        rate=1 / period,
        seconds=120 * period + 2,
        profile=profile,
    )
    late = rows[30:] if period >= 0.1 else rows[rows[:, 0] > 1.0]
    assert late[:, 2] == pytest.approx(0.2, rel=0.02)


def test_messages_that_share_a_slot_with_the_status():
    """Not every controller gives the STATUS a slot of its own."""
    state = RobotState(1)
    samples = []
    for count in range(400):
        samples.append(state.on_joints(joint_data([0.4 * count * 0.02]), BEGIN + count * 0.02))
        state.on_status(Status(), BEGIN + count * 0.02)
    for sample in samples[100:]:
        assert sample.velocities[0] == pytest.approx(0.4, rel=0.02)
        assert sample.time - sample.measured < 0.021


def test_inv8_no_velocity_is_more_than_a_joint_can_have():
    """docs/invariants.md, 8: though positions and times say so; that is counted, too."""
    limits = LIMITS
    state = RobotState(6, rules=StateRules(0.005, limits, Margins(velocity=1.5)))
    bound = 1.5 * limits.velocity[0]
    arrival = BEGIN
    for count in range(100):
        arrival += 0.2 if count % 20 == 0 else 0.0
        # a controller that is slower than it was said to be, read in bursts
        sample = state.on_joints(joint_data([-2.0 + 0.04 * count]), arrival)
        assert sample is None or abs(sample.velocities[0]) <= bound
    assert state.bounded == 0
    for count in range(20):
        state.on_joints(joint_data([2.0 - 0.2 * count]), arrival + 0.2)
        assert abs(state.sample.velocities[0]) <= bound
    assert state.bounded > 0
    assert state.why_not_standing(0.01) is not None


def test_the_controllers_own_time_is_used_where_it_has_one():
    """Positions and times of JOINT_FEEDBACK, sent irregularly: no slot is counted."""
    state, chance, t = RobotState(1), random.Random(3), 0.0
    for _ in range(300):
        t += chance.uniform(0.002, 0.014)
        sample = state.on_joints(joint_data([0.7 * t]), BEGIN + bursts(0.1)(t), None, t)
        if sample is not None:
            assert sample.velocities[0] == pytest.approx(0.7, rel=1e-6)


@pytest.mark.parametrize('unit', [1e3, 1e-3, 0.0, -1.0, math.nan])
def test_a_time_that_cannot_be_is_not_used(unit):
    state = RobotState(1)
    for count in range(300):
        t = count * 0.005
        sample = state.on_joints(joint_data([0.7 * t]), BEGIN + t, None, t * unit)
        if sample is not None:
            assert sample.velocities[0] == pytest.approx(0.7, rel=1e-6)


def test_a_time_that_is_too_coarse_is_not_used():
    """Seven digits after a day."""
    state = RobotState(1)
    for count in range(300):
        t = count * 0.005
        told = float(np.float32(86400.0 + t))
        sample = state.on_joints(joint_data([0.7 * t]), BEGIN + t, None, told)
        if sample is not None:
            assert sample.velocities[0] == pytest.approx(0.7, rel=1e-6)


# --- what cannot be true ------------------------------------------------------------------------


def model_state(**margins):
    state = RobotState(6, rules=StateRules(0.005, LIMITS, Margins(**margins)))
    for count in range(20):
        state.on_joints(joint_data([0.0] * 6), BEGIN + count * 0.005)
    return state, BEGIN + 0.1


@pytest.mark.parametrize(
    ('positions', 'said'),
    [
        ([0.0, 1e10], 'joint_2 is reported at 1e+10 rad: with its margin it can be at -2.89253'),
        ([0.0, 0.0, 0.0, 0.0, 0.0, -6.5], 'joint_6 is reported at -6.5 rad'),
        ([0.0, 0.0, 1.0], r'joint_3 is reported to have jumped by 1 rad in 0.005 s: it can go'),
        ([math.nan], 'joint 1: position nan is not finite'),
    ],
)
def test_inv6_what_cannot_be_true_is_refused_and_nothing_may_begin(positions, said):
    """docs/invariants.md, 6: it says joint, value and limit; the sample is that of before."""
    state, now = model_state()
    before = state.sample
    assert state.why_not_ready(now) is None
    with pytest.raises(ValueError, match='^' + said.replace('+', r'\+')):
        state.on_joints(joint_data(positions), now)
    assert state.sample is before
    assert said[:8] in state.why_not_ready(now)
    for count in range(1, 300):  # and goes on as it was, but is not trusted for a second
        state.on_joints(joint_data([0.0] * 6), now + count * 0.005)
        assert not state.sample.velocities.any()
        assert (state.why_not_ready(now + count * 0.005) is None) == (count >= 200)


def test_a_margin_is_allowed():
    state, now = model_state(position=0.5)
    high = LIMITS.position_max[1]
    for count in range(100):
        at = (high + 0.45) * count / 99
        state.on_joints(joint_data([0.0, at]), now + count * 0.005)
    with pytest.raises(ValueError, match='joint_2 is reported at'):
        state.on_joints(joint_data([0.0, high + 0.51]), now + 0.5)


def test_velocities_that_cannot_be_true_are_refused():
    state, now = model_state(velocity=2.0)
    fastest = LIMITS.velocity[3]
    fine = joint_data([0.0, 0.0, 0.0, -1.99 * fastest])
    assert state.on_joints(joint_data([0.0]), now, fine).velocities[3] == fine[3]
    with pytest.raises(ValueError, match='joint_4 is reported to move at'):
        state.on_joints(joint_data([0.0]), now + 0.005, joint_data([0.0] * 3 + [2.01 * fastest]))


@pytest.mark.parametrize('way', WAYS.values(), ids=WAYS)
@pytest.mark.parametrize('rate', [100.0, 200.0, 300.0])
def test_the_fastest_motion_is_no_jump_whatever_the_network_does(way, rate):
    """A false alarm stops a robot in production."""
    v, reach = LIMITS.velocity[5], 5.0

    def fast(t):  # there and back at full speed
        turn = 2 * reach / v
        phase = (t / turn) % 2.0
        return -reach + 2 * reach * (phase if phase < 1.0 else 2.0 - phase)

    state = RobotState(6, rules=StateRules(0.005, LIMITS))
    arrival, seen = 0.0, 0
    for slot in range(round(6.0 * rate)):
        sent = slot / rate
        arrival = max(arrival, way(sent))
        seen += state.on_joints(joint_data([0.0] * 5 + [fast(sent)]), BEGIN + arrival) is not None
    assert seen == round(6.0 * rate) - 1


def test_a_controller_that_is_held_up_between_measuring_and_sending_does_not_jump():
    """What it measured before comes late, and right after it where the arm is by then."""
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


def test_joints_that_are_somewhere_else_are_believed_when_they_can_be_there():
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


# --- fresh and standing -------------------------------------------------------------------------


def test_inv6_an_old_pose_is_not_ready():
    """docs/invariants.md, 6."""
    state, now = model_state()
    assert state.why_not_ready(now) is None
    for count in range(200):  # the STATUS goes on
        state.on_status(Status(), now + count * 0.005)
    assert state.stale(now + 1.0)
    assert state.why_not_ready(now + 1.0) == 'the newest joint state is 1 s old'


def test_inv6_what_comes_late_is_not_ready_however_fresh_it_looks():
    """docs/invariants.md, 6: read just now, but it waited for 2 s."""
    state, now = model_state()
    state.on_joints(joint_data([0.0]), now + 2.0)
    assert state.stale(now + 2.0)
    for _ in range(400):
        state.on_joints(joint_data([0.0]), now + 2.0)
    assert not state.stale(now + 2.0)


@pytest.mark.parametrize('gathered', [0.05, 0.2])
def test_bursts_are_fresh_enough(gathered):
    rows, _ = received(sine, bursts(gathered))
    newest = [
        list(group)[-1] for _, group in itertools.groupby(rows[200:], key=lambda row: row[1])
    ]
    worst = max(row[1] + gathered - row[3] for row in newest)
    assert worst < 0.3


def test_standing_asks_the_controller_the_velocity_and_the_window():
    state, now = model_state()
    assert state.why_not_standing(0.01) is None
    state.on_status(Status(in_motion=1), now)
    assert state.why_not_standing(0.01) == 'the controller says so'
    state.on_status(Status(in_motion=0), now + 0.005)
    assert state.why_not_standing(0.01) is None
    for count in range(6):  # there and back within the window: the mean is 0
        at = (0.0, 0.01, 0.02, 0.02, 0.01, 0.0)[count]
        state.on_joints(joint_data([at]), now + 0.01 + count * 0.005)
    assert state.sample.velocities[0] == 0.0
    assert state.why_not_standing(0.01) == 'joint_1 just now by 0.02 rad'
    for count in range(4):
        state.on_joints(joint_data([0.0, 0.01 * count]), now + 0.04 + count * 0.005)
    assert state.why_not_standing(0.01).startswith('joint_2 at ')
    assert RobotState(1).why_not_standing(0.01) == 'no joint state from the controller'
