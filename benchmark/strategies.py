# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The strategies compared by the benchmark: a table from name to the feeding of the smoother."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from benchmark.limit_sets import ramp_time
from benchmark.trajectories import BenchmarkTrajectory
from benchmark.waypoints import Record
from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.interpolation import central_differences
from epson_driver.motion.smoothed import smoothed
from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.planner import plan
from epson_driver.motion.smoother.request import Plan, Request
from epson_driver.node.stoppable import StoppableMotion
from epson_driver.report.smooth_study import Figures, measure, spline

SAMPLE_STEP_S = 0.001
"""The sampling step, s: finer than the 4 ms cycle, so that spikes between two cycles are seen."""
LATENCY_S = 0.040
"""Latency of a slow planner, s."""
PATIENCE_S = 60.0
"""Maximum duration of a motion beyond half a second per point and twice its commanded time, s."""


MAX_WALL_TIME_S = 120.0
"""Maximum wall time of one run, s: some hundred times the normal one."""


MODES = {True: 'time-preserving', False: 'time-optimal'}
"""Names of strategies that keep the commanded durations, or do not."""


@dataclass(frozen=True)
class Strategy:
    """A use of the smoother. `look_ahead` gives the time known ahead, s, or None for all.

    `timed`: whether it keeps the commanded durations or is as fast as possible. `whole`: whether
    all points are solved as one problem. Otherwise they are fed to the smoother, on the spline
    through them.
    """

    name: str
    timed: bool
    look_ahead: Callable[[JointLimits], float] | None = None
    latency: float = 0.0
    whole: bool = False

    def suits(self, trajectory: BenchmarkTrajectory) -> bool:
        """Return whether the trajectory has the data that the strategy needs."""
        return trajectory.durations is not None or not self.timed


def _ahead(text: str, timed: bool, time_ahead: Callable[[JointLimits], float]) -> Strategy:
    return Strategy(f'{MODES[timed]}, {text} known', timed, time_ahead)


def _both(timed: bool) -> tuple[Strategy, ...]:
    return (
        Strategy(f'{MODES[timed]}, all known', timed, whole=not timed),
        _ahead('2·A/J', timed, lambda limits: 2.0 * ramp_time(limits)),
        _ahead('3·A/J', timed, lambda limits: 3.0 * ramp_time(limits)),
        _ahead('0.25 s', timed, lambda limits: 0.25),
        _ahead('0.5 s', timed, lambda limits: 0.5),
    )


ON_SPLINE = 'time-optimal, all known, on the spline'

STRATEGIES = {
    strategy.name: strategy
    for strategy in (
        *_both(timed=False),
        Strategy(ON_SPLINE, False),
        *_both(timed=True),
        Strategy(
            'time-preserving, 3·A/J + 40 ms known, 40 ms late',
            True,
            lambda limits: 3.0 * ramp_time(limits) + LATENCY_S,
            LATENCY_S,
        ),
    )
}


def run(
    strategy: Strategy,
    trajectory: BenchmarkTrajectory,
    limits: JointLimits,
    cut: bool = False,
) -> Record:
    """Return the sampled motion of the smoother. Its stream is finished unless `cut`.

    Raises RuntimeError if it does not end within PATIENCE_S more than any motion needs.
    """
    positions = trajectory.positions
    durations = trajectory.durations if strategy.timed else None
    ahead = None if strategy.look_ahead is None else strategy.look_ahead(limits)
    if strategy.whole:
        return _at_once(trajectory, limits)
    plans = 0

    def counted(request: Request, limits: JointLimits) -> Plan | None:
        nonlocal plans
        plans += 1
        return plan(request, limits)

    mode = Mode.TIME_PRESERVING if strategy.timed else Mode.TIME_OPTIMAL
    smoother = Smoother(limits, positions[0], mode, latency=strategy.latency, planner=counted)
    n = len(positions)
    fed = 1
    started = time.perf_counter()
    deadline = PATIENCE_S + 2.0 * (trajectory.commanded or 0.0) + 0.5 * n
    rows = [np.concatenate([positions[0], np.zeros(2 * positions.shape[1])])]
    costs: list[float] = []
    planned: list[bool] = []
    while True:
        start = time.process_time()
        before = (fed, plans)
        while fed < n and (ahead is None or smoother.look_ahead < ahead):
            smoother.append(positions[fed], None if durations is None else float(durations[fed]))
            fed += 1
        if fed == n and before[0] != n and not cut:
            smoother.finish()
        state = smoother.step(SAMPLE_STEP_S)
        costs.append(time.process_time() - start)
        planned.append((fed, plans) != before)
        rows.append(np.concatenate([state.position, state.velocity, state.acceleration]))
        if fed == n and not smoother.moving:
            break
        if time.perf_counter() - started > MAX_WALL_TIME_S:
            raise RuntimeError(
                f'{trajectory.name}, {strategy.name}: {MAX_WALL_TIME_S:g} s of computing for '
                f'{len(rows) * SAMPLE_STEP_S:.3f} s of motion'
            )
        if len(rows) * SAMPLE_STEP_S > deadline:
            raise RuntimeError(
                f'{trajectory.name}, {strategy.name}: still moving after {deadline:g} s'
            )
    table = np.array(rows)
    position, velocity, acceleration = np.split(table, 3, axis=1)
    return Record(
        SAMPLE_STEP_S,
        position,
        velocity,
        acceleration,
        np.array(costs),
        np.array(planned, dtype=np.bool_),
    )


def _at_once(trajectory: BenchmarkTrajectory, limits: JointLimits) -> Record:
    """Return the motion through all points as one problem."""
    plan_read = Trajectory(
        limits.names, np.arange(float(len(trajectory.positions))), trajectory.positions
    )
    motion = smoothed(plan_read, limits, Mode.TIME_OPTIMAL, period=SAMPLE_STEP_S)
    none = np.zeros(0)
    return Record(
        SAMPLE_STEP_S,
        motion.positions,
        np.asarray(motion.velocities),
        np.asarray(motion.accelerations),
        none,
        none.astype(np.bool_),
    )


@dataclass(frozen=True)
class StopAndGo:
    """Total duration of the moves, s, and the number of stops at points between the ends."""

    duration: float
    stops: int


def stop_and_go(positions: Array, limits: JointLimits) -> StopAndGo:
    """Return the time through the points (n, joints), rad. A repeated point takes no time."""
    moves = [go(limits, start, target).duration for start, target in pairwise(positions)]
    return StopAndGo(float(np.sum(moves)), max(sum(move > 0.0 for move in moves) - 1, 0))


def quintic(plan: Trajectory, _: JointLimits) -> Trajectory:
    """Return a plan with velocities and accelerations from finite differences."""
    velocities = central_differences(plan.times, plan.positions)
    accelerations = central_differences(plan.times, velocities)
    return replace(plan, velocities=velocities, accelerations=accelerations)


def handed_on(plan: Trajectory, limits: JointLimits) -> Trajectory:
    """Return the plan as sent by smooth_goals, with points at most 8 ms apart."""
    return StoppableMotion(plan, limits).points(0.008)


SPLINES: dict[str, Callable[[Trajectory, JointLimits], Trajectory]] = {
    'cubic': lambda plan, _: plan,
    'quintic': quintic,
    'quintic, behind smooth_goals': handed_on,
}
"""Preparations of a plan's positions and times for ros2_control's joint_trajectory_controller."""


def joint_spline(name: str, positions: Array, durations: Array, limits: JointLimits) -> Figures:
    """Return the demands of one of SPLINES for points (n, joints), rad, and durations (n,), s.

    Like joint_trajectory_controller, it keeps the times regardless of the limits.
    """
    plan = Trajectory(limits.names, np.cumsum(durations), positions)
    sampled, _ = spline(SPLINES[name](plan, limits))
    return measure(sampled, None, limits)
