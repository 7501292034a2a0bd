# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How much slower a motion gets the less is known ahead of it."""

from dataclasses import asdict, dataclass

from benchmark.cases import factory
from benchmark.limit_sets import limit_set
from benchmark.metrics import measure
from benchmark.strategies import Strategy, run
from benchmark.trajectories import BenchmarkTrajectory

KNOWN_AHEAD_S = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
"""What is known ahead, s."""
TRAJECTORIES = ('dense_4ms', 'dense_4ms_slow')


@dataclass(frozen=True)
class Curve:
    """Time relative to that with all known, for each of `times`, s."""

    name: str
    limits: str
    timed: bool
    times: tuple[float, ...]
    ratios: tuple[float, ...]

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return asdict(self)


@dataclass(frozen=True)
class CurveTask:
    """What to run, as in `cases.Task`."""

    trajectory: BenchmarkTrajectory
    limits: str
    timed: bool
    smoother: str


def run_curve(task: CurveTask) -> Curve:
    """Run one trajectory with all and with less known; raises what the smoother raises."""
    limits, make = limit_set(task.limits), factory(task.smoother)

    def duration(known: float | None) -> float:
        ahead = None if known is None else lambda _: known
        strategy = Strategy('look-ahead', task.timed, ahead)
        record = run(strategy, task.trajectory, limits, make)
        return measure(task.trajectory, record, limits, task.timed).duration

    whole = duration(None)
    ratios = tuple(duration(known) / whole for known in KNOWN_AHEAD_S)
    return Curve(task.trajectory.name, task.limits, task.timed, KNOWN_AHEAD_S, ratios)
