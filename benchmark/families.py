# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Families of trajectories that are hard for a planner: what share of its plans fails, and stops.

Each family is random, with fixed seeds: points from a corner of what planners, programs and people
send. What counts here is not the time of one trajectory but how often the smoother finds no plan.
"""

import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np

from benchmark.limit_sets import limit_set, ramp_time
from benchmark.metrics import stops
from benchmark.motion_record import Record
from benchmark.stop_and_go import stop_and_go
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.planner import Plan, Request, plan

MAX_BORDER_DISTANCE_RAD = 0.1
"""How near points lie to the border of the range."""

SAMPLE_STEP_S = 0.001

MAX_MOTION_S = 120.0
"""A motion that takes longer than this, s, has failed."""

KEYS = ('position', 'velocity', 'acceleration')

RUNS = ((Mode.TIME_OPTIMAL, None), (Mode.TIME_OPTIMAL, 3.0), (Mode.TIME_PRESERVING, 3.0))
"""In which modes each trajectory is run, and how much is known ahead, A/J; None: all."""

COMMANDED_PACE = 2.0
"""A commanded duration is so many times that of the slowest joint at full speed …"""

MIN_DURATION_S = 0.004
"""… and at least this."""

SCARA = JointLimits(
    ('joint_1', 'joint_2', 'joint_3', 'joint_4'),
    np.array([-2.3, -2.6, -0.15, -6.2]),
    np.array([2.3, 2.6, 0.0, 6.2]),
    np.array([7.85, 11.8, 1.1, 36.6]),
    np.array([78.0, 118.0, 11.0, 366.0]),
    np.array([780.0, 1180.0, 110.0, 3660.0]),
    ('rad', 'rad', 'm', 'rad'),
)


@dataclass(frozen=True, eq=False)
class FamilyMember:
    """A trajectory of a family: points of shape (k, n), rad or m, and the limits it runs under."""

    positions: Array
    limits: JointLimits


Make = Callable[[np.random.Generator], FamilyMember]


def _inside(rng: np.random.Generator, limits: JointLimits, share: float = 0.8) -> Array:
    """Return a random pose in the middle `share` of the range."""
    middle = (limits.position_max + limits.position_min) / 2.0
    half = (limits.position_max - limits.position_min) / 2.0
    return middle + rng.uniform(-share, share, len(half)) * half


def _splined(poses: Array, count: int) -> Array:
    """Return points of a uniform cubic B-spline with these control points, shape (count, n)."""
    padded = np.concatenate([poses[:1]] * 2 + [poses] + [poses[-1:]] * 2)
    s = np.linspace(0.0, len(padded) - 3 - 1e-9, count)
    i, t = s.astype(int), (s % 1.0)[:, None]
    weights = (
        (1.0 - t) ** 3,
        3.0 * t**3 - 6.0 * t**2 + 4.0,
        -3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0,
        t**3,
    )
    parts = [weight / 6.0 * padded[i + k] for k, weight in enumerate(weights)]
    result: Array = np.sum(parts, axis=0)
    return result


def _b_spline(rng: np.random.Generator) -> FamilyMember:
    limits = limit_set('full')
    poses = np.array([_inside(rng, limits) for _ in range(6)])
    return FamilyMember(_splined(poses, int(rng.integers(20, 120))), limits)


def _dense(rng: np.random.Generator) -> FamilyMember:
    limits = limit_set('full')
    poses = np.array([_inside(rng, limits, 0.6) for _ in range(24)])
    return FamilyMember(_splined(poses, 5000), limits)


def _zigzag(rng: np.random.Generator) -> FamilyMember:
    limits = limit_set('full')
    along = rng.normal(size=6)
    aside = rng.normal(size=6)
    along *= rng.uniform(0.02, 0.1) / np.abs(along).max()
    aside *= rng.uniform(0.02, 0.3) / np.abs(aside).max()
    count = int(rng.integers(15, 40))
    steps = np.arange(count)[:, None] * along + (np.arange(count) % 2)[:, None] * aside
    steps -= (steps.max(axis=0) + steps.min(axis=0)) / 2.0
    middle = (limits.position_max + limits.position_min) / 2.0
    return FamilyMember(np.clip(middle + steps, limits.position_min, limits.position_max), limits)


def _single_joint(rng: np.random.Generator) -> FamilyMember:
    """One joint to and fro, by ways of any size."""
    limits = limit_set('full')
    joint = int(rng.integers(6))
    positions = np.tile(_inside(rng, limits, 0.3), (int(rng.integers(12, 40)), 1))
    reach = rng.choice([0.02, 0.1, 0.4])
    ways = rng.uniform(-reach, reach, len(positions)).cumsum()
    low, high = limits.position_min[joint] + 0.1, limits.position_max[joint] - 0.1
    positions[:, joint] = np.clip(positions[:, joint] + ways, low, high)
    return FamilyMember(positions, limits)


def _near_limits(rng: np.random.Generator) -> FamilyMember:
    """Points within 0.1 rad of a border of the range, in some joints."""
    limits = limit_set('full')
    positions = np.array([_inside(rng, limits) for _ in range(int(rng.integers(8, 20)))])
    near = rng.random(positions.shape) < 0.3
    distance = rng.uniform(1e-3, MAX_BORDER_DISTANCE_RAD, positions.shape)
    border = np.where(
        rng.random(6) < 0.5, limits.position_min + distance, limits.position_max - distance
    )
    return FamilyMember(np.where(near, border, positions), limits)


def _on_border(rng: np.random.Generator) -> FamilyMember:
    """A random way that is clipped at the border of the range, as programs do it."""
    limits = limit_set('full')
    poses = np.array([_inside(rng, limits, 1.4) for _ in range(7)])
    positions = _splined(poses, int(rng.integers(15, 60)))
    return FamilyMember(np.clip(positions, limits.position_min, limits.position_max), limits)


def _poses_on_border(rng: np.random.Generator) -> FamilyMember:
    """Poses far apart, in which some joints are on the border of their range."""
    member = _near_limits(rng)
    low, high = member.limits.position_min, member.limits.position_max
    positions = np.where(member.positions - low < MAX_BORDER_DISTANCE_RAD, low, member.positions)
    positions = np.where(high - positions < MAX_BORDER_DISTANCE_RAD, high, positions)
    return FamilyMember(positions, member.limits)


def _mixed_sizes(rng: np.random.Generator) -> FamilyMember:
    """Tiny steps among huge ones."""
    limits = limit_set('full')
    points = [_inside(rng, limits, 0.6)]
    for _ in range(int(rng.integers(12, 40))):
        unit = rng.normal(size=6)
        size = 10.0 ** rng.uniform(-3.0, 0.0)
        new = points[-1] + size * unit / np.abs(unit).max()
        points.append(np.clip(new, 0.9 * limits.position_min, 0.9 * limits.position_max))
    return FamilyMember(np.array(points), limits)


def _duplicates(rng: np.random.Generator) -> FamilyMember:
    member = _b_spline(rng)
    copies = rng.choice([1, 1, 1, 2, 3], len(member.positions))
    return FamilyMember(np.repeat(member.positions, copies, axis=0), member.limits)


def _close_pairs(rng: np.random.Generator) -> FamilyMember:
    """Points 0.25 to 0.5 mrad from the one before, amid longer ways."""
    member = _b_spline(rng)
    points: list[Array] = []
    for position in member.positions[:: int(rng.integers(1, 4))]:
        points.append(position)
        if rng.random() < 0.4:
            unit = rng.normal(size=6)
            points.append(position + rng.uniform(2.5e-4, 5e-4) * unit / np.abs(unit).max())
    return FamilyMember(np.array(points), member.limits)


def _tiny_steps(rng: np.random.Generator) -> FamilyMember:
    limits = limit_set('full')
    direction = rng.normal(size=6)
    steps = rng.uniform(3e-4, 2e-3, 200)[:, None] * direction / np.abs(direction).max()
    steps += rng.uniform(-3e-5, 3e-5, steps.shape)
    return FamilyMember(_inside(rng, limits, 0.3) + np.cumsum(steps, axis=0), limits)


def _wrist_flip(rng: np.random.Generator) -> FamilyMember:
    """A slow motion of the arm in which joints 4 and 6 turn by half a turn within a few points."""
    member = _b_spline(rng)
    positions = member.positions.copy()
    count = len(positions)
    s = np.linspace(-1.0, 1.0, count)
    turn = 1.5 * np.tanh(s / rng.uniform(0.02, 0.1))
    positions *= 0.3
    positions += (member.limits.position_max + member.limits.position_min) / 2.0 * 0.7
    positions[:, 3] += turn
    positions[:, 5] -= turn
    return FamilyMember(positions, member.limits)


def _scara(rng: np.random.Generator) -> FamilyMember:
    """Pick and place: down, up, across."""
    points = []
    for _ in range(int(rng.integers(3, 7))):
        x, y, turn = rng.uniform(-2.0, 2.0), rng.uniform(-2.2, 2.2), rng.uniform(-3.0, 3.0)
        points += [[x, y, z, turn] for z in (-0.02, -0.08, -0.13, -0.08, -0.02)]
    return FamilyMember(np.array(points), SCARA)


def _extreme_limits(rng: np.random.Generator) -> FamilyMember:
    """A/J from 10 ms to 0.4 s, V/A from 20 ms to 1 s, different for every joint."""
    member = _b_spline(rng)
    limits = member.limits
    acceleration = limits.velocity / 10.0 ** rng.uniform(np.log10(0.02), 0.0, 6)
    jerk = acceleration / 10.0 ** rng.uniform(-2.0, np.log10(0.4), 6)
    slower = JointLimits(
        limits.names,
        limits.position_min,
        limits.position_max,
        limits.velocity,
        acceleration,
        jerk,
    )
    return FamilyMember(member.positions, slower)


FAMILIES: dict[str, tuple[str, int, Make]] = {
    'b_spline': ('a B-spline through random poses', 8, _b_spline),
    'zigzag': ('to and fro across a line', 8, _zigzag),
    'single_joint': ('one joint there and back, ways of any size', 8, _single_joint),
    'near_limits': ('some joints within 0.1 rad of the border of their range', 8, _near_limits),
    'on_border': ('clipped at the border of the range', 8, _on_border),
    'poses_on_border': ('poses with joints on the border of their range', 8, _poses_on_border),
    'mixed_sizes': ('steps of 1 mrad to 1 rad in one trajectory', 8, _mixed_sizes),
    'duplicates': ('points twice and three times over', 8, _duplicates),
    'close_pairs': ('pairs of points 0.25 to 0.5 mrad apart', 8, _close_pairs),
    'tiny_steps': ('200 steps of 0.3 to 2 mrad', 8, _tiny_steps),
    'wrist_flip': ('two joints turn fast within a slow motion', 8, _wrist_flip),
    'scara': ('down, up and across with a SCARA', 8, _scara),
    'extreme_limits': ('A/J of 10 to 400 ms, joint by joint', 8, _extreme_limits),
    'dense': ('5,000 points', 1, _dense),
}
"""Name to what it is, how many trajectories, and what makes one."""


@dataclass
class FamilyFigures:
    """What a family's runs came to.

    plans: how many were asked for; failed: for how many of them none was found. stops: rests at
    neither end of a motion. time_ratio: worst time of a time-optimal run with all known / point to
    point. velocity, acceleration, jerk: largest multiple of the limit. outside: of the position
    limits, rad. unfinished: runs that did not end. violations: of the limits, seen by the
    smoother's own guard. plan_median, plan_p99: CPU time of a plan, s.
    """

    name: str
    runs: int = 0
    plans: int = 0
    failed: int = 0
    stops: int = 0
    time_ratio: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    outside: float = 0.0
    unfinished: int = 0
    violations: int = 0
    plan_median: float = 0.0
    plan_p99: float = 0.0

    @property
    def failed_share(self) -> float:
        """The share of plans that failed."""
        return self.failed / max(self.plans, 1)

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return asdict(self)


class _Counting:
    """The planner, counted."""

    def __init__(self, figures: FamilyFigures) -> None:
        self.figures = figures
        self.costs: list[float] = []

    def __call__(self, request: Request, limits: JointLimits) -> Plan | None:
        began = time.process_time()
        found = plan(request, limits)
        self.costs.append(time.process_time() - began)
        self.figures.plans += 1
        self.figures.failed += found is None
        return found


def members(name: str) -> Iterator[FamilyMember]:
    """Return the trajectories of a family, the same ones every time."""
    _, count, make = FAMILIES[name]
    for seed in range(count):
        yield make(np.random.default_rng([seed, zlib.crc32(name.encode())]))


def run_family(name: str) -> FamilyFigures:
    """Run every trajectory of a family in every mode."""
    figures = FamilyFigures(name)
    planner = _Counting(figures)
    for member in members(name):
        reference = stop_and_go(member.positions, member.limits).duration
        for mode, ahead in RUNS:
            known = np.inf if ahead is None else ahead * ramp_time(member.limits)
            duration = _run(member, mode, known, planner)
            if ahead is None:
                figures.time_ratio = max(figures.time_ratio, duration / reference)
    figures.plan_median = float(np.median(planner.costs))
    figures.plan_p99 = float(np.percentile(planner.costs, 99))
    return figures


def _run(member: FamilyMember, mode: Mode, known: float, planner: _Counting) -> float:
    """Return how long one motion takes, s, and count what happens in it."""
    positions, limits, figures = member.positions, member.limits, planner.figures
    smoother = Smoother(limits, positions[0], mode, planner=planner)
    ways = np.max(np.abs(np.diff(positions, axis=0)) / limits.velocity, axis=1)
    durations = np.maximum(COMMANDED_PACE * ways, MIN_DURATION_S)
    fed = 1
    rows = [smoother.motion]
    while fed < len(positions) or smoother.moving:
        while fed < len(positions) and smoother.look_ahead < known:
            smoother.append(positions[fed], float(durations[fed - 1]))
            fed += 1
            if fed == len(positions):
                smoother.finish()
        rows.append(smoother.step(SAMPLE_STEP_S))
        if smoother.now > MAX_MOTION_S:
            figures.unfinished += 1
            break
    q, v, a = (np.array([getattr(row, key) for row in rows]) for key in KEYS)
    none = np.zeros(0)
    record = Record(SAMPLE_STEP_S, q, v, a, none, none.astype(np.bool_))
    figures.runs += 1
    figures.stops += len(stops(record, limits))
    figures.violations += smoother.violations
    for key, values, limit in (
        ('velocity', v, limits.velocity),
        ('acceleration', a, limits.acceleration),
        ('jerk', np.diff(a, axis=0) / SAMPLE_STEP_S, limits.jerk),
    ):
        worst = max(getattr(figures, key), float(np.max(np.abs(values) / limit)))
        setattr(figures, key, worst)
    beyond = np.maximum(limits.position_min - q, q - limits.position_max)
    figures.outside = max(figures.outside, float(beyond.max()))
    return smoother.now
