# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoother's interface: points in, motion out (docs/invariants.md, 2 and 3)."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import assert_kept, assert_within_all_limits

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.point_to_point import go
from epson_driver.motion.smoother import (
    MERGE_TOLERANCE,
    PASSED_TYPES,
    Mode,
    Plan,
    Request,
    Smoother,
    plan,
)
from epson_driver.processes.worker import packed, unpacked
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

pytestmark = pytest.mark.invariant(2, 3)

LIMITS = load_robot_model('c3_a601s').limits
HOME = np.array([0.0, -0.5, 1.0, 0.0, -1.0, 0.0])
DT = 1e-3


def arc(count: int, spacing: float = 0.03) -> Array:
    """Return points on an arc from HOME, shape (count, 6)."""
    s = spacing * np.arange(1, count + 1)[:, None]
    return (
        HOME
        + np.hstack([np.sin(s), 1.0 - np.cos(s), -0.5 * s, 0.3 * np.sin(2.0 * s), 0.0 * s, s])
        * 0.5
    )


def rest(smoother: Smoother, longest: float = 60.0) -> tuple[Array, Array, Array]:
    """Step until rest, and return positions, velocities, accelerations every DT, (k, 6)."""
    motions = [smoother.motion]
    while smoother.moving:
        assert len(motions) < longest / DT, 'no rest'
        motions.append(smoother.step(DT))
    position, velocity, acceleration = (np.array(values) for values in zip(*motions, strict=True))
    return position, velocity, acceleration


def assert_inside(limits: JointLimits, velocity: Array, acceleration: Array) -> None:
    jerk = np.diff(acceleration, axis=0) / DT
    assert np.max(np.abs(velocity) / limits.velocity) <= 1.0 + 1e-6
    assert np.max(np.abs(acceleration) / limits.acceleration) <= 1.0 + 1e-6
    assert np.max(np.abs(jerk) / limits.jerk) <= 1.02


def interior_stops(velocity: Array) -> int:
    speed = np.max(np.abs(velocity) / LIMITS.velocity, axis=1)
    moving = np.flatnonzero(speed > 1e-4)
    return int(np.sum(speed[moving[0] : moving[-1]] < 1e-4))


def near(positions: Array, points: Array) -> float:
    """Return the largest distance of a point from the sampled motion, rad."""
    return max(float(np.min(np.max(np.abs(positions - point), axis=1))) for point in points)


@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('name', ['around_pillar_11_points', 'around_pillar_fast_100ms'])
def test_plan_is_followed_without_a_stop(name: str, mode: Mode) -> None:
    trajectory = read_trajectory(Path(share_path('config', 'trajectories', f'{name}.yaml')))
    smoother = Smoother(LIMITS, trajectory.positions[0], mode)
    durations = np.diff(trajectory.times)
    for point, duration in zip(trajectory.positions[1:], durations.tolist(), strict=True):
        smoother.append(point, duration)
    smoother.finish()
    position, velocity, acceleration = rest(smoother)
    assert_inside(LIMITS, velocity, acceleration)
    assert interior_stops(velocity) == 0
    assert np.array_equal(position[-1], trajectory.positions[-1])
    assert near(position, trajectory.positions) < np.max(np.abs(velocity)) * DT
    assert len(position) * DT < 1.25 * trajectory.duration


def test_motion_takes_the_commanded_time_within_the_limits() -> None:
    smoother = Smoother(LIMITS, HOME)
    for point in arc(40):
        smoother.append(point, 0.1)
    position, velocity, _ = rest(smoother)
    assert len(position) * DT == pytest.approx(4.0, rel=0.03)
    assert interior_stops(velocity) == 0


@pytest.mark.parametrize('known', one_in(4, range(1, 12)))
def test_interrupted_stream_ends_at_rest_at_the_last_point(known: int) -> None:
    smoother = Smoother(LIMITS, HOME, latency=0.02)
    points = arc(12)
    for point in points[:known]:
        smoother.append(point, 0.05)
        smoother.step(0.01)
    position, velocity, acceleration = rest(smoother)
    assert np.array_equal(position[-1], points[known - 1])
    assert_inside(LIMITS, velocity, acceleration)
    smoother.append(points[known % 12], 0.5)
    position, _, _ = rest(smoother)
    assert np.array_equal(position[-1], points[known % 12])


def test_steps_together_are_the_separate_steps_until_rest() -> None:
    separate, together = Smoother(LIMITS, HOME), Smoother(LIMITS, HOME)
    for smoother in (separate, together):
        for trajectory in (arc(40), arc(40)[::-1]):
            for point in trajectory:
                smoother.append(point, 0.03)
            smoother.finish()
    motions = [together.motion]
    while together.moving:
        motions += together.steps(DT, 30)
    for expected, values in zip(rest(separate), zip(*motions, strict=True), strict=True):
        np.testing.assert_allclose(values, expected, atol=1e-9)
    assert not together.violations


def test_stop_comes_to_rest_on_the_path() -> None:
    smoother = Smoother(LIMITS, HOME)
    for point in arc(40):
        smoother.append(point, 0.1)
    free = Smoother(LIMITS, HOME)
    for point in arc(40):
        free.append(point, 0.1)
    path, _, _ = rest(free)
    for _ in range(1000):
        smoother.step(DT)
    smoother.stop()
    assert smoother.points_ahead == 0
    position, velocity, acceleration = rest(smoother)
    assert len(position) * DT < 0.3
    assert_inside(LIMITS, velocity, acceleration)
    assert near(path, position) < 1e-3
    smoother.append(HOME, 1.0)
    position, _, _ = rest(smoother)
    assert np.array_equal(position[-1], HOME)


def test_pause_and_resume_stay_on_the_path() -> None:
    free, paused = Smoother(LIMITS, HOME), Smoother(LIMITS, HOME)
    for point in arc(40):
        free.append(point, 0.05)
        paused.append(point, 0.05)
    path, _, _ = rest(free)
    motions = [paused.step(DT) for _ in range(700)]
    paused.hold()
    motions += [paused.step(DT) for _ in range(1000)]
    assert np.all(motions[-1].velocity == 0.0)
    assert paused.moving
    assert not np.array_equal(motions[-1].position, path[-1])
    paused.resume()
    position, velocity, acceleration = rest(paused)
    assert np.array_equal(position[-1], path[-1])
    assert_inside(
        LIMITS,
        np.vstack([[m.velocity for m in motions], velocity]),
        np.vstack([[m.acceleration for m in motions], acceleration]),
    )
    assert near(path, np.array([m.position for m in motions])) < 2e-3


@pytest.mark.parametrize('known', one_in(2, [3, 40]))
@pytest.mark.parametrize('steps', [0, 1, 2])
def test_resting_arm_does_not_start_during_a_hold(steps: int, known: int) -> None:
    smoother = Smoother(LIMITS, HOME, latency=0.002)
    for point in arc(known):
        smoother.append(point, 0.1)
    smoother.finish()
    for _ in range(steps):
        assert not smoother.step(DT).velocity.any()
    smoother.hold()
    assert smoother.at_rest
    for _ in range(200):
        smoother.step(DT)
        assert np.array_equal(smoother.motion.position, HOME)
    smoother.resume()
    assert np.array_equal(rest(smoother)[0][-1], arc(known)[-1])


@pytest.mark.parametrize('late', [0.0, 1e-17, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5])
@pytest.mark.parametrize('stops', [False, True])
def test_stop_at_the_start_or_end_of_a_plan_has_no_effect(late: float, stops: bool) -> None:
    """The plan starts or ends within rounding of a step."""
    for at_end in (False, True):
        smoother = Smoother(LIMITS, HOME, planner=None)
        point = HOME + 0.2
        smoother.append(point, 0.5)
        smoother.finish()
        request = smoother.request()
        assert request is not None
        answer = plan(request, LIMITS)
        assert answer is not None
        assert smoother.take(answer)
        smoother.step(answer.timing.duration - late if at_end else late)
        here = smoother.motion.position
        if stops:
            smoother.stop()
        else:
            smoother.hold()
        for _ in range(50):
            smoother.step(DT)
        assert smoother.at_rest
        assert np.max(np.abs(smoother.motion.position - here)) < 1e-9
        smoother.resume()
        if stops:
            smoother.append(point)
        smoother.step(0.0)
        while smoother.moving:
            request = smoother.request()
            if request is not None:
                smoother.take(plan(request, LIMITS))
            smoother.step(DT)
        assert np.max(np.abs(smoother.motion.position - point)) < 1e-9


def test_hold_works_without_a_planner() -> None:
    smoother = Smoother(LIMITS, HOME, planner=None)
    for point in arc(60):
        smoother.append(point, 0.05)
    request = smoother.request()
    assert request is not None
    smoother.take(plan(request, LIMITS))
    motions = [smoother.step(DT) for _ in range(300)]
    smoother.hold()
    assert not smoother.at_rest
    motions += [smoother.step(DT) for _ in range(200)]
    assert smoother.at_rest
    assert smoother.request() is None
    _, velocity, acceleration = (np.array(values) for values in zip(*motions, strict=True))
    assert_inside(LIMITS, velocity, acceleration)


def slow(share: float) -> JointLimits:
    return dataclasses.replace(
        LIMITS,
        velocity=share * LIMITS.velocity,
        acceleration=share * LIMITS.acceleration,
        jerk=share * LIMITS.jerk,
    )


@pytest.mark.parametrize(('first', 'then'), [(1.0, 0.05), (0.05, 1.0)])
def test_limits_can_change_at_rest_only(first: float, then: float) -> None:
    free, smoother = Smoother(slow(first), HOME), Smoother(slow(first), HOME)
    points = arc(12, 0.1)
    for point in points:
        free.append(point, 0.05)
        smoother.append(point, 0.05)
    for _ in range(300):
        smoother.step(DT)
    with pytest.raises(RuntimeError, match='can only change while the arm is at rest'):
        smoother.change_limits(slow(then))
    smoother.hold()
    while not smoother.at_rest:
        smoother.step(DT)
    smoother.change_limits(slow(then))
    smoother.resume()
    position, velocity, acceleration = rest(smoother)
    assert_inside(slow(then), velocity, acceleration)
    assert (np.max(np.abs(velocity) / LIMITS.velocity) > 0.05) == (then == 1.0)
    assert np.array_equal(position[-1], points[-1])
    assert near(position, points[-3:]) < np.max(np.abs(velocity)) * DT
    assert near(rest(free)[0], position) < 2e-3


@pytest.mark.parametrize('mode', list(Mode))
@pytest.mark.parametrize('distance', [3e-3, 0.05, 0.4, 1.2])
def test_single_move_takes_as_long_as_point_to_point(distance: float, mode: Mode) -> None:
    target = HOME + distance * np.array([1.0, 0.3, -0.5, 0.2, 0.0, -0.8])
    smoother = Smoother(LIMITS, HOME, mode)
    smoother.append(target)
    smoother.finish()
    position, velocity, acceleration = rest(smoother)
    assert_inside(LIMITS, velocity, acceleration)
    assert np.array_equal(position[-1], target)
    fastest = go(LIMITS, HOME, target).duration
    assert (len(position) - 1) * DT <= 1.001 * fastest + DT


def test_arm_rests_if_a_point_is_repeated_with_a_duration() -> None:
    smoother = Smoother(LIMITS, HOME)
    points = arc(20)
    for point in points[:10]:
        smoother.append(point, 0.1)
    smoother.append(points[9], 0.5)
    for point in points[10:]:
        smoother.append(point, 0.1)
    _, velocity, _ = rest(smoother)
    assert 450 <= interior_stops(velocity) <= 560


def test_finish_ends_a_trajectory_at_rest() -> None:
    smoother = Smoother(LIMITS, HOME)
    points = arc(20)
    for point in points[:10]:
        smoother.append(point, 0.1)
    smoother.finish()
    for point in points[10:]:
        smoother.append(point, 0.1)
    position, velocity, _ = rest(smoother)
    there = int(np.argmin(np.max(np.abs(position - points[9]), axis=1)))
    assert np.all(np.abs(velocity[there]) <= LIMITS.jerk * DT**2)


def test_tiny_steps_are_merged_and_the_last_is_reached() -> None:
    smoother = Smoother(LIMITS, HOME)
    point = HOME.copy()
    for _ in range(30):
        point = point + 0.2 * MERGE_TOLERANCE
        smoother.append(point, 0.02)
        smoother.step(0.02)
    position, _, _ = rest(smoother)
    assert np.max(np.abs(position[-1] - point)) < 1e-9


@pytest.mark.parametrize(
    ('duration', 'passed'), [(None, False), (0.02, False), (0.3, True)], ids=str
)
def test_step_within_the_merge_tolerance_is_executed_only_if_slow(
    duration: float | None, passed: bool
) -> None:
    """A fast step would nearly stop the motion, and omitting a slow one would cause a rest."""
    smoother = Smoother(LIMITS, HOME)
    along, aside = np.zeros(6), np.zeros(6)
    along[0], aside[1] = 0.1, 0.8 * MERGE_TOLERANCE
    for point, time in ((along, 0.2), (along + aside, duration), (2.0 * along, 0.2)):
        smoother.append(HOME + point, time)
    smoother.finish()
    positions, velocities, _ = rest(smoother)
    there = np.abs(positions - (HOME + along + aside)).max(axis=1).min()
    assert (there < 1e-4) == passed
    assert interior_stops(velocities) == 0
    assert np.abs(positions - (HOME + along)).max(axis=1).min() < 1e-3
    assert np.max(np.abs(positions[-1] - (HOME + 2.0 * along))) < 1e-9


@pytest.mark.parametrize('known', one_in(3, [0.2, 0.3, 0.5]))
def test_end_with_merged_points_is_reached_without_a_stop(
    known: float,
) -> None:
    """The last points of a decelerating plan are so close that they are merged."""
    time = np.linspace(0.0, 1.0, 251)[1:, None]
    points = HOME + 0.5 * time**3 * (10.0 - 15.0 * time + 6.0 * time**2)
    smoother = Smoother(LIMITS, HOME)
    velocities = []
    following = 0
    while following < len(points) or smoother.moving:
        while following < len(points) and smoother.look_ahead < known:
            smoother.append(points[following], 0.008)
            following += 1
            if following == len(points):
                smoother.finish()
        velocities.append(smoother.step(DT).velocity)
    assert np.max(np.abs(smoother.motion.position - points[-1])) < 1e-9
    assert interior_stops(np.array(velocities)) == 0


def test_point_near_a_resting_arm_is_reached() -> None:
    smoother = Smoother(LIMITS, HOME)
    near_by = HOME + 1e-4
    smoother.append(near_by, 0.0)
    position, _, _ = rest(smoother)
    for _ in range(200):
        smoother.step(DT)
    assert np.max(np.abs(smoother.motion.position - near_by)) < 1e-9
    assert len(position) > 0


def test_plans_of_an_external_planner_are_used_or_dropped_if_late() -> None:
    """A plan applies from the time of its request. A late plan is dropped."""
    smoother = Smoother(LIMITS, HOME, latency=0.03, planner=None)
    points = arc(60)
    for point in points:
        smoother.append(point, 0.05)
    late = 0
    travelled = []
    pending: list[tuple[int, Plan | None]] = []
    step = 0
    while smoother.moving:
        request = smoother.request()
        if request is not None:
            copy: Request = unpacked(packed(request), PASSED_TYPES)
            answer = unpacked(packed(plan(copy, LIMITS)), PASSED_TYPES)
            pending.append((step + (45 if step % 7 == 0 else 20), answer))
        while pending and pending[0][0] <= step:
            late += not smoother.take(pending.pop(0)[1])
        travelled.append(smoother.step(DT))
        step += 1
        assert step < 10_000
    assert_inside(
        LIMITS,
        np.array([m.velocity for m in travelled]),
        np.array([m.acceleration for m in travelled]),
    )
    assert np.array_equal(smoother.motion.position, points[-1])


def test_arm_rests_at_the_end_of_its_last_plan() -> None:
    smoother = Smoother(LIMITS, HOME, planner=None)
    for point in arc(60):
        smoother.append(point, 0.05)
    request = smoother.request()
    assert request is not None
    assert smoother.take(plan(request, LIMITS))
    for _ in range(10_000):
        if smoother.request() is not None:
            smoother.take(None)
        smoother.step(DT)
    assert np.all(smoother.motion.velocity == 0.0)
    assert smoother.moving, 'there are points left'


def test_unrequested_plan_is_ignored() -> None:
    smoother = Smoother(LIMITS, HOME, planner=None)
    assert not smoother.take(None)
    smoother.append(arc(1)[0], 0.1)
    smoother.step(0.1)
    request = smoother.request()
    assert request is not None
    smoother.stop()
    assert not smoother.take(plan(request, LIMITS))
    assert not smoother.moving


def test_memory_does_not_grow_with_the_stream() -> None:
    smoother = Smoother(LIMITS, HOME, planner=None)
    t = 0.0
    sizes = []
    for _ in range(1000):
        while smoother.look_ahead < 1.0:
            t += 0.02
            smoother.append(HOME + 0.3 * np.sin(t * np.arange(1, 7) / 4.0), 0.02)
        request = smoother.request()
        if request is not None:
            answer = plan(request, LIMITS)
            assert answer is not None
            smoother.take(answer)
            sizes.append(len(packed((request, answer))))
        smoother.step(0.02)
    assert smoother.points_ahead < 60
    assert max(sizes[-10:]) < 2 * max(sizes[:20])


@pytest.mark.parametrize(
    ('position', 'duration', 'sentence'),
    [
        (np.zeros(5), 0.1, r'point 1: shape \(5,\) instead of one number for each of 6 joints'),
        (HOME + np.array([0, 0, np.nan, 0, 0, 0]), 0.1, r'point 1, joint_3: position nan'),
        (
            HOME + np.array([0, 9.0, 0, 0, 0, 0]),
            0.1,
            r'point 1, joint_2: position 8\.5 is outside',
        ),
        (HOME + 0.2, 0.0, r'point 1: duration = 0 s must be positive: joint_\d has 0\.\d+ rad to'),
        (HOME + 0.2, -1.0, r'point 1: duration = -1\.0 s must be'),
        (HOME + 0.2, np.nan, r'point 1: duration = nan s must be'),
        (HOME + 0.2, np.inf, r'point 1: duration = inf s must be'),
    ],
)
def test_invalid_point_is_rejected_without_losing_others(
    position: Array, duration: float, sentence: str
) -> None:
    smoother = Smoother(LIMITS, HOME)
    good = arc(2)
    smoother.append(good[0], 0.1)
    with pytest.raises(ValueError, match=sentence):
        smoother.append(position, duration)
    smoother.append(good[1], 0.1)
    assert np.array_equal(rest(smoother)[0][-1], good[1])


def test_start_outside_the_limits_is_rejected() -> None:
    with pytest.raises(ValueError, match='the start, joint_1: position 9 is outside the limits'):
        Smoother(LIMITS, np.array([9.0, 0, 0, 0, 0, 0]))


def test_a_linear_joint_outside_its_limits_is_reported_in_metres() -> None:
    limits = dataclasses.replace(LIMITS, units=('m', *['rad'] * 5))
    with pytest.raises(ValueError, match=r'joint_1: position 9 is outside .* m$'):
        Smoother(limits, np.array([9.0, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize('dt', [-1.0, -1e-9, np.nan, np.inf])
def test_invalid_time_step_is_rejected_without_effect(dt: float) -> None:
    smoother = Smoother(LIMITS, HOME)
    smoother.append(HOME + 0.2)
    smoother.step(0.1)
    before = smoother.now, smoother.motion
    with pytest.raises(ValueError, match='must be 0 or more'):
        smoother.step(dt)
    assert smoother.now == before[0]
    assert np.array_equal(smoother.motion.position, before[1].position)


def blocks(count, slow):
    """Return blocks: `make test-all` runs the first `slow`, and `make soak` the others."""
    marks = [pytest.mark.slow if block < slow else pytest.mark.soak for block in range(count)]
    return [pytest.param(block, marks=mark) for block, mark in enumerate(marks)]


def check_plans(first: int, last: int) -> None:
    """Check random plans, every tenth sampled at 10 kHz, the others at 1 kHz."""
    for seed in range(first, last):
        assert_within_all_limits(seed, 1e-3 if seed % 10 else 1e-4)


def test_limits_hold_at_every_instant_of_a_plan() -> None:
    check_plans(0, 3)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize('block', blocks(40, slow=1))
def test_limits_hold_at_every_instant_in_2000_plans(block: int) -> None:
    check_plans(1000 + 50 * block, 1050 + 50 * block)


@pytest.mark.parametrize('seed', one_in(2, [0, 1]))
def test_limits_hold_at_every_instant_for_any_sequence_of_requests(seed: int) -> None:
    assert_kept(seed)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize('block', blocks(20, slow=1))
def test_limits_hold_at_every_instant_in_500_scenarios(block: int) -> None:
    for seed in range(100 + 25 * block, 125 + 25 * block):
        assert_kept(seed)
