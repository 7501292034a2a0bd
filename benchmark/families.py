# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs families of trajectories and counts failed plans, stops, violations and times.

The criterion is not the time of one trajectory, but whether the smoother keeps its guarantees for
all of them: the limits by exact extrema, no rest that was not commanded, never slower than point
to point, and commanded times kept where they are feasible.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from benchmark.exact_extrema import Recorded, exact_extrema
from benchmark.family_members import WORK_SEEDS, FamilyMember, members
from benchmark.limit_sets import ramp_time
from benchmark.metrics import stops
from benchmark.strategies import stop_and_go
from benchmark.waypoints import Record
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode
from epson_driver.motion.smoother.planner import plan
from epson_driver.motion.smoother.request import Plan, Request

SAMPLE_STEP_S = 0.001

MAX_MOTION_S = 120.0
"""Maximum duration of a motion, s. A longer one has failed."""

KEYS = ('position', 'velocity', 'acceleration')

KNOWN_AHEAD = 3.0
"""Known time ahead in the runs without the whole trajectory, in units of A/J."""

COMMANDED_PACE = 2.0
"""Commanded duration, as a multiple of the slowest joint's time at full speed …"""

MIN_DURATION_S = 0.004
"""… and at least this, s. In every other trajectory …"""

COMMANDED_RATIO = 1.25
"""… all durations are scaled so that their sum is this multiple of the time-optimal run."""

FEASIBLE_RATIO = 1.2
"""Commanded time, as a multiple of the time-optimal run, from which it should be kept, to the same
ratio."""


LIMIT_TOLERANCE_SHARE, POSITION_TOLERANCE_RAD = 1e-6, 1e-10
"""Tolerances for rounding."""

MAX_PLAN_S = 0.06
"""Maximum 99th percentile of the CPU time of a plan, s."""


@dataclass
class FamilyFigures:
    """Results of a family's runs.

    plans: number of requests. failed: number of requests without a plan. stops: rests that are at
    neither end of a motion. time_ratio: worst time of a time-optimal run with all known / point to
    point. commanded_ratio: worst time / commanded time where that was feasible, or 0. velocity,
    acceleration, jerk: largest multiple of the limit, by exact extrema. outside: distance outside
    the position limits, rad. unfinished: runs without an end. violations: limit violations seen by
    the smoother's own guard. plan_median, plan_p99: CPU time of a plan, s.
    """

    name: str
    plans: int = 0
    failed: int = 0
    stops: int = 0
    time_ratio: float = 0.0
    commanded_ratio: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    outside: float = 0.0
    unfinished: int = 0
    violations: int = 0
    plan_median: float = 0.0
    plan_p99: float = 0.0

    @property
    def failed_share(self) -> float:
        """The share of plans that failed."""
        return self.failed / max(self.plans, 1)

    @property
    def missed(self) -> list[str]:
        """The requirements that were missed."""
        worst = max(self.velocity, self.acceleration, self.jerk)
        return [
            text
            for text, value, most in (
                (f'{100.0 * self.failed_share:.1f} % failed plans', self.failed_share, 0.02),
                (f'{self.stops} stops', self.stops, 0),
                (f'{self.unfinished} runs without an end', self.unfinished, 0),
                (f'{self.violations} violations', self.violations, 0),
                (f'{self.time_ratio:.3f} · point to point', self.time_ratio, 1.0),
                (f'{self.commanded_ratio:.3f} · commanded', self.commanded_ratio, 1.2),
                (f'{worst:.6f} · a limit', worst, 1.0 + LIMIT_TOLERANCE_SHARE),
                (f'{self.outside:.1e} rad outside', self.outside, POSITION_TOLERANCE_RAD),
                (f'a plan takes {1e3 * self.plan_p99:.0f} ms', self.plan_p99, MAX_PLAN_S),
            )
            if value > most
        ]

    def raise_to(self, **values: float) -> None:
        """Update with larger values."""
        for name, value in values.items():
            setattr(self, name, max(getattr(self, name), value))


class _Counting:
    """The planner with counters and timing."""

    def __init__(self, figures: FamilyFigures) -> None:
        self.figures = figures
        self.costs: list[float] = []

    def __call__(self, request: Request, limits: JointLimits) -> Plan | None:
        began = time.process_time()
        result = plan(request, limits)
        self.costs.append(time.process_time() - began)
        self.figures.plans += 1
        self.figures.failed += result is None
        return result


def run_family(name: str, seeds: Iterable[int] = WORK_SEEDS) -> FamilyFigures:
    """Run every trajectory of a family three times: see `_run_member`."""
    figures = FamilyFigures(name)
    planner = _Counting(figures)
    for number, member in enumerate(members(name, seeds)):
        _run_member(member, bool(number % 2), planner)
    figures.plan_median, figures.plan_p99 = np.percentile(planner.costs, (50.0, 99.0)).tolist()
    return figures


def _run_member(member: FamilyMember, feasible: bool, planner: _Counting) -> None:
    """Run a trajectory time-optimal with all known and with little known, then time-preserving.

    feasible: whether the commanded times are long enough.
    """
    figures, little = planner.figures, KNOWN_AHEAD * ramp_time(member.limits)
    ways = np.max(np.abs(np.diff(member.positions, axis=0)) / member.limits.velocity, axis=1)
    durations = np.maximum(COMMANDED_PACE * ways, MIN_DURATION_S)
    fastest = _run(member, Mode.TIME_OPTIMAL, durations, np.inf, planner)
    reference = stop_and_go(member.positions, member.limits).duration
    figures.raise_to(time_ratio=fastest / reference)
    _run(member, Mode.TIME_OPTIMAL, durations, little, planner)
    if feasible:
        durations *= COMMANDED_RATIO * fastest / durations.sum()
    commanded = float(durations.sum())
    taken = _run(member, Mode.TIME_PRESERVING, durations, little, planner)
    if commanded >= FEASIBLE_RATIO * fastest:
        figures.raise_to(commanded_ratio=taken / commanded)


def _run(
    member: FamilyMember,
    mode: Mode,
    durations: Array,
    known: float,
    planner: _Counting,
) -> float:
    """Return the duration of one motion, s, and count its events."""
    positions, limits, figures = member.positions, member.limits, planner.figures
    smoother = Recorded(limits, positions[0], mode, planner=planner)
    fed = 1
    rows = [smoother.motion]
    while fed < len(positions) or smoother.moving:
        while fed < len(positions) and smoother.look_ahead < known:
            smoother.append(positions[fed], float(durations[fed - 1]))
            fed += 1
            if fed == len(positions):
                smoother.finish()
        rows.append(smoother.step(SAMPLE_STEP_S))
        if smoother.now > MAX_MOTION_S:
            figures.unfinished += 1
            break
    q, v, a = (np.array([getattr(row, key) for row in rows]) for key in KEYS)
    none = np.zeros(0)
    record = Record(SAMPLE_STEP_S, q, v, a, none, none.astype(np.bool_))
    figures.stops += len(stops(record, limits))
    figures.violations += smoother.violations
    exact = exact_extrema(smoother, positions[0])
    figures.raise_to(
        velocity=exact.velocity,
        acceleration=exact.acceleration,
        jerk=exact.jerk,
        outside=exact.outside,
    )
    return smoother.now
