# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion through points, found by an independent solver: CasADi and ipopt.

`make optimum` stores the times in references.json. Where ipopt finds none, the stored value is
kept. It is one problem in time (direct transcription). The jerk of each joint is constant within
steps, whose length is free between each pair of waypoints, and the path is free within the
smoother's own allowance for the bend. The initial guess is the smoother's motion on the spline,
which also defines the bend. ipopt ends at a local optimum on a grid, so the fastest motion may
take less.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from benchmark.limit_sets import FACTORS, limit_set
from benchmark.references import FILE, digest
from benchmark.strategies import ON_SPLINE, STRATEGIES, run
from benchmark.trajectories import BenchmarkTrajectory, benchmark_set
from benchmark.waypoints import Index, Record, waypoint_passages
from epson_driver.motion import Array, JointLimits

MERGED_RAD = 5e-4
"""Distance within which a waypoint is merged with its predecessor, like in the smoother, rad."""
STEP_S = 0.015
"""Longest step of constant jerk in the initial motion, s. Each segment has at least MIN_STEPS."""
MIN_STEPS = 4
MIN_WAY_S = 0.006
BEND_RATIO = 1.5
MIN_BEND_RAD = 2e-3
"""Maximum distance of a joint from the chord: as a multiple of the spline's, and at least, rad."""
VELOCITY_SHARE = 0.9995
"""Share of the limit allowed at nodes, because the velocity may bulge between them."""
MAX_NODES = 4000
"""More would take ipopt hours."""
LOOKS = 8
"""Samples per step of the solution, for its use of the limits."""
SOLVER: dict[str, Any] = {
    'ipopt.print_level': 0,
    'print_time': False,
    'ipopt.sb': 'yes',
    'ipopt.tol': 1e-5,
    'ipopt.acceptable_tol': 1e-3,
    'ipopt.acceptable_iter': 8,
    'ipopt.mu_init': 1e-2,
    'ipopt.max_iter': 300,
    'ipopt.fixed_variable_treatment': 'make_parameter',
}


@dataclass(frozen=True)
class Optimum:
    """A time in s, and the largest |v|/V, |a|/A and |j|/J of its motion."""

    duration: float
    velocity: float
    acceleration: float
    jerk: float

    def holds(self) -> bool:
        """Return whether the motion keeps the limits, checked independently of the solver."""
        return self.velocity <= 1.002 and max(self.acceleration, self.jerk) <= 1.001


@dataclass(frozen=True, eq=False)
class Grid:
    """Segments between m + 1 waypoints (m + 1, n): index per step (N,), step length in each, s."""

    waypoints: Array
    way: Index
    step: Array
    first: Index


def optimum(trajectory: BenchmarkTrajectory, limits: JointLimits) -> Optimum | None:
    """Return the fastest motion found by ipopt, or None if none keeps the limits."""
    spline = run(STRATEGIES[ON_SPLINE], trajectory, limits)
    waypoints = merged(trajectory.positions)
    grid = _grid(waypoints, _times(waypoints, spline))
    if len(grid.way) > MAX_NODES:
        return None
    bends = np.maximum(BEND_RATIO * _bends(waypoints, spline), MIN_BEND_RAD)
    answer = _solved(grid, spline, bends, limits)
    return answer if answer is not None and answer.holds() else None


def merged(positions: Array) -> Array:
    """Return the points (n, joints) without those that are as good as the one before."""
    kept = [positions[0]]
    for position in positions[1:]:
        if np.abs(position - kept[-1]).max() > MERGED_RAD:
            kept.append(position)
    while len(kept) > 1 and np.abs(kept[-1] - positions[-1]).max() <= MERGED_RAD:
        kept.pop()
    return np.array([*kept, positions[-1]])


def _times(waypoints: Array, record: Record) -> Array:
    """Return the passage times of waypoints, starting when the motion leaves the first one, s."""
    moving = np.flatnonzero(np.abs(record.positions - waypoints[0]).max(axis=1) > 1e-6)
    there = np.flatnonzero(np.abs(record.positions - waypoints[-1]).max(axis=1) > 1e-6)
    times = waypoint_passages(waypoints, record).times
    times[0] = record.dt * (moving[0] - 1)
    times[-1] = record.dt * (there[-1] + 1)
    return np.maximum.accumulate(np.clip(times, times[0], times[-1]))


def _grid(waypoints: Array, times: Array) -> Grid:
    ways = np.maximum(np.diff(times), MIN_WAY_S)
    counts = np.maximum(MIN_STEPS, np.ceil(ways / STEP_S).astype(np.intp))
    way = np.repeat(np.arange(len(ways)), counts)
    return Grid(waypoints, way, ways / counts, np.append(0, np.cumsum(counts)))


def _bends(waypoints: Array, record: Record) -> Array:
    """Return the maximum distance of a motion from each segment's chord, over all joints, rad."""
    samples = np.rint(_times(waypoints, record) / record.dt).astype(np.intp)
    bends = []
    for i, (start, end) in enumerate(pairwise(waypoints)):
        positions = record.positions[samples[i] : samples[i + 1] + 1]
        chord = end - start
        fraction = np.clip((positions - start) @ chord / (chord @ chord), 0.0, 1.0)
        bends.append(np.abs(positions - start - fraction[:, None] * chord).max(initial=0.0))
    return np.array(bends)


def _solved(grid: Grid, record: Record, bends: Array, limits: JointLimits) -> Optimum | None:
    import casadi as ca  # here, so that the other modules do not need it

    velocity, acceleration, jerk = limits.velocity, limits.acceleration, limits.jerk
    n, steps, ways = len(velocity), len(grid.way), len(grid.step)
    h = ca.SX.sym('h', ways)
    q, v, a = (ca.SX.sym(name, n, steps + 1) for name in 'qva')  # as shares of V, V, A
    j, fraction = ca.SX.sym('j', n, steps), ca.SX.sym('s', steps + 1)
    hk = ca.repmat(ca.vertcat(*[h[int(i)] for i in grid.way]).T, n, 1)
    to_v = ca.repmat(ca.DM(acceleration / velocity), 1, steps) * a[:, :-1]
    to_a, jerk_v = (
        ca.repmat(ca.DM(jerk / scale), 1, steps) * j for scale in (acceleration, velocity)
    )
    rows = [
        a[:, 1:] - a[:, :-1] - hk * to_a,
        v[:, 1:] - v[:, :-1] - hk * to_v - hk**2 / 2 * jerk_v,
        q[:, 1:] - q[:, :-1] - hk * v[:, :-1] - hk**2 / 2 * to_v - hk**3 / 6 * jerk_v,
    ]
    inner = np.setdiff1d(np.arange(steps + 1), grid.first)
    start = grid.waypoints[grid.way[inner - 1]].T / velocity[:, None]
    chord = np.diff(grid.waypoints, axis=0)[grid.way[inner - 1]].T / velocity[:, None]
    tube = np.repeat(bends[grid.way[inner - 1]][None, :], n, axis=0) / velocity[:, None]
    along = ca.repmat(fraction[inner.tolist()].T, n, 1)
    rows.append(q[:, inner.tolist()] - ca.DM(start) - along * ca.DM(chord))
    exact = np.zeros(3 * n * steps)
    bound = np.concatenate([exact, tube.T.ravel()])

    low_q, high_q = (
        np.repeat((limit / velocity)[:, None], steps + 1, axis=1)
        for limit in (limits.position_min, limits.position_max)
    )
    low_q[:, grid.first] = high_q[:, grid.first] = grid.waypoints.T / velocity[:, None]
    high_v, high_a = np.full((n, steps + 1), VELOCITY_SHARE), np.ones((n, steps + 1))
    for at_rest in (high_v, high_a):
        at_rest[:, [0, -1]] = 0.0
    one = np.ones(n * steps)
    low = [np.full(ways, 1e-4), low_q, -high_v, -high_a, -one, np.zeros(steps + 1)]
    high = [np.ones(ways), high_q, high_v, high_a, one, np.ones(steps + 1)]

    moments = _times(grid.waypoints, record)[0] + np.append(0, np.cumsum(grid.step[grid.way]))
    sampled = record.dt * np.arange(len(record.positions))
    begin = [
        np.array([np.interp(moments, sampled, column) for column in table.T]) / scale[:, None]
        for table, scale in (
            (record.positions, velocity),
            (record.velocities, velocity),
            (record.accelerations, acceleration),
        )
    ]
    slope = np.diff(begin[2], axis=1) / grid.step[grid.way] * (acceleration / jerk)[:, None]
    guess = [grid.step, *begin, np.clip(slope, -1.0, 1.0), np.full(steps + 1, 0.5)]

    problem: dict[str, Any] = {
        'x': ca.vertcat(h, *(ca.vec(item) for item in (q, v, a, j)), fraction),
        'f': ca.dot(h, ca.DM(np.bincount(grid.way).astype(float))),
        'g': ca.vertcat(*(ca.vec(row) for row in rows)),
    }
    solver = ca.nlpsol('transcription', 'ipopt', problem, SOLVER)
    answer = solver(x0=_flat(guess), lbx=_flat(low), ubx=_flat(high), lbg=-bound, ubg=bound)
    if not solver.stats()['success']:
        return None
    x = np.array(answer['x']).ravel()
    jerks = x[ways + 3 * n * (steps + 1) :][: n * steps].reshape(steps, n) * jerk
    return _looked_at(grid, np.repeat(x[:ways], np.bincount(grid.way)), jerks, bends, limits)


def _flat(tables: list[Any]) -> Array:
    """Return tables as one vector, column by column like in CasADi."""
    return np.concatenate([np.asarray(table).T.ravel() for table in tables])


def _looked_at(
    grid: Grid, steps: Array, jerks: Array, bends: Array, limits: JointLimits
) -> Optimum | None:
    """Integrate the jerks (N, n) from rest. Returns None if a waypoint or chord is missed."""
    position, velocity = grid.waypoints[0].copy(), np.zeros(jerks.shape[1])
    acceleration = velocity.copy()
    fastest = liveliest = 0.0
    for k, (h, j) in enumerate(zip(steps, jerks, strict=True)):
        t = h * np.arange(LOOKS + 1)[:, None] / LOOKS
        positions = position + t * velocity + t**2 / 2 * acceleration + t**3 / 6 * j
        velocities = velocity + t * acceleration + t**2 / 2 * j
        accelerations = acceleration + t * j
        fastest = max(fastest, float(np.abs(velocities / limits.velocity).max()))
        liveliest = max(liveliest, float(np.abs(accelerations / limits.acceleration).max()))
        position, velocity, acceleration = positions[-1], velocities[-1], accelerations[-1]
        reached = np.flatnonzero(grid.first == k + 1)
        if reached.size and np.abs(position - grid.waypoints[reached[0]]).max() > 1e-4:
            return None
    hardest = float(np.abs(jerks / limits.jerk).max())
    return Optimum(float(steps.sum()), fastest, liveliest, hardest)


def main() -> int:
    """Recompute the optima of the benchmark's set, and store them."""
    parser = argparse.ArgumentParser(prog='benchmark.optimum', description=__doc__)
    parser.add_argument('--only', default='', help='trajectories whose name contains this')
    args = parser.parse_args()
    entries = json.loads(FILE.read_text(encoding='utf-8'))
    for name in FACTORS:
        for trajectory in sorted(benchmark_set(), key=lambda one: len(one.positions)):
            if args.only not in trajectory.name:
                continue
            limits, began = limit_set(name), time.process_time()
            entry = entries[digest(trajectory.positions, limits)]
            result = optimum(trajectory, limits)
            if result is not None:
                entry |= {'opt_by': 'ipopt', 'opt': round(result.duration, 6)}
                for what in ('velocity', 'acceleration', 'jerk'):
                    entry[f'opt_{what}'] = round(getattr(result, what), 5)
            took = time.process_time() - began
            print(
                f'{trajectory.name}, {name}: '
                f'{"nothing" if result is None else f"{result.duration:.3f} s"}, '
                f'after {took:.0f} s',
                flush=True,
            )
            FILE.write_text(json.dumps(entries, indent=1) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
