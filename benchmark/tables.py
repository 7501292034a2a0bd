# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The benchmark's figures as Markdown."""

from collections.abc import Iterable, Sequence

import numpy as np

from benchmark.baselines import SPLINES
from benchmark.cases import Case
from benchmark.families import FamilyFigures
from benchmark.family_members import FAMILIES
from benchmark.metrics import Metrics
from benchmark.strategies import STRATEGIES
from benchmark.targets import Outcome

WIDTH = 120

DETAILED = (
    'time-optimal, all known',
    'time-optimal, 3·A/J known',
    'time-preserving, all known',
    'time-preserving, 3·A/J known',
)
"""Strategies with a line per trajectory; motion.json has them all."""


WORDS = """Written by `make bench-motion`; all figures are in motion.json as well.

* **fastest** (time-optimal): the smoother is as fast as the limits allow; **timed**
  (time-preserving): it keeps the commanded times.
* **all**, **0.5 s** …: how much of its way the smoother knows ahead of the arm. **A/J** is the
  time in which a joint's acceleration can build up: 0.1 s under full limits, 0.2 s under half.
  **late**: 3·A/J + 40 ms, and each plan comes 40 ms late.
* **limits**: `full`: acceleration = 10 · velocity / s, jerk = 10 · acceleration / s; `half`: 5, 5.
* **point to point**: the fastest moves that rest at every point. **TOPP-RA** keeps no jerk limit:
  nothing on the spline through the points can be faster. **optimum**: the fastest motion found
  within all limits, whatever its path between the points (benchmark/README.md). **on the spline**:
  both where it may not leave that path; where times are commanded, they are compared with the
  optimum there.
* **v, a, j**: the largest velocity, acceleration and jerk, as a multiple of the joint's limit.
  **waypoint**, **overrun**, **off lines**: the largest distance from a waypoint, past the last
  known point and from the straight lines between the points, rad."""

FAMILY_WORDS = """Random trajectories with seeds that nothing was chosen with, each run three
times: time-optimal with all known and with 3·A/J, and time-preserving with 3·A/J. **failed**: the
share of plans for which none was found, so that the one before went on. **/ pt to pt**: the worst
time with all known. **/ commanded**: the worst where the commanded time is 1.2 times that or more.
**v, a, j**: multiples of the limits by exact extrema; the largest in samples each ms. **plan**:
CPU time of one; the slowest 3 % are timed twice more with nothing beside, and the least counts.
Wanted: failed ≤ 2 %, no stops, times ≤ 1 and ≤ 1.2, v, a, j ≤ 1, plan ≤ 60 ms at the 99th
percentile."""


def report(
    cases: list[Case],
    results: list[Outcome],
    of_families: Sequence[FamilyFigures] = (),
) -> str:
    """Return the whole report."""
    parts = [
        '# Motion benchmark',
        WORDS,
        '## Targets',
        targets(results),
        '## Strategies\n\nTimes as ratios: geometric mean / worst. Stops are the sum.',
        summary(cases),
        '## Trajectories\n\nTimes in s.',
        trajectories(cases),
        '## Every trajectory',
        details(cases),
    ]
    if any(case.cut_streams for case in cases):
        parts += ['## Streams that are cut on the way', cut_streams(cases)]
    if of_families:
        parts += [f'## Families that are hard to plan\n\n{FAMILY_WORDS}', families(of_families)]
    errors = [
        f'* {case.name}, {case.limits}, {name}: {text}'
        for case in cases
        for name, text in case.errors.items()
    ]
    if errors:
        parts += ['## Errors', '\n'.join(errors)]
    return '\n\n'.join(parts) + '\n'


def targets(results: list[Outcome]) -> str:
    """Return what is required and what is attained."""
    rows = []
    for result in results:
        unit = f' {result.unit}' if result.unit else ''
        if result.worst is None:
            rows.append([result.metric, *_bounds(result), 'not measured', '', '', '–'])
            continue
        met = 'goal met' if result.goal_met else 'met' if result.met else '**MISSED**'
        if not np.isfinite(result.required) and not result.goal_met:
            met = 'goal missed'
        rows.append(
            [
                result.metric,
                *_bounds(result),
                _short(result.worst) + unit,
                result.where if result.worst > 0.0 else '',
                _short(result.mean or 0.0),
                met,
            ]
        )
    header = 'metric | required | goal | worst | where | mean | result'
    return _table(header, rows)


def summary(cases: list[Case]) -> str:
    """Return a line per strategy, over all trajectories and limits."""
    header = (
        'strategy | runs | time / point to point | / commanded | / optimum | / TOPP-RA | '
        'largest v, a, j / limit | stops | waypoint | overrun'
    )
    rows = [_ptp_row(cases)]
    for name in SPLINES:
        if found := [(case, case.splines[name]) for case in cases if name in case.splines]:
            ratio = _pair(spline.duration / case.references.ptp for case, spline in found)
            over = _pair(
                spline.duration / case.commanded for case, spline in found if case.commanded
            )
            largest = (
                f'{max(float(getattr(spline, key)) for _, spline in found):.3g}'
                for key in ('velocity', 'acceleration', 'jerk')
            )
            title, uses = f'spline in time, {name}', ', '.join(largest)
            rows.append([title, str(len(found)), ratio, over, '–', '–', uses, '–', '0', '0'])
    for name in STRATEGIES:
        runs = [(case, case.strategies[name]) for case in cases if name in case.strategies]
        if runs:
            rows.append(_strategy_row(name, runs))
    return _table(header, rows)


def _ptp_row(cases: list[Case]) -> list[str]:
    times = [case.references for case in cases]
    return [
        'point to point',
        str(len(cases)),
        '1',
        _pair(case.references.ptp / case.commanded for case in cases if case.commanded),
        _pair(one.ptp / one.opt for one in times),
        _pair(one.ptp / one.toppra for one in times),
        '1, 1, 1',
        str(sum(one.ptp_stops for one in times)),
        '0',
        '0',
    ]


def _strategy_row(name: str, runs: Sequence[tuple[Case, Metrics]]) -> list[str]:
    timed = STRATEGIES[name].timed
    return [
        name,
        str(len(runs)),
        _pair(m.duration / case.references.ptp for case, m in runs),
        _pair(m.duration / case.commanded for case, m in runs if case.commanded),
        '–' if timed else _pair(m.duration / case.references.opt for case, m in runs),
        '–' if timed else _pair(m.duration / case.references.toppra for case, m in runs),
        ', '.join(
            f'{max(getattr(m, key) for _, m in runs):.3f}'
            for key in ('velocity', 'acceleration', 'jerk')
        ),
        str(sum(m.stops for _, m in runs)),
        f'{max(m.waypoint for _, m in runs):.1e}',
        f'{max(m.overrun for _, m in runs):.1e}',
    ]


def trajectories(cases: list[Case]) -> str:
    """Return the references of every trajectory and what the optimum attains of the limits."""
    header = (
        'trajectory | what it is | limits | points | commanded | point to point | TOPP-RA | '
        'optimum | v, a, j of the optimum'
    )
    rows = []
    for case in cases:
        one = case.references
        rows.append(
            [
                case.name,
                case.kind,
                case.limits,
                str(case.points),
                f'{case.commanded:.3f}' if case.commanded else '–',
                f'{one.ptp:.3f}',
                f'{one.toppra:.3f}',
                f'{one.opt:.3f} ({one.opt_by})',
                f'{one.opt_velocity:.3f}, {one.opt_acceleration:.3f}, {one.opt_jerk:.3f}'
                + ('' if one.sound() else ' **unsound**'),
            ]
        )
    return _table(header, rows)


def details(cases: list[Case]) -> str:
    """Return a line per trajectory, limits and strategy of DETAILED."""
    header = (
        'trajectory | limits | strategy | time, s | / pt to pt | / commanded | / optimum | '
        '/ TOPP-RA | v | a | j | stops | waypoint | overrun | off lines'
    )
    rows = []
    for case in cases:
        for name in DETAILED:
            m = case.strategies.get(name)
            if m is None:
                continue
            one = case.references
            rows.append(
                [
                    case.name,
                    case.limits,
                    name,
                    f'{m.duration:.3f}',
                    f'{m.duration / one.ptp:.3f}',
                    f'{m.duration / case.commanded:.3f}' if case.commanded else '–',
                    f'{m.duration / one.opt:.3f}',
                    f'{m.duration / one.toppra:.3f}',
                    f'{m.velocity:.3f}',
                    f'{m.acceleration:.3f}',
                    f'{m.jerk:.3f}',
                    str(m.stops),
                    f'{m.waypoint:.1e}' if m.waypoint else '0',
                    f'{m.overrun:.1e}' if m.overrun else '0',
                    f'{m.deviation:.3f}',
                ]
            )
    return _table(header, rows)


def cut_streams(cases: list[Case]) -> str:
    """Return how motions ended whose stream was cut, per strategy and limits."""
    header = (
        'strategy | limits | runs | from the last point at the end, rad | overrun, rad | '
        'stops | largest velocity, acceleration, jerk'
    )
    groups: dict[tuple[str, str], list[Metrics]] = {}
    for case in cases:
        for cut in case.cut_streams:
            groups.setdefault((cut.strategy, case.limits), []).append(cut.metrics)
    rows = []
    for (strategy, limits), found in groups.items():
        use = (max(getattr(m, key) for m in found) for key in ('velocity', 'acceleration', 'jerk'))
        rows.append(
            [
                strategy,
                limits,
                str(len(found)),
                f'{max(m.end for m in found):.1e}',
                f'{max(m.overrun for m in found):.1e}',
                str(sum(m.stops for m in found)),
                ', '.join(f'{value:.3f}' for value in use),
            ]
        )
    return _table(header, rows)


def families(found: Sequence[FamilyFigures]) -> str:
    """Return a line per family."""
    header = (
        'family | runs | plans | failed | stops | / pt to pt | / commanded | '
        'v, a, j (sampled) | plan, median | 99 %'
    )
    rows = [
        [
            one.name,
            str(one.runs) + (f' ({one.unfinished} without an end)' if one.unfinished else ''),
            str(one.plans),
            f'{100.0 * one.failed_share:.1f} %',
            str(one.stops),
            f'{one.time_ratio:.2f}',
            f'{one.commanded_ratio:.2f}' if one.commanded_ratio else '–',
            f'{one.velocity:.3f}, {one.acceleration:.3f}, {one.jerk:.3f} ({one.sampled:.3f})',
            f'{1e3 * one.plan_median:.0f} ms',
            f'{1e3 * one.plan_p99:.0f} ms',
        ]
        for one in found
    ]
    words = [f'* `{one.name}`: {FAMILIES[one.name][0]}' for one in found]
    return '\n'.join([_table(header, rows), '', *words])


def _pair(values: Iterable[float]) -> str:
    """Return geometric mean / largest."""
    found = np.array(list(values))
    if not found.size:
        return '–'
    return f'{np.exp(np.mean(np.log(found))):.2f} / {found.max():.2f}'


def _bounds(result: Outcome) -> list[str]:
    unit = f' {result.unit}' if result.unit else ''
    bounds = (result.required, result.goal)
    return [f'≤ {value:g}{unit}' if np.isfinite(value) else '–' for value in bounds]


def _short(value: float) -> str:
    return f'{value:.1e}' if 0.0 < abs(value) < 1e-3 else f'{value:.4g}'


def shortened(cell: str) -> str:
    """Return a cell with the short names of the modes that WORDS explains."""
    return (
        cell.replace('time-optimal', 'fastest')
        .replace('time-preserving', 'timed')
        .replace(' known', '')
        .replace('3·A/J + 40 ms, 40 ms late', 'late')
    )


def _table(header: str, rows: Iterable[list[str]]) -> str:
    """Return a table; one that would be wider than WIDTH columns has no spaces beside its bars."""
    names = header.split(' | ')
    lines = [names, ['---'] * len(names), *([shortened(cell) for cell in row] for row in rows)]
    spaced = [f'| {" | ".join(cells)} |' for cells in lines]
    if max(map(len, spaced)) <= WIDTH:
        return '\n'.join(spaced)
    return '\n'.join(f'|{"|".join(cells)}|' for cells in lines)
