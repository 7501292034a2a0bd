# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Steps of 1 mrad to 1 rad in one trajectory: plans are found, and delays are made up for.

Invariant 2 of docs/invariants.md: what is found for them keeps every limit as well.
"""

import numpy as np
import pytest

from benchmark.family_members import FamilyMember, members
from benchmark.limit_sets import ramp_time
from benchmark.stop_and_go import stop_and_go
from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import Mode, Smoother, planner
from epson_driver.motion.smoother.limit_usage import limit_usage
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.request import Plan, Request

CYCLE_S = 0.004
MAX_MOTION_S = 30.0

pytestmark = pytest.mark.invariant(2)


def member(seed: int) -> FamilyMember:
    """Return a trajectory of mixed sizes."""
    return next(members('mixed_sizes', [seed]))


def move(
    limits: JointLimits, positions: np.ndarray, durations: np.ndarray | None, known: float
) -> tuple[float, list[Plan | None]]:
    """Return how long a motion takes, s, and the plans asked for; what is found is verified."""
    plans: list[Plan | None] = []

    def checked(request: Request, limits: JointLimits) -> Plan | None:
        found = planner.plan(request, limits)
        assert found is None or limit_usage(Path(found.knots), found.timing, limits).allowed
        plans.append(found)
        return found

    mode = Mode.TIME_OPTIMAL if durations is None else Mode.TIME_PRESERVING
    smoother = Smoother(limits, positions[0], mode, planner=checked)
    fed = 1
    while fed < len(positions) or smoother.moving:
        while fed < len(positions) and smoother.look_ahead < known:
            smoother.append(positions[fed], None if durations is None else durations[fed - 1])
            fed += 1
            if fed == len(positions):
                smoother.finish()
        smoother.step(CYCLE_S)
        assert smoother.now < MAX_MOTION_S
    assert smoother.violations == 0
    assert smoother.planner_errors == 0
    return smoother.now, plans


@pytest.mark.parametrize('seed', [2129])
def test_no_bend_makes_a_motion_slower_than_stops_at_every_point(seed: int) -> None:
    """One slow move along all of the path took 1.6 times as long as stopping at each point."""
    of = member(seed)
    stops = stop_and_go(of.positions, of.limits).duration
    taken, plans = move(of.limits, of.positions, None, np.inf)
    assert taken < stops
    assert plans.count(None) <= 0.1 * len(plans)


@pytest.mark.slow
@pytest.mark.parametrize('seed', [2078, 2080])
def test_a_delay_at_sharp_corners_is_made_up_for_with_little_known(seed: int) -> None:
    """With 3·A/J known: half again the commanded speed where a quarter more is not enough."""
    of = member(seed)
    fastest, _ = move(of.limits, of.positions, None, np.inf)
    durations = np.max(np.abs(np.diff(of.positions, axis=0)) / of.limits.velocity, axis=1)
    durations = np.maximum(2.0 * durations, CYCLE_S)
    durations *= 1.25 * fastest / durations.sum()
    taken, plans = move(of.limits, of.positions, durations, 3.0 * ramp_time(of.limits))
    assert taken / durations.sum() <= 1.2
    assert plans.count(None) <= 0.1 * len(plans)
