# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The point-to-point arm: blends, stops, holds and low power, never beyond a limit."""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion import go
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.point_to_point import OVERLAP_FRACTION, PointToPoint

MODEL = load_robot_model('c3_a601s')
SIMULATED = load_controller_profile('simulated').motion
LIMITS = MODEL.limits
LOW, HIGH = LIMITS.position_min, LIMITS.position_max
HOME = np.zeros(6)
AXIS = np.eye(6)[0]
CAPS = LowPower(0.05, 0.25, MODEL.reach)
DT = 1e-3
SLACK = 1.0 + 1e-6


def at(*angles):
    return np.array([*angles, *HOME[len(angles) :]], dtype=float)


@dataclass
class Harness:
    """A program that supplies points when the arm has room, and records the motion."""

    arm: PointToPoint
    waiting: deque = field(default_factory=deque)
    current: int | None = None
    answers: list = field(default_factory=list)
    taken: list = field(default_factory=list)
    positions: list = field(default_factory=list)
    velocities: list = field(default_factory=list)
    moving: list = field(default_factory=list)
    time: float = 0.0

    def __post_init__(self):
        self.sample()

    def send(self, *targets, velocity=0.0):
        for target in targets:
            self.waiting.append(Point(len(self.taken) + len(self.waiting), target, velocity, 0.0))
        self.advance()

    def advance(self):
        while self.current is None or self.arm.done:
            if self.current is not None:
                self.answers.append((self.current, round(self.time, 9)))
                self.current = None
            if not self.waiting or not self.arm.has_room:
                return
            point = self.waiting.popleft()
            self.current = point.sequence
            self.taken.append((point.sequence, round(self.time, 9)))
            self.arm.take(point)

    def step(self, dt=DT):
        left = dt
        while left is not None:
            before = left
            left = self.arm.step(left)
            assert left is None or 0.0 <= left <= before
            self.time += before - (left or 0.0)
            self.advance()
            if not self.arm.moving:
                self.time += left or 0.0
                break
        self.sample()

    def sample(self):
        self.positions.append(self.arm.position)
        self.velocities.append(self.arm.velocity)
        self.moving.append(self.arm.moving)

    def run(self, seconds=60.0):
        """Step until the arm is at rest, and return the time needed, s."""
        since = len(self.positions)
        for _ in range(round(seconds / DT)):
            if self.arm.at_rest:
                return (len(self.positions) - since) * DT
            self.step()
        raise AssertionError('the arm does not come to rest')

    def run_for(self, seconds):
        for _ in range(round(seconds / DT)):
            self.step()

    def stop(self):
        self.waiting.clear()
        self.current = None
        return self.arm.stop()

    def check(self, speed=1.0, accel=1.0, tool=np.inf):
        """Assert all limits, and that the velocity matches the positions."""
        p, v = np.array(self.positions), np.array(self.velocities)
        assert np.all((p >= LOW) & (p <= HIGH))
        assert np.all(np.abs(v) <= LIMITS.velocity * speed * SLACK)
        assert np.all(np.abs(v) @ MODEL.reach <= tool * SLACK)
        a = np.diff(v, axis=0) / DT
        assert np.all(np.abs(a) <= LIMITS.acceleration * accel * SLACK)
        j = np.diff(a, axis=0) / DT
        assert np.all(np.abs(j) <= LIMITS.jerk * accel * SLACK + 1e-6)
        rates = np.diff(p, axis=0) / DT
        assert np.all(np.abs(rates) <= LIMITS.velocity * speed * SLACK)
        means = (v[1:] + v[:-1]) / 2.0
        assert np.all(np.abs(rates - means) <= LIMITS.jerk * DT**2 + 1e-9)


def harness(start=HOME, speed=1.0, accel=1.0, cp=False, statement_overhead=0.0, **settings):
    motion = replace(
        SIMULATED, speed=speed, accel=accel, cp=cp, statement_overhead=statement_overhead
    )
    return Harness(PointToPoint(LIMITS, start, motion, caps=CAPS, **settings))


# ---- consecutive moves

CORNER = [at(0.5), at(0.5, -0.5), at(0.5, -0.5, 0.5)]


def test_moves_follow_each_other_without_a_pause():
    one = harness(speed=0.5)
    one.send(*CORNER)
    one.run()
    moves = zip([HOME, *CORNER], CORNER, strict=False)
    ends = np.cumsum([go(LIMITS, since, to, 0.5).duration for since, to in moves])
    assert [answer for answer, _ in one.answers] == [0, 1, 2]
    np.testing.assert_allclose([time for _, time in one.answers], ends, atol=1e-6)
    np.testing.assert_array_equal(one.arm.position, CORNER[-1])


def test_overhead_delays_the_start_of_a_move():
    one = harness(statement_overhead=0.012)
    one.send(*CORNER[:2])
    assert one.arm.moving
    assert not one.arm.at_rest
    one.run_for(0.011)
    assert not np.any(one.positions)
    one.run_for(0.002)
    assert one.arm.position[0] > 0.0
    one.run()
    moves = [go(LIMITS, HOME, CORNER[0]).duration, go(LIMITS, *CORNER[:2]).duration]
    ends = np.cumsum([duration + 0.012 for duration in moves])
    np.testing.assert_allclose([time for _, time in one.answers], ends, atol=1e-6)


def test_overhead_of_a_point_taken_ahead_costs_no_time():
    one = harness(statement_overhead=0.012, acknowledge='taken')
    one.send(*CORNER)
    assert [number for number, _ in one.answers] == [0, 1]  # one executed, one ahead
    moves = zip([HOME, *CORNER], CORNER, strict=False)
    durations = [go(LIMITS, since, to).duration for since, to in moves]
    assert one.run() == pytest.approx(0.012 + sum(durations), abs=2 * DT)
    assert one.answers[2] == (2, round(0.012 + durations[0], 9))
    np.testing.assert_array_equal(one.arm.position, CORNER[-1])


def test_one_point_is_taken_ahead():
    one = harness(acknowledge='taken')
    for number in range(2):
        assert one.arm.has_room
        one.arm.take(Point(number, at(0.1 * number + 0.1), 0.0, 0.0))
    assert not one.arm.has_room
    assert one.arm.done
    with pytest.raises(RuntimeError, match='no room for a point'):
        one.arm.take(Point(9, at(1.0), 0.0, 0.0))


@pytest.mark.parametrize('cp', [False, True])
def test_point_at_the_current_position_takes_no_time(cp):
    one = harness(cp=cp, statement_overhead=0.012)
    one.send(HOME, HOME + 1e-50, HOME)
    assert [number for number, _ in one.answers] == [0, 1, 2]
    assert not one.arm.moving
    one.send(at(0.3), at(0.3), at(0.3 + 1e-12), at(0.1))
    one.run()
    assert [number for number, _ in one.answers] == list(range(7))
    np.testing.assert_array_equal(one.arm.position, at(0.1))


def test_speed_and_accel_apply_from_the_next_point():
    one = harness(acknowledge='taken')
    one.send(at(2.0), at(-2.0))
    one.arm.speed, one.arm.accel = 0.3, 0.5
    one.send(at(2.0))
    one.run()
    velocities = np.array(one.velocities)[:, 0]
    slow = velocities[len(velocities) - round(go(LIMITS, at(-2), at(2), 0.3, 0.5).duration / DT) :]
    assert np.max(slow) == pytest.approx(0.3 * LIMITS.velocity[0], rel=1e-6)
    assert np.min(velocities) == pytest.approx(-LIMITS.velocity[0], rel=1e-6)
    one.check()


@pytest.mark.parametrize('value', [0.0, -0.1, 1.01, np.nan])
@pytest.mark.parametrize('name', ['speed', 'accel'])
def test_invalid_speed_or_accel_is_refused(name, value):
    arm = harness(speed=0.4, accel=0.4).arm
    with pytest.raises(ValueError, match=f'^{name} = .*must be in'):
        setattr(arm, name, value)
    assert (arm.speed, arm.accel) == (0.4, 0.4)
    with pytest.raises(ValueError, match=f'^{name} = '):
        harness(**{name: value})


@pytest.mark.invariant(7)
def test_inv7_invalid_point_is_refused_and_nothing_moves():
    arm = harness().arm
    for target in (at(9.0), at(np.nan), np.zeros(5)):
        with pytest.raises(ValueError, match='target'):
            arm.take(Point(0, target, 0.0, 0.0))
    with pytest.raises(ValueError, match='speed = nan'):
        arm.take(Point(0, at(0.1), np.nan, 0.0))
    assert not arm.moving
    assert arm.has_room


@pytest.mark.invariant(2)
def test_inv2_rounding_near_a_limit_does_not_pass_it():
    random = np.random.default_rng(0)
    for _ in range(300):
        start, target = random.uniform(LOW, HIGH, (2, 6))
        joint = random.integers(6)
        target[joint] = HIGH[joint]
        arm, timer = (harness(start, 0.5, 0.5).arm for _ in range(2))
        for item in (arm, timer):
            item.take(Point(0, target, 0.0, 0.0))
        duration = 1000.0 - timer.step(1000.0)
        arm.step(duration * (1.0 - 1e-7))
        assert arm.moving
        assert arm.position[joint] <= HIGH[joint]


# ---- Go … CP


def test_cp_passes_known_points_without_a_stop():
    one = harness(cp=True, acknowledge='taken')
    rests = harness(acknowledge='taken', accel=OVERLAP_FRACTION)
    for item in (one, rests):
        item.send(*CORNER)
    assert one.run() < rests.run() - 0.1
    one.check()
    np.testing.assert_array_equal(one.arm.position, CORNER[-1])
    speeds = np.abs(np.array(one.velocities)).max(axis=1)
    assert np.min(speeds[50:-50]) > 0.25
    # the corner is cut
    away = np.abs(np.array(one.positions) - CORNER[0]).max(axis=1)
    assert np.min(away) > 1e-3


def test_cp_answers_a_point_when_its_deceleration_starts():
    one = harness(cp=True, speed=0.5)
    one.send(*CORNER[:2])
    one.run()
    assert one.answers[0][1] == pytest.approx(
        go(LIMITS, HOME, CORNER[0], 0.5, OVERLAP_FRACTION).braking, abs=1e-8
    )
    assert one.taken[1][1] == one.answers[0][1]
    one.check()
    duration = sum(
        go(LIMITS, *pair, 0.5, OVERLAP_FRACTION).duration
        for pair in ((HOME, CORNER[0]), CORNER[:2])
    )
    assert one.time < duration - 0.05


def test_point_received_during_deceleration_is_not_blended():
    one = harness(cp=True, speed=0.5)
    first, second = (
        go(LIMITS, HOME, CORNER[0], 0.5, OVERLAP_FRACTION),
        go(LIMITS, *CORNER[:2], 0.5, OVERLAP_FRACTION),
    )
    one.send(CORNER[0])
    one.run_for(first.braking + 2 * DT)
    assert one.arm.done
    assert one.arm.has_room
    one.send(CORNER[1])
    one.run()
    away = np.abs(np.array(one.positions) - CORNER[0]).max(axis=1)
    assert np.min(away) < 1e-5
    assert len(one.positions) * DT == pytest.approx(first.duration + second.duration, abs=3 * DT)


# ---- stop, hold, resume, settle


@pytest.mark.invariant(3)
@pytest.mark.parametrize('cp', [False, True])
def test_inv3_stop_discards_all_points(cp):
    one = harness(cp=cp, acknowledge='taken')
    one.send(*CORNER)
    one.run_for(0.2)
    assert one.stop()  # answered points are lost
    assert one.arm.moving
    assert not one.arm.has_room
    assert not one.arm.stop()  # the second stop discards nothing
    one.run()
    one.check()
    where = one.arm.position
    one.run_for(0.5)
    np.testing.assert_array_equal(one.arm.position, where)
    assert one.arm.has_room
    assert not one.arm.moving
    one.send(HOME)
    one.run()
    np.testing.assert_array_equal(one.arm.position, HOME)


def test_stop_returns_whether_answered_points_are_lost():
    for cp, after, lost in ((False, 0.1, False), (True, 0.1, False), (True, 0.3, True)):
        one = harness(cp=cp)
        one.send(at(1.0))
        one.run_for(after)
        assert one.arm.moving
        assert one.stop() is lost
    one.run()
    assert one.stop() is False


@pytest.mark.invariant(3)
@pytest.mark.parametrize('instant', np.arange(0.02, 1.0, 0.049))
def test_inv3_hold_stays_on_the_path_and_resume_reaches_every_target(instant):
    one = harness(acknowledge='taken', statement_overhead=0.012)
    one.send(*CORNER)
    one.run_for(instant)
    one.arm.hold()
    one.arm.hold()
    one.run()
    assert one.arm.at_rest
    where = one.arm.position
    one.run_for(0.3)
    np.testing.assert_array_equal(one.arm.position, where)
    one.arm.resume()
    one.run()
    one.check()
    np.testing.assert_allclose(one.arm.position, CORNER[-1], rtol=0.0, atol=1e-7)
    assert not one.arm.moving
    positions = np.array(one.positions)
    for target in CORNER:
        assert np.min(np.abs(positions - target).max(axis=1)) < 1e-4
    # one joint moves after the other
    assert np.all((positions[:, 1] == 0.0) | (np.abs(positions[:, 0] - 0.5) < 1e-7))


def test_hold_at_rest_keeps_the_points_until_stop():
    one = harness(acknowledge='taken')
    one.arm.hold()
    assert one.arm.at_rest
    assert not one.arm.moving
    one.send(at(1.0))
    one.run_for(0.1)
    assert one.arm.at_rest
    assert one.arm.moving
    assert not np.any(one.positions)
    assert one.stop()
    assert not one.arm.moving
    one.send(at(0.2))
    one.run()
    np.testing.assert_array_equal(one.arm.position, at(0.2))


def test_resume_after_a_hold_in_a_blend_reaches_every_target():
    one = harness(cp=True, acknowledge='taken', speed=0.5)
    one.send(*CORNER)
    one.run_for(go(LIMITS, HOME, CORNER[0], 0.5, OVERLAP_FRACTION).braking + 0.03)
    assert np.all(one.arm.velocity[:2] != 0.0)  # both lines
    one.arm.hold()
    one.run()
    one.arm.resume()
    one.run()
    one.check()
    np.testing.assert_array_equal(one.arm.position, CORNER[-1])
    assert [number for number, _ in one.answers] == [0, 1, 2]


def test_resume_during_braking_continues_from_rest():
    one = harness()
    one.send(at(2.0))
    one.run_for(0.2)
    one.arm.hold()
    one.step()
    one.arm.resume()
    one.run()
    one.check()
    np.testing.assert_array_equal(one.arm.position, at(2.0))
    assert [number for number, _ in one.answers] == [0]


def test_position_can_be_set_only_while_the_arm_has_no_points():
    one = harness()
    one.arm.set_position(at(0.4, -0.2))
    np.testing.assert_array_equal(one.arm.position, at(0.4, -0.2))
    with pytest.raises(ValueError, match='joint_1'):
        one.arm.set_position(at(9.0))
    one.send(at(1.0))
    with pytest.raises(RuntimeError, match='pending points'):
        one.arm.set_position(HOME)
    one.arm.hold()
    with pytest.raises(RuntimeError, match='pending points'):
        one.arm.set_position(HOME)
    one.arm.resume()
    one.run()
    np.testing.assert_array_equal(one.arm.position, at(1.0))


# ---- low power


@pytest.mark.parametrize('cp', [False, True])
def test_low_power_applies_from_the_next_move_from_rest(cp):
    one = harness(cp=cp, acknowledge='taken')
    one.arm.low_power = True
    one.send(at(0.02, -0.02), at(0.02, 0.0, 0.05), at(0.02, 0.0, 0.05, 0.2, 0.2, 1.0))
    one.run()
    one.check(CAPS.fraction, CAPS.fraction, CAPS.tool_speed)
    one.arm.low_power = False
    one.send(at(1.5))
    one.run_for(0.1)
    one.arm.low_power = True
    one.send(at(1.5, -0.02))
    one.run()
    assert np.max(np.array(one.velocities)[:, 0]) > 0.5 * LIMITS.velocity[0]
    np.testing.assert_allclose(one.positions[-1], at(1.5, -0.02))
    speeds = np.abs(np.array(one.velocities))[:, 1]
    assert np.max(speeds[-100:]) <= CAPS.fraction * LIMITS.velocity[1] * SLACK
    one.check()


@pytest.mark.invariant(2)
def test_inv2_low_power_bounds_the_tool_speed_on_any_line():
    random = np.random.default_rng(3)
    one = harness(acknowledge='taken', cp=True)
    one.arm.low_power = True
    one.send(*random.uniform(LOW, HIGH, (4, 6)))
    one.run(200.0)
    one.check(CAPS.fraction, CAPS.fraction, CAPS.tool_speed)
    tool = np.abs(np.array(one.velocities)) @ MODEL.reach
    assert np.max(tool) > 0.9 * CAPS.tool_speed


# ---- random events

SHARES = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
SPOTS = st.tuples(*[SHARES] * 6).map(lambda shares: LOW + np.array(shares) * (HIGH - LOW))
STEPS = st.sampled_from([0.0, 0.0, 1e-12, 1e-7, 1e-3, -1e-3]) | st.floats(-0.3, 0.3)
NEAR = st.tuples(*[STEPS] * 6).map(np.array)
EVENTS = st.sampled_from(['stop', 'hold', 'resume', 'low', 'high', 'slow', 'send', 'none'])


@pytest.mark.invariant(2, 3)
@settings(max_examples=examples(60))
@given(
    start=SPOTS,
    moves=st.lists(NEAR | SPOTS.map(lambda spot: spot / 2.0), min_size=2, max_size=6),
    events=st.lists(st.tuples(st.floats(0.0, 0.4), EVENTS), max_size=8),
    speed=st.floats(0.05, 1.0),
    accel=st.floats(0.1, 1.0),
    cp=st.booleans(),
    early=st.booleans(),
    overhead=st.sampled_from([0.0, 0.012]),
    dt=st.sampled_from([DT, DT, DT / 3.0]),
)
def test_inv2_and_3_random_events_exceed_no_limit(
    start, moves, events, speed, accel, cp, early, overhead, dt
):
    one = harness(
        start,
        speed,
        accel,
        cp=cp,
        acknowledge='taken' if early else 'default',
        statement_overhead=overhead,
    )
    targets = list(np.clip(start + np.cumsum(moves, axis=0), LOW, HIGH))
    one.send(*targets)
    sent = len(targets)
    for wait, event in events:
        one.run_for(wait)
        if event == 'stop':
            one.stop()
            sent = 0
        elif event == 'hold':
            one.arm.hold()
        elif event == 'resume':
            one.arm.resume()
        elif event == 'slow':
            one.arm.speed, one.arm.accel = speed / 2.0, accel / 2.0
        elif event == 'send':
            one.send(targets[0], targets[-1])
            sent += 2
        elif event != 'none':
            one.arm.low_power = event == 'low'
        assert one.arm.at_rest or one.arm.moving
    one.arm.resume()
    one.arm.low_power = False
    one.run(300.0)
    one.check()
    assert not one.arm.moving
    assert not one.arm.velocity.any()
    if sent:
        assert np.float32(one.arm.position).tolist() == np.float32(targets[-1]).tolist()
        assert [number for number, _ in one.answers] == sorted(n for n, _ in one.answers)
        assert one.answers[-1][0] == one.taken[-1][0]


@pytest.mark.invariant(3)
@settings(max_examples=examples(60))
@given(
    corner=SPOTS,
    before=NEAR,
    after=NEAR,
    speed=st.floats(0.2, 1.0),
    accel=st.floats(0.3, 1.0),
    instant=st.floats(0.0, 1.0),
    hold=st.booleans(),
)
def test_inv3_stop_in_a_blend_exceeds_no_limit(corner, before, after, speed, accel, instant, hold):
    start, end = (np.clip(corner + step, LOW, HIGH) for step in (before, after))
    one = harness(start, speed, accel, cp=True, acknowledge='taken')
    one.send(corner, end)
    first = go(LIMITS, start, corner, speed, accel)
    one.run_for(first.braking + instant * (first.duration - first.braking))
    if hold:
        one.arm.hold()
    else:
        one.stop()
    assert one.run() < 2.0
    one.check()
    one.arm.resume()
    one.run()
    one.check()
    if hold:
        assert np.float32(one.arm.position).tolist() == np.float32(end).tolist()


@pytest.mark.invariant(3)
def test_inv3_stop_in_a_blend_at_a_limit_stays_inside():
    for step in range(0, 120, 3):
        one = harness(at(2.0), 1.0, 0.5, cp=True, acknowledge='taken')
        one.send(at(HIGH[0]), at(2.0))
        first = go(LIMITS, at(2.0), at(HIGH[0]), 1.0, 0.5)
        one.run_for(first.braking + step * DT)
        one.stop()
        one.run()
        one.check()


# ---- CP at any acceleration, durations, started points


@pytest.mark.parametrize('duration', [0.4, 2.0, 8.0])
def test_point_takes_its_duration(duration):
    arm = harness(timed=True).arm
    arm.take(Point(0, HOME + AXIS, 0.0, duration))
    time = 0.0
    while arm.moving:
        arm.step(0.001)
        time += 0.001
    assert time == pytest.approx(duration, rel=0.01, abs=0.002)


def test_too_short_duration_gives_the_fastest_allowed_move():
    timed, free = harness(timed=True).arm, harness().arm
    for arm in (timed, free):
        arm.take(Point(0, HOME + AXIS, 0.0, 0.01))
    while timed.moving or free.moving:
        assert np.array_equal(timed.position, free.position)
        timed.step(0.004)
        free.step(0.004)


def test_started_points_are_counted_once():
    arm = harness(acknowledge='taken').arm
    for index in (1, 2):
        arm.take(Point(index, HOME + 0.1 * index * AXIS, 0.0, 0.0))
    arm.step(0.01)
    assert arm.started_points == 1
    arm.hold()
    while not arm.at_rest:
        arm.step(0.004)
    arm.resume()
    seen = []
    while arm.moving:
        arm.step(0.004)
        seen.append(arm.started_points)
    assert seen[0] == 1
    assert sorted(set(seen)) == [1, 2]
    arm.take(Point(3, HOME + 0.2 * AXIS, 0.0, 0.0))  # the current position
    assert arm.started_points == 3


def test_destination_is_known_in_every_phase():
    far, farther = HOME + 0.5, HOME + 0.8
    arm = harness(acknowledge='taken', statement_overhead=0.1).arm
    assert np.array_equal(arm.destination, HOME)
    arm.take(Point(0, far, 0.0, 0.0))
    assert np.array_equal(arm.destination, far)  # not started
    arm.step(0.15)
    assert np.allclose(arm.destination, far, atol=1e-12)  # under way
    arm.take(Point(1, farther, 0.0, 0.0))
    assert np.array_equal(arm.destination, farther)
    arm.stop()
    rest = arm.destination
    assert np.all(np.abs(rest - HOME) < np.abs(far - HOME))
    while arm.moving:
        arm.step(0.01)
    assert np.allclose(arm.position, rest, atol=1e-12)
    assert np.array_equal(arm.destination, arm.position)
