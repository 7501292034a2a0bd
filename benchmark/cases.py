# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One trajectory under one set of limits: its references, and every strategy's figures."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial

from benchmark.baselines import SPLINES, joint_spline
from benchmark.limit_sets import limit_set
from benchmark.metrics import Metrics, commanded_rests, measure
from benchmark.references import ReferenceTimes
from benchmark.strategies import STRATEGIES, Strategy, run
from benchmark.trajectories import BenchmarkTrajectory
from epson_driver.motion import JointLimits
from epson_driver.motion.motion_figures import Figures

CUT_AFTER = {'time-preserving, 3·A/J known': (1 / 3, 3 / 4), 'time-optimal, 3·A/J known': (1 / 2,)}
"""After what share of the points the stream is cut in another run, per strategy."""


@dataclass(frozen=True)
class CutStream:
    """A stream that stopped after `points` points; the figures are against the last of them."""

    strategy: str
    points: int
    metrics: Metrics


@dataclass
class Case:
    """All that was measured; times in s.

    rests: how much of the commanded time is commanded rest. errors: what strategies raised.
    """

    name: str
    kind: str
    limits: str
    points: int
    commanded: float | None
    rests: float
    references: ReferenceTimes
    splines: dict[str, Figures] = field(default_factory=dict)
    strategies: dict[str, Metrics] = field(default_factory=dict)
    cut_streams: list[CutStream] = field(default_factory=list)
    errors: dict[str, str] = field(default_factory=dict)
    took: float = 0.0

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return asdict(self)


@dataclass(frozen=True)
class Task:
    """What to run."""

    trajectory: BenchmarkTrajectory
    limits: str
    references: ReferenceTimes
    strategies: tuple[str, ...]


def run_case(task: Task) -> Case:
    """Run every strategy that suits the trajectory; errors are part of the result."""
    trajectory, limits = task.trajectory, limit_set(task.limits)
    case = Case(
        trajectory.name,
        trajectory.kind,
        task.limits,
        len(trajectory.positions),
        trajectory.commanded,
        _time_at_rest(trajectory, limits),
        task.references,
    )
    began = time.monotonic()
    if trajectory.durations is not None:
        for name in SPLINES:
            case.splines[name] = joint_spline(
                name, trajectory.positions, trajectory.durations, limits
            )
    for name in task.strategies:
        if STRATEGIES[name].suits(trajectory):
            _run_strategy(case, STRATEGIES[name], trajectory, limits)
    case.took = time.monotonic() - began
    return case


def _time_at_rest(trajectory: BenchmarkTrajectory, limits: JointLimits) -> float:
    if trajectory.durations is None:
        return 0.0
    rests = commanded_rests(trajectory, limits)
    return sum(float(trajectory.durations[i + 1 : j + 1].sum()) for i, j in rests)


def _run_strategy(
    case: Case,
    strategy: Strategy,
    trajectory: BenchmarkTrajectory,
    limits: JointLimits,
) -> None:
    def guarded(label: str, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001  whatever the class under test raises
            case.errors[label] = f'{type(error).__name__}: {error}'

    def whole() -> None:
        record = run(strategy, trajectory, limits)
        case.strategies[strategy.name] = measure(trajectory, record, limits, strategy.timed)

    def cut(points: int) -> None:
        durations = trajectory.durations
        known = BenchmarkTrajectory(
            trajectory.name,
            trajectory.kind,
            trajectory.positions[:points],
            None if durations is None else durations[:points],
        )
        record = run(strategy, known, limits, cut=True)
        metrics = measure(known, record, limits, strategy.timed)
        case.cut_streams.append(CutStream(strategy.name, points, metrics))

    guarded(strategy.name, whole)
    for share in CUT_AFTER.get(strategy.name, ()):
        points = max(3, int(share * case.points))
        guarded(f'{strategy.name}, cut after {points} points', partial(cut, points))
