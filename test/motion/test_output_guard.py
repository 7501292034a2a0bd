# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The output guard: a wrong plan ends with a stop within all limits.

Invariants 2, 3 and 9 of docs/invariants.md.
"""

import dataclasses
import logging
from collections.abc import Callable

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import ARM, random_run

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Plan, Request, Smoother, plan
from epson_driver.motion.smoother.output_guard import Motion, OutputGuard
from epson_driver.motion.smoother.path import Knots
from epson_driver.motion.time_parametrisation import TimeParametrisation

pytestmark = pytest.mark.invariant(2, 3, 9)

DT = 1e-3
FAR = np.array([1.0, -0.8, 0.6, 0.9, 0.7, -0.5])


def too_fast(timing: TimeParametrisation) -> TimeParametrisation:
    """Return a timing at double speed."""
    return TimeParametrisation(
        timing.times / 2.0, timing.positions, timing.velocities * 2.0, timing.accelerations * 4.0,
        timing.jerks * 8.0,
    )  # fmt: skip


def displaced(knots: Knots) -> Knots:
    return dataclasses.replace(knots, position=knots.position + 0.01)


def no_number(knots: Knots) -> Knots:
    return dataclasses.replace(knots, first=knots.first * np.nan)


def outside(knots: Knots) -> Knots:
    """Return the knots with the last one far outside the position limits."""
    position = knots.position.copy()
    position[-1] += 20.0
    return dataclasses.replace(knots, position=position)


FAULTS: dict[str, Callable[[Plan], Plan]] = {
    'too fast': lambda good: dataclasses.replace(good, timing=too_fast(good.timing)),
    'a jump': lambda good: dataclasses.replace(good, knots=displaced(good.knots)),
    'no number': lambda good: dataclasses.replace(good, knots=no_number(good.knots)),
    'outside': lambda good: dataclasses.replace(good, knots=outside(good.knots)),
}


def assert_kept(positions: list[Array], limits: JointLimits = ARM) -> None:
    q = np.array([positions[0]] * 3 + positions)
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    for order, bound in enumerate(bounds, start=1):
        differences = np.abs(np.diff(q, order, axis=0)) / DT**order
        assert np.all(differences <= bound * 1.001), order
    assert np.all((q >= limits.position_min) & (q <= limits.position_max))


@pytest.mark.parametrize('which', one_in(2, [1, 4]))
@pytest.mark.parametrize('fault', FAULTS)
def test_wrong_plan_ends_with_a_stop_within_all_limits(
    fault: str, which: int | None, caplog: pytest.LogCaptureFixture
) -> None:
    plans = 0

    def planner(request: Request, limits: JointLimits) -> Plan | None:
        nonlocal plans
        plans += 1
        good = plan(request, limits)
        wrong = good is not None and which is not None and plans >= which
        return FAULTS[fault](good) if wrong else good

    smoother = Smoother(ARM, np.zeros(6), planner=planner)
    positions = [np.zeros(6)]
    points = iter(np.linspace(0.0, 1.0, 40)[1:, None] * FAR + 0.02 * np.sin(np.arange(6)))
    with caplog.at_level(logging.ERROR):
        for _ in range(5000):
            if not smoother.violations and smoother.look_ahead < 0.3:
                point = next(points, None)
                if point is not None:
                    smoother.append(point, 0.05)
            positions.append(smoother.step(DT).position)
            if smoother.violations and not smoother.moving:
                break
    assert smoother.violations == 1
    assert not smoother.moving
    assert smoother.points_ahead == 0
    violation = smoother.violation
    assert violation is not None
    assert violation.joint in ARM.names
    assert str(violation) in caplog.text
    assert 'joint_' in str(violation)
    assert 'beyond the limit' in str(violation)
    assert_kept(positions)
    # the next motion works
    which = None
    goal = positions[-1] + 0.1
    smoother.append(goal)
    smoother.finish()
    while smoother.moving:
        positions.append(smoother.step(DT).position)
    assert positions[-1] == pytest.approx(goal, abs=1e-9)
    assert smoother.violations == 1
    assert_kept(positions)


def bound_motions(jerks: Array, dt: float) -> list[Motion]:
    """Return outputs every dt of a motion with constant jerks for dt / 4 each, shape (4 k, n)."""
    q, v, a = np.zeros((3, jerks.shape[1]))
    motions = [Motion(q, v, a)]
    t = dt / 4.0
    for index, jerk in enumerate(jerks):
        q = q + t * (v + t * (a / 2.0 + t * jerk / 6.0))
        v = v + t * (a + t * jerk / 2.0)
        a = a + t * jerk
        if index % 4 == 3:
            motions.append(Motion(q, v, a))
    return motions


@pytest.mark.parametrize('dt', [1e-4, 1e-3, 4e-3])
def test_motion_within_the_jerk_limit_passes_the_guard(dt: float) -> None:
    """The bounds follow from the jerk limit for any motion between two outputs."""
    rng = np.random.default_rng(1)
    steps = rng.choice([-1.0, 1.0], (4000, 6)) * ARM.jerk
    motions = bound_motions(steps, dt)
    wide = dataclasses.replace(
        ARM, position_min=np.full(6, -1e9), position_max=np.full(6, 1e9),
        velocity=np.full(6, 1e9), acceleration=np.full(6, 1e9),
    )  # fmt: skip
    guard = OutputGuard(motions[0])
    # the rounding tolerance scales with the limits, so it is irrelevant here
    guard_limits = dataclasses.replace(
        wide, velocity=ARM.velocity * 1e3, acceleration=ARM.acceleration * 1e3
    )
    together = Motion(*map(np.array, zip(*motions[1:], strict=True)))
    assert OutputGuard(motions[0]).allows(together, dt, guard_limits)
    for motion in motions[1:]:
        assert guard.violation(motion, dt, guard_limits) is None


@pytest.mark.parametrize(
    ('quantity', 'change'),
    [
        ('position', lambda q, v, a: (q + 10.0, v, a)),
        ('position', lambda q, v, a: (q - 10.0, v, a)),
        ('velocity', lambda q, v, a: (q, ARM.velocity * 1.01, a)),
        ('acceleration', lambda q, v, a: (q, v, -ARM.acceleration * 1.01)),
        ('change of acceleration', lambda q, v, a: (q, v, a + ARM.jerk * DT * 1.01)),
        ('change of velocity', lambda q, v, a: (q, v + ARM.jerk * DT**2, a)),
        ('change of position', lambda q, v, a: (q + 1e-6 + ARM.jerk * DT**3 / 7.0, v, a)),
        ('position', lambda q, v, a: (q * np.nan, v, a)),
        ('acceleration', lambda q, v, a: (q, v, a * np.nan)),
    ],
)
def test_violation_is_named_by_its_quantity(
    quantity: str, change: Callable[..., tuple[Array, ...]]
) -> None:
    still = Motion(np.zeros(6), np.zeros(6), np.zeros(6))
    guard = OutputGuard(still)
    wrong = Motion(*change(*still))
    for order in ((wrong, still), (still, wrong)):
        assert not guard.allows(Motion(*map(np.array, zip(*order, strict=True))), DT, ARM)
    violation = guard.violation(wrong, DT, ARM)
    assert violation is not None
    assert violation.quantity.startswith(quantity)
    assert guard.last is still


@pytest.mark.parametrize(
    'seeds', [range(200, 202), pytest.param(range(202, 206), marks=pytest.mark.slow)]
)
@pytest.mark.parametrize('dt', [pytest.param(1e-3, marks=pytest.mark.slow), 4e-3, 0.02, 0.1])
def test_steps_of_any_length_cause_no_false_alarm(dt: float, seeds: range) -> None:
    for seed in seeds:
        assert random_run(seed, dt).smoother.violations == 0
