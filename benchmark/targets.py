# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is required of the smoother, what its goals are, and what it attains."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmark.cases import Case
from benchmark.clocks import tolerance
from benchmark.limit_sets import limit_set, ramp_time
from benchmark.metrics import Metrics
from benchmark.strategies import STRATEGIES

CYCLE_S = 0.004
"""The controller's cycle, s."""
MIN_MANY_POINTS = 50
LIMIT_TOLERANCE_SHARE = 1e-6
"""Relative; limits are kept, but the last bits of a sampled velocity are its own."""
NO_DISTANCE_RAD = 1e-9
"""A distance that is no distance, rad."""


@dataclass(frozen=True)
class Measured:
    """One value of a metric and where it comes from."""

    value: float
    where: str


@dataclass(frozen=True)
class Target:
    """A metric with its bounds; `required` is infinite if there is a goal only.

    `values` yields it from every case to which it applies. `geometric`: what its mean is.
    `of_mean`: the bounds are for the mean, and not for the worst value.
    """

    metric: str
    required: float
    goal: float
    values: Callable[[Case], Iterator[Measured]]
    geometric: bool = True
    unit: str = ''
    slack: float = 0.0
    of_mean: bool = False


@dataclass(frozen=True)
class Outcome:
    """A target's worst value (with its place) and mean over all cases; None if none applies."""

    metric: str
    unit: str
    required: float
    goal: float
    worst: float | None
    where: str
    mean: float | None
    met: bool
    goal_met: bool


def outcomes(cases: list[Case]) -> list[Outcome]:
    """Return every target's outcome."""
    return [_outcome(target, cases) for target in TARGETS]


def _outcome(target: Target, cases: list[Case]) -> Outcome:
    found = [measured for case in cases for measured in target.values(case)]
    if not found:
        return Outcome(
            target.metric,
            target.unit,
            target.required,
            target.goal,
            None,
            '',
            None,
            met=False,
            goal_met=False,
        )
    worst = max(found, key=lambda measured: measured.value)
    values = np.array([measured.value for measured in found])
    mean = np.exp(np.mean(np.log(values))) if target.geometric else np.mean(values)
    judged = float(mean) if target.of_mean else worst.value
    return Outcome(
        target.metric,
        target.unit,
        target.required,
        target.goal,
        worst.value,
        worst.where,
        float(mean),
        met=judged <= target.required + target.slack,
        goal_met=judged <= target.goal + target.slack,
    )


def _of(
    strategy: str,
    ratio: Callable[[Case, Metrics], float],
    applies: Callable[[Case], bool] = lambda case: True,
) -> Callable[[Case], Iterator[Measured]]:
    def values(case: Case) -> Iterator[Measured]:
        metrics = case.strategies.get(strategy)
        if metrics is not None and applies(case):
            yield Measured(ratio(case, metrics), f'{case.name}, {case.limits}')

    return values


def _every(quantity: str, factor: float = 1.0) -> Callable[[Case], Iterator[Measured]]:
    def values(case: Case) -> Iterator[Measured]:
        runs = [(name, metrics) for name, metrics in case.strategies.items()]
        runs += [
            (f'{d.strategy}, cut after {d.points} points', d.metrics) for d in case.cut_streams
        ]
        for name, metrics in runs:
            value = factor * float(getattr(metrics, quantity))
            if quantity == 'step_p99' and not value:
                continue  # a motion that is found at once has no steps
            yield Measured(value, f'{case.name}, {case.limits}, {name}')

    return values


def _stops(enough: bool) -> Callable[[Case], Iterator[Measured]]:
    """Return the stops of the runs in which as much is known ahead as is asked for, or less."""

    def values(case: Case) -> Iterator[Measured]:
        limits = limit_set(case.limits)
        for name, metrics in case.strategies.items():
            ahead = STRATEGIES[name].look_ahead
            known = np.inf if ahead is None else ahead(limits)
            if enough == (known >= 3.0 * ramp_time(limits) - NO_DISTANCE_RAD):
                yield Measured(float(metrics.stops), f'{case.name}, {case.limits}, {name}')

    return values


def _slower_than(share: float) -> Callable[[Case], bool]:
    """Return whether a case's command moves for at least `share` times the spline's optimum."""
    return lambda case: (
        case.commanded is not None
        and (case.commanded - case.rests >= share * case.references.spline)
    )


def _of_command(case: Case, metrics: Metrics) -> float:
    return metrics.duration / (case.commanded or np.nan)


def _slow_down(case: Case, metrics: Metrics) -> float:
    return metrics.duration / case.strategies['time-preserving, all known'].duration


def _of_optimum(case: Case, metrics: Metrics) -> float:
    return metrics.duration / case.references.opt


def _known(case: Case) -> bool:
    return 'time-preserving, all known' in case.strategies and _slower_than(1.2)(case)


TARGETS = (
    Target(
        f'time / point to point, time-optimal, {MIN_MANY_POINTS} points or more',
        0.25,
        0.15,
        _of(
            'time-optimal, all known',
            lambda case, m: m.duration / case.references.ptp,
            lambda case: case.points >= MIN_MANY_POINTS,
        ),
    ),
    Target(
        'time / optimum, time-optimal, worst',
        1.10,
        1.02,
        _of('time-optimal, all known', _of_optimum),
    ),
    Target(
        'time / optimum, time-optimal, mean',
        1.04,
        1.01,
        _of('time-optimal, all known', _of_optimum),
        of_mean=True,
    ),
    Target(
        'time / commanded, time-preserving, where commanded ≥ 1.5 · optimum',
        1.10,
        1.02,
        _of('time-preserving, all known', _of_command, _slower_than(1.5)),
    ),
    Target(
        'time / commanded, time-preserving, where commanded ≥ 1.2 · optimum',
        1.20,
        1.08,
        _of('time-preserving, all known', _of_command, _slower_than(1.2)),
    ),
    Target(
        'the same with 0.5 s known, where commanded ≥ 1.5 · optimum',
        1.10,
        1.02,
        _of('time-preserving, 0.5 s known', _of_command, _slower_than(1.5)),
    ),
    Target(
        'the same with 0.5 s known, where commanded ≥ 1.2 · optimum',
        1.20,
        1.08,
        _of('time-preserving, 0.5 s known', _of_command, _slower_than(1.2)),
    ),
    Target(
        'a point before its time / 50 ms or 2 % of the whole, where commanded ≥ 1.2 · optimum',
        1.0,
        0.5,
        _of(
            'time-preserving, all known',
            lambda case, m: m.early / tolerance(case.commanded or np.nan),
            _slower_than(1.2),
        ),
        geometric=False,
    ),
    Target('largest velocity / limit', 1.0, 1.0, _every('velocity'), slack=LIMIT_TOLERANCE_SHARE),
    Target(
        'largest acceleration / limit',
        1.0,
        1.0,
        _every('acceleration'),
        slack=LIMIT_TOLERANCE_SHARE,
    ),
    Target('largest jerk / limit', 1.02, 1.0, _every('jerk'), slack=LIMIT_TOLERANCE_SHARE),
    Target(
        'stops not commanded, 3·A/J or more known',
        0.0,
        0.0,
        _stops(enough=True),
        geometric=False,
    ),
    Target('the same with less known', np.inf, 0.0, _stops(enough=False), geometric=False),
    Target(
        'beside a waypoint',
        1e-5,
        1e-6,
        _every('waypoint'),
        geometric=False,
        unit='rad',
    ),
    Target(
        'overrun past the last known point',
        0.0,
        0.0,
        _every('overrun'),
        geometric=False,
        unit='rad',
        slack=NO_DISTANCE_RAD,
    ),
    Target(
        'distance from the last known point at the end',
        0.0,
        0.0,
        _every('end'),
        geometric=False,
        unit='rad',
        slack=NO_DISTANCE_RAD,
    ),
    Target(
        'outside the position limits',
        0.0,
        0.0,
        _every('outside'),
        geometric=False,
        unit='rad',
        slack=NO_DISTANCE_RAD,
    ),
    Target(
        'v, a against positions / limit',
        5e-3,
        5e-3,
        _every('mismatch'),
        geometric=False,
    ),
    Target(
        'time with 3·A/J known / with all known, where commanded ≥ 1.2 · optimum',
        1.10,
        1.10,
        _of('time-preserving, 3·A/J known', _slow_down, _known),
    ),
    Target(
        'time with 2·A/J known / with all known, where commanded ≥ 1.2 · optimum',
        np.inf,
        1.10,
        _of('time-preserving, 2·A/J known', _slow_down, _known),
    ),
    Target('cost of a step, p99 / cycle', 0.10, 0.03, _every('step_p99', 1.0 / CYCLE_S)),
)
"""What is judged over 'every' run includes streams that are cut."""
