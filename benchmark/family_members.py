# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Families of trajectories that are hard for a planner, each member random by its seed.

The points represent extreme inputs from planners, programs and people.
"""

import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmark.limit_sets import limit_set
from epson_driver.motion import Array, JointLimits

WORK_SEEDS, MEASURED_SEEDS = range(8), range(11000, 11008)
"""Seeds for development, and separate ones for the reported figures, which influenced no
choice."""

MAX_BORDER_DISTANCE_RAD = 0.1
"""Maximum distance of points from the border of the range."""

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
    """A trajectory of a family: points of shape (k, n), rad or m, and its limits."""

    positions: Array
    limits: JointLimits


Make = Callable[[np.random.Generator], FamilyMember]


def inside(rng: np.random.Generator, limits: JointLimits, share: float = 0.8) -> Array:
    """Return a random pose in the middle `share` of the range."""
    middle = (limits.position_max + limits.position_min) / 2.0
    half = (limits.position_max - limits.position_min) / 2.0
    return middle + rng.uniform(-share, share, len(half)) * half


def splined(poses: Array, count: int) -> Array:
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
    poses = np.array([inside(rng, limits) for _ in range(6)])
    return FamilyMember(splined(poses, int(rng.integers(20, 120))), limits)


def _dense(rng: np.random.Generator) -> FamilyMember:
    limits = limit_set('full')
    poses = np.array([inside(rng, limits, 0.6) for _ in range(24)])
    return FamilyMember(splined(poses, 5000), limits)


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
    """One joint to and fro, over distances of any size."""
    limits = limit_set('full')
    joint = int(rng.integers(6))
    positions = np.tile(inside(rng, limits, 0.3), (int(rng.integers(12, 40)), 1))
    reach = rng.choice([0.02, 0.1, 0.4])
    ways = rng.uniform(-reach, reach, len(positions)).cumsum()
    low, high = limits.position_min[joint] + 0.1, limits.position_max[joint] - 0.1
    positions[:, joint] = np.clip(positions[:, joint] + ways, low, high)
    return FamilyMember(positions, limits)


def _near_limits(rng: np.random.Generator) -> FamilyMember:
    """Points within 0.1 rad of a border of the range, in some joints."""
    limits = limit_set('full')
    positions = np.array([inside(rng, limits) for _ in range(int(rng.integers(8, 20)))])
    near = rng.random(positions.shape) < 0.3
    distance = rng.uniform(1e-3, MAX_BORDER_DISTANCE_RAD, positions.shape)
    border = np.where(
        rng.random(6) < 0.5, limits.position_min + distance, limits.position_max - distance
    )
    return FamilyMember(np.where(near, border, positions), limits)


def _on_border(rng: np.random.Generator) -> FamilyMember:
    """A random path that is clipped at the border of the range, as programs do it."""
    limits = limit_set('full')
    poses = np.array([inside(rng, limits, 1.4) for _ in range(7)])
    positions = splined(poses, int(rng.integers(15, 60)))
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
    points = [inside(rng, limits, 0.6)]
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
    """Points 0.25 to 0.5 mrad from their predecessors, between longer distances."""
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
    return FamilyMember(inside(rng, limits, 0.3) + np.cumsum(steps, axis=0), limits)


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


FAMILIES: dict[str, tuple[str, Make]] = {
    'b_spline': ('a B-spline through random poses', _b_spline),
    'zigzag': ('to and fro across a line', _zigzag),
    'single_joint': ('one joint there and back, ways of any size', _single_joint),
    'near_limits': ('some joints within 0.1 rad of the border of their range', _near_limits),
    'on_border': ('clipped at the border of the range', _on_border),
    'poses_on_border': ('poses with joints on the border of their range', _poses_on_border),
    'mixed_sizes': ('steps of 1 mrad to 1 rad in one trajectory', _mixed_sizes),
    'duplicates': ('points twice and three times over', _duplicates),
    'close_pairs': ('pairs of points 0.25 to 0.5 mrad apart', _close_pairs),
    'tiny_steps': ('200 steps of 0.3 to 2 mrad', _tiny_steps),
    'wrist_flip': ('two joints turn fast within a slow motion', _wrist_flip),
    'scara': ('down, up and across with a SCARA', _scara),
    'extreme_limits': ('A/J of 10 to 400 ms, joint by joint', _extreme_limits),
    'dense': ('5,000 points', _dense),
}
"""Name to description, and a function that makes a member."""

LONG_FAMILIES = ('dense',)
"""Families for which the first seed's member is enough, because it is as long as all members of
another family."""


def members(name: str, seeds: Iterable[int] = WORK_SEEDS) -> Iterator[FamilyMember]:
    """Return the trajectories of a family, the same ones every time."""
    _, make = FAMILIES[name]
    for seed in seeds:
        yield make(np.random.default_rng([seed, zlib.crc32(name.encode())]))
        if name in LONG_FAMILIES:
            break
