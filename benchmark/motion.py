# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`make bench-motion`: the smoother against stop-and-go, splines in time, and two optima.

Prints the times of every strategy as ratios, the required values with the worst measured ones
(docs/smoother.md), and the families that are hard to plan. Exit code 0, unless --check is given
and a required value is missed.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import repeat

import numpy as np

from benchmark.cases import Case, Task, run_case
from benchmark.families import FamilyFigures, run_family
from benchmark.family_members import FAMILIES, MEASURED_SEEDS
from benchmark.limit_sets import FACTORS, limit_set, ramp_time
from benchmark.metrics import Metrics
from benchmark.references import References, digest
from benchmark.strategies import SPLINES, STRATEGIES
from benchmark.trajectories import BenchmarkTrajectory, benchmark_set
from epson_driver.report.smooth_study import Figures

MAX_QUICK_POINTS = 60
CYCLE_S = 0.004
"""The controller's cycle, s."""

TOLERANCE_S, TOLERANCE_SHARE = 0.05, 0.02
"""Maximum time by which a point may be passed too early: s, or as a share of the whole time."""

ROUNDING = 1e-6
FASTEST, TIMED = 'time-optimal, all known', 'time-preserving, all known'
LITTLE, LESS = 'time-preserving, 3·A/J known', 'time-preserving, 2·A/J known'
HALF_A_SECOND = 'time-preserving, 0.5 s known'


@dataclass(frozen=True)
class Required:
    """A quantity, its bound, and its values in a case. `mean`: the bound is for the mean."""

    what: str
    most: float
    values: Callable[[Case], Iterator[float]]
    mean: bool = False


def _ratio(
    strategy: str, of: Callable[[Case, Metrics], float], pace: float = 0.0, points: int = 0
) -> Callable[[Case], Iterator[float]]:
    """Return the values of a strategy for cases whose command leaves `pace` times the optimum."""

    def values(case: Case) -> Iterator[float]:
        metrics = case.strategies.get(strategy)
        slow = not pace or (
            case.commanded is not None
            and case.commanded - case.rests >= pace * case.references.spline
        )
        if metrics is not None and slow and case.points >= points:
            yield of(case, metrics)

    return values


def _every(quantity: str, unit: float = 1.0) -> Callable[[Case], Iterator[float]]:
    """Return a quantity of every run, cut streams included."""

    def values(case: Case) -> Iterator[float]:
        runs = [*case.strategies.values(), *case.cut_streams.values()]
        yield from (float(getattr(metrics, quantity)) / unit for metrics in runs)

    return values


def _stops(case: Case) -> Iterator[float]:
    """Yield the stops of the runs with 3·A/J or more known."""
    limits = limit_set(case.limits)
    for name, metrics in case.strategies.items():
        ahead = STRATEGIES[name].look_ahead
        if ahead is None or ahead(limits) >= 3.0 * ramp_time(limits) - ROUNDING:
            yield float(metrics.stops)


def _optimum(case: Case, metrics: Metrics) -> float:
    return metrics.duration / case.references.opt


def _commanded(case: Case, metrics: Metrics) -> float:
    return metrics.duration / (case.commanded or np.nan)


def _all_known(case: Case, metrics: Metrics) -> float:
    return metrics.duration / case.strategies[TIMED].duration


def _early(case: Case, metrics: Metrics) -> float:
    return metrics.early / max(TOLERANCE_S, TOLERANCE_SHARE * (case.commanded or np.nan))


REQUIRED = (
    Required(
        'time / point to point, fastest, 50 points or more',
        0.25,
        _ratio(FASTEST, lambda case, m: m.duration / case.references.ptp, points=50),
    ),
    Required('time / optimum, fastest', 1.10, _ratio(FASTEST, _optimum)),
    Required('the same, mean', 1.04, _ratio(FASTEST, _optimum), mean=True),
    Required('time / commanded from 1.5 · optimum on', 1.10, _ratio(TIMED, _commanded, 1.5)),
    Required('time / commanded from 1.2 · optimum on', 1.20, _ratio(TIMED, _commanded, 1.2)),
    Required('with 0.5 s known, from 1.5 on', 1.10, _ratio(HALF_A_SECOND, _commanded, 1.5)),
    Required('with 0.5 s known, from 1.2 on', 1.20, _ratio(HALF_A_SECOND, _commanded, 1.2)),
    Required('a point too early / 50 ms or 2 %', 1.0, _ratio(TIMED, _early, 1.2)),
    Required('time with 3·A/J / all known', 1.10, _ratio(LITTLE, _all_known, 1.2)),
    Required('time with 2·A/J / all known', np.inf, _ratio(LESS, _all_known, 1.2)),
    Required('velocity / limit', 1.0 + ROUNDING, _every('velocity')),
    Required('acceleration / limit', 1.0 + ROUNDING, _every('acceleration')),
    Required('jerk / limit', 1.02, _every('jerk')),
    Required('stops not commanded, 3·A/J known', 0.0, _stops),
    Required('beside a waypoint [rad]', 1e-5, _every('waypoint')),
    Required('past the last known point [rad]', 1e-9, _every('overrun')),
    Required('from the last known point at the end [rad]', 1e-9, _every('end')),
    Required('outside the position limits [rad]', 1e-9, _every('outside')),
    Required('v, a against positions / limit', 5e-3, _every('mismatch')),
    Required('a step, 99th percentile / 4 ms', 0.10, _every('step_p99', CYCLE_S)),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    args = _arguments(arguments)
    part = args.only or args.limits or args.quick
    families = [] if part else list(FAMILIES)
    with ProcessPoolExecutor(2) as pool:
        cases = _cases(pool, _chosen(args), args)
        runs = list(pool.map(run_family, families, repeat(MEASURED_SEEDS)))
    for line in (*summary(cases), ''):
        print(line)
    missed = [text for case in cases for text in case.errors]
    for line, met in judged(cases):
        print(line)
        missed += [] if met else [line]
    for figures in runs:
        print(_family(figures))
        missed += figures.missed
    print(f'MISSED: {len(missed)}' if missed else 'all that is required is met')
    return 1 if args.check and missed else 0


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark.motion', description=__doc__)
    parser.add_argument('--only', metavar='NAME', default='', help='trajectories named like this')
    parser.add_argument('--limits', choices=FACTORS, help='only one set of limits')
    parser.add_argument('--quick', action='store_true', help='short ones, at full limits')
    parser.add_argument('--check', action='store_true', help='exit 1 if a value is missed')
    return parser.parse_args(arguments)


def _chosen(args: argparse.Namespace) -> list[BenchmarkTrajectory]:
    chosen = [
        trajectory
        for trajectory in benchmark_set()
        if args.only in trajectory.name
        if not args.quick or len(trajectory.positions) <= MAX_QUICK_POINTS
    ]
    if not chosen:
        sys.exit('no trajectory has such a name')
    return chosen


def _cases(
    pool: ProcessPoolExecutor, trajectories: list[BenchmarkTrajectory], args: argparse.Namespace
) -> list[Case]:
    stored = References()
    sets = [args.limits] if args.limits else ['full'] if args.quick else list(FACTORS)
    tasks = [
        Task(trajectory, name, stored[digest(trajectory.positions, limit_set(name))])
        for name in sets
        # the longest first, so that the last process does not run it alone
        for trajectory in sorted(trajectories, key=lambda one: -(one.commanded or 0.0))
    ]
    jobs = [pool.submit(run_case, task) for task in tasks]
    for count, job in enumerate(as_completed(jobs), 1):
        case = job.result()
        errors = ''.join(f'\n  {text}' for text in case.errors)
        print(f'{count}/{len(jobs)} {case.name}, {case.limits}{errors}', flush=True)
    return [job.result() for job in jobs]


def summary(cases: list[Case]) -> Iterator[str]:
    """Yield a line per strategy: times as mean and worst ratio, use of the limits, stops."""
    heads = ('/ pt to pt', '/ optimum', '/ commanded')
    yield f'{"":50} {" ".join(f"{head:>14}" for head in heads)} v, a, j / limit, stops'
    for name in (*SPLINES, *STRATEGIES):
        runs: list[tuple[Case, Metrics | Figures]] = [
            (case, result)
            for case in cases
            if (result := case.strategies.get(name) or case.splines.get(name)) is not None
        ]
        if not runs:
            continue
        ratios = (
            _pair(
                [
                    metrics.duration / by(case)
                    for case, metrics in runs
                    if case.commanded or by is not _command
                ]
            )
            for by in (
                lambda case: case.references.ptp,
                lambda case: case.references.opt,
                _command,
            )
        )
        uses = (
            f'{max(getattr(metrics, use) for _, metrics in runs):.3g}'
            for use in ('velocity', 'acceleration', 'jerk')
        )
        stops = sum(getattr(metrics, 'stops', 0) for _, metrics in runs)
        title = f'spline in time, {name}' if name in SPLINES else name
        yield f'{title:50} {" ".join(ratios)} {", ".join(uses)}, {stops}'


def _command(case: Case) -> float:
    return case.commanded or np.nan


def _pair(ratios: list[float]) -> str:
    """Return the geometric mean and the largest."""
    text = f'{np.exp(np.mean(np.log(ratios))):.3f} / {max(ratios):.3f}' if ratios else '-'
    return f'{text:>14}'


def judged(cases: list[Case]) -> Iterator[tuple[str, bool]]:
    """Yield a line for each required value, and whether it is met."""
    for item in REQUIRED:
        result = [
            (value, f'{case.name}, {case.limits}') for case in cases for value in item.values(case)
        ]
        if not result:
            yield f'{item.what:50} not measured', False
            continue
        worst, where = max(result)
        mean = float(np.mean([value for value, _ in result]))
        met = (mean if item.mean else worst) <= item.most
        mark = '' if met else '  MISSED'
        yield (
            (
                f'{item.what:50} required {item.most:<8.4g} worst {worst:<9.4g} mean {mean:<9.4g} '
                f'{where}{mark}'
            ),
            met,
        )


def _family(figures: FamilyFigures) -> str:
    return (
        f'{figures.name:20} {figures.plans} plans, {100.0 * figures.failed_share:.1f} % failed, '
        f'{figures.stops} stops, {figures.time_ratio:.2f} · point to point, '
        f'{figures.commanded_ratio:.2f} · commanded, plan {1e3 * figures.plan_median:.0f} ms '
        f'(p99 {1e3 * figures.plan_p99:.0f} ms): {", ".join(figures.missed) or "all met"}'
    )


if __name__ == '__main__':
    sys.exit(main())
