# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One trajectory under one set of limits: its references, and every strategy's figures."""

from dataclasses import dataclass, field

from benchmark.limit_sets import limit_set
from benchmark.metrics import Metrics, commanded_rests, measure
from benchmark.references import ReferenceTimes
from benchmark.strategies import SPLINES, STRATEGIES, Strategy, joint_spline, run
from benchmark.trajectories import BenchmarkTrajectory
from epson_driver.motion import JointLimits
from epson_driver.report.smooth_study import Figures

CUT_AFTER = {'time-preserving, 3·A/J known': (1 / 3, 3 / 4), 'time-optimal, 3·A/J known': (1 / 2,)}
"""Shares of the points after which the stream is cut in additional runs, per strategy."""


@dataclass
class Case:
    """All measurements of a trajectory. Times in s.

    rests: commanded rest within the commanded time. cut_streams: measured against their own last
    point. errors: exceptions of the strategies.
    """

    name: str
    limits: str
    points: int
    commanded: float | None
    rests: float
    references: ReferenceTimes
    splines: dict[str, Figures] = field(default_factory=dict)
    strategies: dict[str, Metrics] = field(default_factory=dict)
    cut_streams: dict[str, Metrics] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Task:
    """A trajectory to run under one set of limits."""

    trajectory: BenchmarkTrajectory
    limits: str
    references: ReferenceTimes


def run_case(task: Task) -> Case:
    """Run every strategy that suits the trajectory. Errors are part of the result."""
    trajectory, limits = task.trajectory, limit_set(task.limits)
    case = Case(
        trajectory.name,
        task.limits,
        len(trajectory.positions),
        trajectory.commanded,
        _time_at_rest(trajectory, limits),
        task.references,
    )
    if trajectory.durations is not None:
        for name in SPLINES:
            case.splines[name] = joint_spline(
                name, trajectory.positions, trajectory.durations, limits
            )
    for strategy in STRATEGIES.values():
        if strategy.suits(trajectory):
            _run_strategy(case, strategy, trajectory, limits)
    return case


def _time_at_rest(trajectory: BenchmarkTrajectory, limits: JointLimits) -> float:
    if trajectory.durations is None:
        return 0.0
    rests = commanded_rests(trajectory, limits)
    return sum(float(trajectory.durations[i + 1 : j + 1].sum()) for i, j in rests)


def _run_strategy(
    case: Case, strategy: Strategy, trajectory: BenchmarkTrajectory, limits: JointLimits
) -> None:
    """Run the whole trajectory, and streams that are cut before its end."""
    shares = (1.0, *CUT_AFTER.get(strategy.name, ()))
    for fraction in shares:
        points = max(3, int(fraction * case.points))
        known = trajectory.first(points)
        try:
            record = run(strategy, known, limits, cut=fraction < 1.0)
            metrics = measure(known, record, limits, strategy.timed)
        except Exception as error:  # noqa: BLE001  whatever the class under test raises
            text = f'{case.name}, {case.limits}, {strategy.name}, {points} points: '
            case.errors.append(f'{text}{type(error).__name__}: {error}')
            continue
        if fraction < 1.0:
            case.cut_streams[f'{strategy.name}, {points} points'] = metrics
        else:
            case.strategies[strategy.name] = metrics
