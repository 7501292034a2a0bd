# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Plans that branch off the current plan, the effort of a plan, and feasible times.

Invariant 2 of docs/invariants.md: plans of every kind respect all limits.
"""

import numpy as np
import pytest
from support.smoother_harness import ARM

from benchmark.family_members import FamilyMember, inside, members, splined
from benchmark.limit_sets import limit_set
from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import Mode, Smoother, planner
from epson_driver.motion.smoother.limit_usage import limit_usage
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.planner import BRANCH
from epson_driver.motion.smoother.request import MAX_EFFORT_US, Effort, Plan, Problem, Request
from epson_driver.motion.time_parametrisation import TimeParametrisation, from_pieces
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

CYCLE_S = 0.004
MAX_MOTION_S = 60.0

pytestmark = pytest.mark.invariant(2)


def move(
    limits: JointLimits,
    positions: np.ndarray,
    durations: np.ndarray | None,
    look_ahead: float = np.inf,
) -> tuple[float, list[tuple[Request, Plan | None]]]:
    """Return a motion's duration, s, and its plans with their requests."""
    answers: list[tuple[Request, Plan | None]] = []

    def recorded(request: Request, limits: JointLimits) -> Plan | None:
        answers.append((request, planner.plan(request, limits)))
        return answers[-1][1]

    mode = Mode.TIME_OPTIMAL if durations is None else Mode.TIME_PRESERVING
    smoother = Smoother(limits, positions[0], mode, planner=recorded)
    fed = 1
    while fed < len(positions) or smoother.moving:
        while fed < len(positions) and smoother.look_ahead < look_ahead:
            duration = None if durations is None else float(durations[fed - 1])
            smoother.append(positions[fed], duration)
            fed += 1
            if fed == len(positions):
                smoother.finish()
        smoother.step(CYCLE_S)
        assert smoother.now < MAX_MOTION_S
    assert smoother.violations == 0
    return smoother.now, answers


def to_and_fro() -> FamilyMember:
    """Return a back-and-forth motion of one joint with steps of any size."""
    return list(members('single_joint'))[2]


def test_plan_branches_off_the_current_plan_if_no_new_plan_is_found() -> None:
    member = to_and_fro()
    _, answers = move(member.limits, member.positions, None, 0.3)
    missing = [request for request, plan in answers if plan is None]
    assert len(missing) <= 0.02 * len(answers)
    branched = [
        (request, plan)
        for request, plan in answers
        if plan is not None and plan.proposer == BRANCH
    ]
    assert branched
    for request, plan in branched:
        assert request.current_timing is not None
        assert request.current_knots is not None
        start = plan.timing.at(0.0)
        assert start == pytest.approx(request.state)
        assert limit_usage(Path(plan.knots), plan.timing, member.limits).allowed
        assert len(plan.knots.u) > len(request.current_knots.u), 'longer than the current plan'


@pytest.mark.parametrize('name', ['single_joint', 'close_pairs', 'mixed_sizes'])
def test_plan_stays_within_its_effort(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    spent: list[float] = []
    spend = Effort.spend

    def counted(effort: Effort, more: float) -> None:
        spent[-1] += more
        spend(effort, more)

    def started(request: Request, limits: JointLimits) -> Plan | None:
        spent.append(0.0)
        return planner.plan(request, limits)

    monkeypatch.setattr(Effort, 'spend', counted)
    member = list(members(name))[5]
    smoother = Smoother(member.limits, member.positions[0], Mode.TIME_OPTIMAL, planner=started)
    for position in member.positions[1:]:
        smoother.append(position)
    smoother.finish()
    while smoother.moving:
        smoother.step(CYCLE_S)
        assert smoother.now < MAX_MOTION_S
    # the last step and verification of each part may exceed the effort
    assert 0.0 < max(spent) <= 1.25 * MAX_EFFORT_US


@pytest.mark.parametrize('pace', [1.2, 1.22, 1.3, 1.5])
@pytest.mark.parametrize(
    'stations', [(0.0, 0.5), (0.0, 0.1, 0.9), (0.0, 0.3, 0.6, 0.9), (0.0, 0.05, 0.1)]
)
def test_short_move_takes_its_commanded_time_if_feasible(
    stations: tuple[float, ...], pace: float
) -> None:
    """25 % above the commanded speed does not compensate for the ramps of a short move."""
    positions = np.zeros((len(stations), 6))
    positions[:, 0] = stations
    fastest, _ = move(ARM, positions, None)
    lengths = np.diff(stations)
    durations = pace * fastest * lengths / lengths.sum()
    duration, _ = move(ARM, positions, durations)
    assert duration / durations.sum() <= 1.2


def test_every_plan_through_10_000_points_is_found() -> None:
    """They are 0.2 ms apart. The effort of a plan does not grow with their number."""
    rng, limits = np.random.default_rng(2), limit_set('full')
    poses = np.array([inside(rng, limits, 0.6) for _ in range(8)])
    _, answers = move(limits, splined(poses, 10_000), None, 1.0)
    assert all(plan is not None for _, plan in answers)


def test_horizon_after_a_long_slow_segment_is_as_long_as_elsewhere() -> None:
    """The horizon starts at the arm, not at the start of that segment."""
    known = 0.5
    positions = np.zeros((30, 6))
    positions[1:, 0] = 0.9 + 0.02 * np.arange(29)
    durations = np.append(2.0, np.full(28, 0.04))
    _, answers = move(ARM, positions, durations, known)
    moving = [request for request, _ in answers if len(request.knots.u) > 1]
    assert len(moving) > 3
    for request in moving:
        now = float(np.interp(request.state[0], request.knots.u, request.clock[:2]))
        assert request.clock[-1] - now > 0.8 * min(known, float(durations.sum()) - now)


def test_plan_to_points_beyond_the_horizon_is_no_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Points merged into the last one can delay it beyond the horizon of a plan."""
    smoother = Smoother(ARM, np.zeros(6), Mode.TIME_PRESERVING)
    for number in range(1, 11):
        smoother.append(np.full(6, 0.02 * number), 0.05)
    smoother.step(CYCLE_S)
    smoother.step(CYCLE_S)
    monkeypatch.setattr(planner.optimal, 'propose', lambda *_, **__: None)
    for _ in range(150):
        smoother.append(np.full(6, 0.2), 0.009)
    while smoother.moving:
        smoother.step(CYCLE_S)
        assert smoother.now < MAX_MOTION_S
    assert smoother.planner_errors == 0
    assert smoother.motion.position == pytest.approx(np.full(6, 0.2))


def test_straight_plan_from_rest_is_the_fallback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(planner.optimal, 'propose', lambda *_, **__: None)
    on_border = np.append(ARM.position_max[:1], np.full(5, 0.3))
    smoother = Smoother(ARM, np.zeros(6), planner=None)
    smoother.append(on_border)
    smoother.finish()
    request = smoother.request()
    assert request is not None
    result = planner.plan(request, ARM)
    assert result is not None
    assert result.proposer == 'straight'
    assert result.timing.end > 0.0
    assert limit_usage(Path(result.knots), result.timing, ARM).allowed


def test_resumed_arm_follows_its_path_if_the_search_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    smoother = Smoother(ARM, np.zeros(6))
    for turn in (0.2, 0.4, 0.3):
        smoother.append(np.full(6, turn), 0.5)
    smoother.finish()
    while smoother.points_ahead > 2:
        smoother.step(CYCLE_S)
    smoother.hold()
    while not smoother.at_rest:
        smoother.step(CYCLE_S)
        assert smoother.now < MAX_MOTION_S
    smoother.resume()
    request = smoother.request()
    assert request is not None
    assert len(request.knots.u) == 2, 'at rest between two knots'
    monkeypatch.setattr(planner.optimal, 'propose', lambda *_, **__: None)
    result = planner.plan(request, ARM)
    assert result is not None
    assert result.proposer == 'simple'
    assert result.timing.at(0.0) == request.state
    assert limit_usage(Path(result.knots), result.timing, ARM).allowed


def test_plan_from_rest_is_found_without_remaining_effort(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def in_vain(problem: Problem, *_: object, **__: object) -> None:
        problem.effort.spend(problem.effort.left)

    smoother = Smoother(ARM, np.zeros(6), Mode.TIME_OPTIMAL, planner=None)
    for turn in (0.2, 0.4, 0.3):
        smoother.append(np.full(6, turn))
    smoother.finish()
    monkeypatch.setattr(planner.optimal, 'propose', in_vain)
    request = smoother.request()
    assert request is not None
    assert smoother.take(planner.plan(request, ARM))


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'limits', 'duration'),
    [
        ('pick_and_place_20ms', 'half', 5.4),
        ('shuttle_1000_points', 'half', 12.0),
        ('shuttle_1000_points', 'full', 7.6),
    ],
)
def test_long_plans_without_times_are_not_split(name: str, limits: str, duration: float) -> None:
    """duration: approximate optimum, s. Split plans took 1.7 times as long."""
    positions = read_trajectory(share_path('config', 'trajectories', f'{name}.yaml')).positions
    needed, _ = move(limit_set(limits), positions, None)
    assert needed < 1.3 * duration


def sampled() -> TimeParametrisation:
    """Return a timing of four pieces."""
    return from_pieces(
        (0.3, 0.0, 0.0), np.array([0.1, 0.1, 0.1, 0.1]), np.array([10.0, -10.0, -10.0, 10.0])
    )


@pytest.mark.parametrize('begin', [0.0, 0.05, 0.1, 0.37])
def test_part_of_a_timing_equals_the_timing(begin: float) -> None:
    whole = sampled()
    part = whole.part(begin)
    assert part is not None
    for time in np.linspace(0.0, part.duration, 23):
        assert part.at(float(time)) == pytest.approx(whole.at(begin + float(time)), abs=1e-14)


def test_joined_parts_reproduce_the_timing() -> None:
    whole = sampled()
    head, tail = whole.part(0.0, 0.13), whole.part(0.13)
    assert head is not None
    assert tail is not None
    again = head.then(tail)
    assert again.duration == pytest.approx(whole.duration)
    for time in np.linspace(0.0, whole.duration, 50):
        assert again.at(float(time)) == pytest.approx(whole.at(float(time)), abs=1e-14)


def test_empty_part_of_a_timing_is_none() -> None:
    whole = sampled()
    assert whole.part(0.0, 0.0) is None
    assert whole.part(whole.duration) is None
