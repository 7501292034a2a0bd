# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The benchmark's figures as Markdown."""

from collections.abc import Iterable, Sequence

import numpy as np

from benchmark.cases import Case
from benchmark.look_ahead import Curve
from benchmark.metrics import Metrics
from benchmark.strategies import STRATEGIES
from benchmark.targets import Outcome

WIDTH = 120

DETAILED = ('O, all known', 'O, 3·A/J known', 'T, all known', 'T, 3·A/J known')
"""Strategies with a line per trajectory; motion.json has them all."""


def report(cases: list[Case], curves: list[Curve], results: list[Outcome]) -> str:
    """Return the whole report."""
    parts = [
        '# Motion benchmark',
        'Written by `make bench-motion`; all figures are in motion.json as well. Limits `full`: '
        'a = 10·v/s, j = 10·a/s;\n`half`: 5 and 5. '
        'PTP stops at every point. TOPP-RA keeps no jerk limit: nothing can be faster. OPT is\n'
        'the jerk-limited optimum on one spline through the points (benchmark/optimum). '
        'O: as fast as possible; T: keeps the\ncommanded times.',
        '## Targets',
        targets(results),
        '## Strategies\nGeometric mean / worst; stops are the sum.',
        summary(cases),
        '## Trajectories\nTimes in s.',
        trajectories(cases),
        '## Every trajectory',
        details(cases),
    ]
    if any(case.deaths for case in cases):
        parts += ['## Streams that end on the way', deaths(cases)]
    if curves:
        parts += [
            '## Look-ahead\nTime relative to that with all points known.',
            look_ahead(curves),
        ]
    errors = [
        f'* {case.name}, {case.limits}, {name}: {text}'
        for case in cases
        for name, text in case.errors.items()
    ]
    if errors:
        parts += ['## Errors', '\n'.join(errors)]
    return '\n\n'.join(parts) + '\n'


def targets(results: list[Outcome]) -> str:
    """Return what must be and what is."""
    rows = []
    for result in results:
        unit = f' {result.unit}' if result.unit else ''
        if result.worst is None:
            rows.append(
                [
                    result.metric,
                    _bound(result.must, unit),
                    _bound(result.moonshot, unit),
                    'not measured',
                    '',
                    '',
                    '–',
                ]
            )
            continue
        met = 'moonshot' if result.moonshot_met else 'yes' if result.met else '**NO**'
        if not np.isfinite(result.must) and not result.moonshot_met:
            met = 'not yet'
        rows.append(
            [
                result.metric,
                _bound(result.must, unit),
                _bound(result.moonshot, unit),
                _short(result.worst) + unit,
                result.where if result.worst > 0.0 else '',
                _short(result.mean or 0.0),
                met,
            ]
        )
    header = ['metric', 'must', 'moonshot', 'worst', 'where', 'mean', 'met']
    return _table(header, rows)


def summary(cases: list[Case]) -> str:
    """Return a line per strategy, over all trajectories and limits."""
    header = [
        'strategy',
        'runs',
        'T/PTP',
        'T/cmd',
        'T/OPT',
        'T/TOPP-RA',
        'max v, a, j',
        'stops',
        'waypoint error, rad',
        'overrun, rad',
    ]
    rows = [_ptp_row(cases)]
    for name in ('cubic', 'quintic'):
        found = [(case, case.splines[name]) for case in cases if name in case.splines]
        if found:
            rows.append(
                [
                    f'spline in time, {name}',
                    str(len(found)),
                    _pair(spline.duration / case.references.ptp for case, spline in found),
                    '1',
                    '–',
                    '–',
                    ', '.join(
                        f'{max(float(getattr(spline, key)) for _, spline in found):.3g}'
                        for key in ('velocity', 'acceleration', 'jerk')
                    ),
                    '–',
                    '0',
                    '0',
                ]
            )
    for name in STRATEGIES:
        runs = [(case, case.strategies[name]) for case in cases if name in case.strategies]
        if runs:
            rows.append(_strategy_row(name, runs))
    return _table(header, rows)


def _ptp_row(cases: list[Case]) -> list[str]:
    times = [case.references for case in cases]
    return [
        'PTP',
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
    """Return the references of every trajectory and what OPT attains of the limits."""
    header = [
        'trajectory',
        'what it is',
        'limits',
        'points',
        'commanded',
        'PTP',
        'TOPP-RA',
        'OPT',
        'OPT v, a, j',
    ]
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
                f'{one.opt:.3f}',
                f'{one.opt_velocity:.3f}, {one.opt_acceleration:.3f}, {one.opt_jerk:.3f}'
                + ('' if one.sound() else ' **unsound**'),
            ]
        )
    return _table(header, rows)


def details(cases: list[Case]) -> str:
    """Return a line per trajectory, limits and strategy of DETAILED."""
    header = [
        'trajectory',
        'limits',
        'strategy',
        'T, s',
        'T/PTP',
        'T/cmd',
        'T/OPT',
        'T/TOPP-RA',
        'v',
        'a',
        'j',
        'stops',
        'waypoint error',
        'overrun',
        'off the polyline',
    ]
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


def deaths(cases: list[Case]) -> str:
    """Return how motions ended whose stream died, per strategy and limits."""
    header = [
        'strategy',
        'limits',
        'runs',
        'from the last point at the end, rad',
        'overrun, rad',
        'stops',
        'max v, a, j',
    ]
    groups: dict[tuple[str, str], list[Metrics]] = {}
    for case in cases:
        for death in case.deaths:
            groups.setdefault((death.strategy, case.limits), []).append(death.metrics)
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


def look_ahead(curves: list[Curve]) -> str:
    """Return a line per curve."""
    header = ['trajectory', 'limits', 'mode', *(f'{known:g} s' for known in curves[0].times)]
    rows = [
        [
            curve.name,
            curve.limits,
            'T' if curve.timed else 'O',
            *(f'{ratio:.3f}' for ratio in curve.ratios),
        ]
        for curve in curves
    ]
    return _table(header, rows)


def _pair(values: Iterable[float]) -> str:
    """Return geometric mean / largest."""
    found = np.array(list(values))
    if not found.size:
        return '–'
    return f'{np.exp(np.mean(np.log(found))):.2f} / {found.max():.2f}'


def _bound(value: float, unit: str) -> str:
    return f'≤ {value:g}{unit}' if np.isfinite(value) else '–'


def _short(value: float) -> str:
    return f'{value:.1e}' if 0.0 < abs(value) < 1e-3 else f'{value:.4g}'


def _table(header: list[str], rows: Iterable[list[str]]) -> str:
    """Return a table; one that would be wider than WIDTH columns has no spaces beside its bars."""
    lines = [header, ['---'] * len(header), *rows]
    spaced = [f'| {" | ".join(cells)} |' for cells in lines]
    if max(map(len, spaced)) <= WIDTH:
        return '\n'.join(spaced)
    return '\n'.join(f'|{"|".join(cells)}|' for cells in lines)
