# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The trajectories of the benchmark: twelve generated ones (fixed seeds) and the shared plans."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmark.limit_sets import FACTORS, MAX_VELOCITY_RAD_S
from epson_driver.motion import Array
from epson_driver.trajectory_file import read_trajectory

SHARED = Path(__file__).parents[1] / 'config' / 'trajectories'
WITHOUT_TIMES = 'around_pillar_positions_only'
"""The shared plan that is run as if it had no times."""

PLANS = (
    'around_pillar_11_points',
    'around_pillar_fast_100ms',
    WITHOUT_TIMES,
    'pick_and_place_20ms',
    'shuttle_1000_points',
)

MIN_POSE_RAD = np.array([-1.6, -1.6, 0.2, -1.6, -1.5, -2.5])
MAX_POSE_RAD = np.array([1.6, 0.1, 2.0, 1.6, -0.2, 2.5])
"""Range of generated poses, rad: well inside the arm's range, so that a spline stays inside."""

BLEND_RAD = 0.15
"""Distance before a corner at which a generated plan leaves the straight line, rad."""


@dataclass(frozen=True, eq=False)
class BenchmarkTrajectory:
    """A trajectory in its streamed form.

    positions: (n, 6), rad. durations: (n,), s, from the previous point, 0 for the first, or None
    if the plan has no times.
    """

    name: str
    positions: Array
    durations: Array | None

    @property
    def commanded(self) -> float | None:
        """The commanded time from the first point to the last, s."""
        return None if self.durations is None else float(self.durations.sum())

    def first(self, points: int) -> 'BenchmarkTrajectory':
        """Return the same up to a number of points."""
        durations = None if self.durations is None else self.durations[:points]
        return replace(self, positions=self.positions[:points], durations=durations)


def benchmark_set() -> tuple[BenchmarkTrajectory, ...]:
    """Return all trajectories, the generated ones first. They are the same every time."""
    generated = [_named(name, make) for name, make in GENERATED.items()]
    return (*generated, *(_shared(SHARED / f'{name}.yaml') for name in PLANS))


def _shared(path: Path) -> BenchmarkTrajectory:
    plan = read_trajectory(path)
    durations = None if path.stem == WITHOUT_TIMES else np.diff(plan.times, prepend=plan.times[0])
    return BenchmarkTrajectory(path.stem, plan.positions, durations)


def _named(name: str, make: Callable[[], tuple[Array, Array]]) -> BenchmarkTrajectory:
    positions, durations = make()
    # nine decimals, as plans in files have them: the last bits differ from machine to machine
    return BenchmarkTrajectory(name, positions.round(9), durations.round(9))


GRID_INTERVALS = 4000
"""Number of path intervals over which a timing is integrated."""


@dataclass(frozen=True, eq=False)
class TimedPath:
    """A path sampled densely in time: times (m,), s, increasing from 0; positions (m, n), rad."""

    times: Array
    positions: Array

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return float(self.times[-1])

    def at(self, times: Array) -> Array:
        """Return the positions at some times, shape (len(times), n)."""
        columns = [np.interp(times, self.times, column) for column in self.positions.T]
        return np.stack(columns, axis=1)


def random_vias(rng: np.random.Generator, count: int, low: Array, high: Array) -> Array:
    """Return `count` poses inside a box, each within reach of the one before, shape (count, n)."""
    vias = [rng.uniform(low, high)]
    for _ in range(count - 1):
        step = rng.uniform(-0.45, 0.45, low.size) * (high - low)
        vias.append(np.clip(vias[-1] + step, low, high))
    return np.array(vias)


def blended(vias: Array, blend: float) -> Array:
    """Return a dense path along the polyline of the vias, shape (GRID_INTERVALS + 1, n).

    Its steps are of equal length. Corners become parabolas that start `blend` rad before them, at
    most halfway.
    """
    pieces = [vias[:1]]
    for before, corner, after in zip(vias, vias[1:], vias[2:], strict=False):
        into, out = before - corner, after - corner
        a, b = (min(blend / float(np.linalg.norm(side)), 0.5) for side in (into, out))
        t = np.linspace(0.0, 1.0, 400)[:, None]
        pieces.append(
            (1 - t) ** 2 * (corner + a * into)
            + t**2 * (corner + b * out)
            + 2 * t * (1 - t) * corner
        )
    pieces.append(vias[-1:])
    points = np.concatenate(pieces)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], GRID_INTERVALS + 1)
    return np.stack([np.interp(at, lengths, column) for column in points.T], axis=1)


def fastest_timing(path: Array, velocity: Array, acceleration: Array) -> TimedPath:
    """Return the fastest timing of a dense path (m, n) from rest to rest within two limits (n,).

    x = ṡ² over the path's index s: each joint's acceleration is q′·x′/2 + q″·x.
    """
    first = np.gradient(path, axis=0)
    second = np.gradient(first, axis=0)
    with np.errstate(divide='ignore'):
        cap = np.min((velocity / np.abs(first)) ** 2, axis=1)
        # room for the curve itself, so that both passes find an acceleration that is allowed
        cap = np.minimum(cap, np.min(0.7 * acceleration / np.abs(second), axis=1))
    forward = _pass(cap, first, second, acceleration)
    backward = _pass(cap[::-1], -first[::-1], second[::-1], acceleration)[::-1]
    speed = np.sqrt(np.minimum(forward, backward))
    times = np.concatenate([[0.0], np.cumsum(2.0 / (speed[1:] + speed[:-1]))])
    return TimedPath(times, path)


def _pass(cap: Array, first: Array, second: Array, acceleration: Array) -> Array:
    x = np.empty_like(cap)
    x[0] = 0.0
    for i in range(len(cap) - 1):
        with np.errstate(divide='ignore', invalid='ignore'):
            rate = (acceleration - np.abs(second[i]) * x[i]) / np.abs(first[i])
        x[i + 1] = min(cap[i + 1], x[i] + 2.0 * max(float(np.nanmin(rate)), 0.0))
    return x


def _timed(seed: int, vias: int, speed: float, blend: float = BLEND_RAD) -> TimedPath:
    rng = np.random.default_rng(seed)
    return _timing_of(blended(random_vias(rng, vias, MIN_POSE_RAD, MAX_POSE_RAD), blend), speed)


def _timing_of(path: Array, speed: float) -> TimedPath:
    return fastest_timing(
        path, speed * MAX_VELOCITY_RAD_S, speed * FACTORS['full'].acceleration * MAX_VELOCITY_RAD_S
    )


def _every(path: TimedPath, step: float) -> tuple[Array, Array]:
    """Return the plan at every `step` s and at its end."""
    whole = np.arange(0.0, path.duration - 0.3 * step, step)
    times = np.append(whole, path.duration)
    return path.at(times), np.diff(times, prepend=0.0)


def _points(path: TimedPath, count: int) -> tuple[Array, Array]:
    times = np.linspace(0.0, path.duration, count)
    return path.at(times), np.diff(times, prepend=0.0)


def _reversal() -> tuple[Array, Array]:
    rng = np.random.default_rng(61)
    there = blended(random_vias(rng, 3, MIN_POSE_RAD, MAX_POSE_RAD), BLEND_RAD)
    half = _timing_of(there, 0.6)
    positions, durations = _points(half, 30)
    return (
        np.concatenate([positions, positions[-2::-1]]),
        np.concatenate([durations, durations[:0:-1]]),
    )


def _repeated() -> tuple[Array, Array]:
    """Points doubled in passing, points three times over, and one commanded rest of 0.4 s."""
    positions, durations = _every(_timed(71, 4, 0.25), 0.06)
    times = {5: 2, 12: 3, len(positions) // 2: 2, len(positions) - 1: 2}
    rests = {len(positions) // 2: 0.4}
    rows, steps = [], []
    for index, (position, duration) in enumerate(zip(positions, durations, strict=True)):
        for copy in range(times.get(index, 1)):
            rows.append(position)
            steps.append(float(duration) if not copy else rests.get(index, 0.004))
    return np.array(rows), np.array(steps)


def _tiny_steps() -> tuple[Array, Array]:
    """Steps from 0.1 to 1 mrad with small side-steps, as a hand-guided or servoed motion has."""
    rng = np.random.default_rng(81)
    direction = np.array([0.6, -0.4, 0.5, -0.7, 0.3, 1.0])
    steps = rng.uniform(1e-4, 1e-3, 299)[:, None] * direction
    steps += rng.uniform(-2e-5, 2e-5, steps.shape)
    positions = (
        np.concatenate([np.zeros((1, 6)), np.cumsum(steps, axis=0)])
        + (MIN_POSE_RAD + MAX_POSE_RAD) / 2
    )
    return positions, np.append(0.0, np.full(299, 0.008))


def _sparse_corners() -> tuple[Array, Array]:
    """Nine poses far apart, each asked for at half of the speed on the straight line."""
    rng = np.random.default_rng(91)
    positions = rng.uniform(MIN_POSE_RAD, MAX_POSE_RAD, (9, 6))
    steps = np.max(np.abs(np.diff(positions, axis=0)) / MAX_VELOCITY_RAD_S, axis=1)
    return positions, np.append(0.0, 2.0 * steps + 0.15)


def _too_fast() -> tuple[Array, Array]:
    """A plan at full speed whose clock runs 1.5 times too fast."""
    positions, durations = _every(_timed(95, 5, 1.0), 0.02)
    return positions, durations / 1.5


GENERATED: dict[str, Callable[[], tuple[Array, Array]]] = {
    'moveit_10_percent': lambda: _every(_timed(11, 4, 0.1), 0.1),
    'moveit_50_percent': lambda: _every(_timed(12, 5, 0.5), 0.04),
    'moveit_100_percent': lambda: _every(_timed(13, 6, 1.0), 0.02),
    'totg_100ms': lambda: _every(_timed(21, 6, 1.0), 0.1),
    'totg_100ms_long': lambda: _every(_timed(22, 10, 0.3), 0.1),
    'dense_4ms': lambda: _every(_timed(31, 5, 0.4), 0.004),
    'dense_4ms_slow': lambda: _every(_timed(32, 4, 0.15), 0.004),
    'reversal': _reversal,
    'repeated_points': _repeated,
    'tiny_steps': _tiny_steps,
    'sparse_corners': _sparse_corners,
    'too_fast': _too_fast,
}
