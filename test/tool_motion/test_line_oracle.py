# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random lines, arcs and blends compared with Pinocchio and independent geometry from the URDF.

A path that Pinocchio can follow step by step must be planned on the path and in the same
configuration. Other paths must be refused.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.urdf import urdf
from epson_driver.tool_motion.joint_path import PathError
from epson_driver.tool_motion.pose_path import arc, line, runs
from epson_driver.tool_motion.tool_trajectory import ToolLimits, trajectory_along_runs

pinocchio = pytest.importorskip('pinocchio')

MODELS = ('c3_a601s', 'vt6_a901s', 'gx4_c251s', 't6_602s')
SOAK_MODELS = ('c12_a1401s', 'cx4_a601s', 'gx8_c652s', 'rs4_c351s', 'ls6_602s')
EVERY_MODEL = [
    *MODELS,
    *(pytest.param(model, marks=pytest.mark.soak) for model in SOAK_MODELS),
]
ACCURACY_M = 1e-4
NOT_FARTHER_M = 2.8e-4
STEP_RAD = 0.02
"""Maximum joint step of the oracle, rad."""
SMALLEST_STEP = 1e-7
"""Smallest step as a fraction of the line. Larger joint steps within it are jumps."""
NOT_TURNED_RAD = 2e-3
"""Maximum rotation about other axes, rad."""
BLEND_M = 0.008
NEARLY = 1e-3
"""Distance to the end of a range, rad or m, below which both answers are accepted."""


class Followed(NamedTuple):
    """The fraction of a line that can be followed, and the joints there.

    `edge`: rounding decides whether the line can be followed.
    """

    share: float
    joints: np.ndarray
    edge: bool


class Oracle:
    """Follows poses by Newton's method."""

    def __init__(self, model):
        self.model = pinocchio.buildModelFromXML(urdf(model.file))
        self.data = self.model.createData()
        self.tool = self.model.getFrameId('tool0')
        self.limits = model.limits

    def pose(self, joints):
        pinocchio.framesForwardKinematics(self.model, self.data, joints)
        return self.data.oMf[self.tool].copy()

    def near(self, wanted, joints):
        """Return the joints of a pose nearest to `joints`, or None."""
        for _ in range(12):
            error = pinocchio.log6(self.pose(joints).actInv(wanted)).vector
            if np.linalg.norm(error) < 1e-10:
                return joints
            jacobian = pinocchio.computeFrameJacobian(self.model, self.data, joints, self.tool)
            joints = joints + np.linalg.lstsq(jacobian, error, rcond=1e-9)[0]
        return None

    def follow(self, start, end, place):
        """Follow a path from joints to a pose, shape (4, 4).

        `place` maps the fraction of the path to a position, shape (3,).
        """
        first, last = self.pose(start), pinocchio.SE3(end)
        turn = pinocchio.log3(first.rotation.T @ last.rotation)
        fraction, step, joints = 0.0, 0.01, start
        while fraction < 1.0:
            there = min(fraction + step, 1.0)
            wanted = pinocchio.SE3(
                first.rotation @ pinocchio.exp3(there * turn),
                place(there),
            )
            result = self.near(wanted, joints)
            if result is None or np.abs(result - joints).max() > STEP_RAD:
                if step < SMALLEST_STEP:
                    return Followed(fraction, joints, edge=False)
                step /= 2.0
                continue
            beyond = np.maximum(
                self.limits.position_min - result, result - self.limits.position_max
            ).max()
            if beyond > 0.0:
                return Followed(fraction, joints, edge=beyond < NEARLY and there == 1.0)
            fraction, step, joints = there, min(2.0 * step, 0.01), result
        return Followed(1.0, joints, edge=False)


def asked(arm, random):
    """Return random joints and a pose up to 0.3 m and half a radian away."""
    limits = arm.model.limits
    low, high = np.maximum(limits.position_min, -2.8), np.minimum(limits.position_max, 2.8)
    start = random.uniform(0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high)
    end = arm.forward(start)
    end[:3, 3] += random.normal(size=3) * random.choice([0.01, 0.05, 0.15])
    turn = random.uniform(-0.5, 0.5, 3) * (1.0 if len(start) == 6 else [0.0, 0.0, 1.0])
    end[:3, :3] = end[:3, :3] @ pinocchio.exp3(turn)
    return start, end


def between(trajectory, start, count):
    """Return joints along a trajectory, `count` for each cubic between points."""
    times = np.array([0.0, *trajectory.times])
    positions = np.vstack([start, trajectory.positions])
    velocities = np.vstack([0.0 * start, trajectory.velocities])
    fraction = np.linspace(0.0, 1.0, count)[:, None]
    result = []
    for index, dt in enumerate(np.diff(times)):
        p, q = positions[index : index + 2]
        v, w = dt * velocities[index : index + 2]
        result.append(
            p
            + fraction * v
            + fraction**2 * (3.0 * (q - p) - 2.0 * v - w)
            + fraction**3 * (2.0 * (p - q) + v + w)
        )
    return np.vstack(result)


def straight(first, last):
    """Return the positions on a line as a function of the fraction."""
    return lambda share: first + share * (last - first)


class Circle:
    """The circular arc through three positions."""

    def __init__(self, first, via, last):
        self.normal = np.cross(via - first, last - first)
        self.normal /= np.linalg.norm(self.normal)
        planes = np.array([via - first, last - first, self.normal])
        sides = [(via @ via - first @ first) / 2, (last @ last - first @ first) / 2]
        self.centre = np.linalg.solve(planes, [*sides, self.normal @ first])
        self.arm = first - self.centre
        self.radius = np.linalg.norm(self.arm)
        self.sweep = self.angle(last)
        assert self.angle(via) < self.sweep

    def angle(self, place):
        """Return the angle of a position, rad from 0 to 2π."""
        to = place - self.centre
        return np.arctan2(self.normal @ np.cross(self.arm, to), self.arm @ to) % (2 * np.pi)

    def place(self, share):
        return self.centre + pinocchio.exp3(share * self.sweep * self.normal) @ self.arm

    def away(self, places):
        """Return the distances of positions from the arc, shape (k,). They must be within it."""
        to = places - self.centre
        height = to @ self.normal
        level = np.linalg.norm(to - height[:, None] * self.normal, axis=1)
        slack = NOT_FARTHER_M / self.radius
        round_ = (np.array([self.angle(place) for place in places]) + slack) % (2 * np.pi)
        assert (round_ < self.sweep + 2 * slack).all()
        return np.hypot(height, level - self.radius)


def from_line(places, first, last):
    """Return the distances of positions from a line, shape (k,)."""
    path = last - first
    along = np.clip((places - first) @ path / max(path @ path, 1e-18), 0.0, 1.0)
    return np.linalg.norm(places - first - along[:, None] * path, axis=1)


def check(oracle, start, end, trajectory, off):
    """Assert that the trajectory is on the path and ends at the pose. Return its deviation.

    `off` returns the distances of positions from the path, shape (k,).
    """
    samples = between(trajectory, start, 8)
    places = np.array([oracle.pose(joints).translation for joints in samples])
    away = off(places).max()
    assert away < NOT_FARTHER_M
    assert np.abs(oracle.pose(samples[-1]).homogeneous - end).max() < 1e-7
    assert np.abs(np.diff(samples, axis=0)).max() < 0.3
    assert (samples > oracle.limits.position_min - 1e-6).all()
    assert (samples < oracle.limits.position_max + 1e-6).all()
    return away


def turns_evenly(oracle, start, end, trajectory):
    """Assert that the tool turns about one axis, in the shorter direction."""
    first = oracle.pose(start).rotation
    whole = pinocchio.log3(first.T @ end[:3, :3])
    for joints in between(trajectory, start, 3):
        turn = pinocchio.log3(first.T @ oracle.pose(joints).rotation)
        fraction = turn @ whole / max(whole @ whole, 1e-18)
        assert np.linalg.norm(turn - fraction * whole) < NOT_TURNED_RAD
        assert -1e-3 < fraction < 1.001


TOOL = ToolLimits(0.1, 1.0, 1.0, 10.0, ACCURACY_M, slow=True, jerk_ratio=10.0)


@pytest.mark.slow
@pytest.mark.parametrize(('kind', 'count'), [('line', 50), ('arc', 25)])
@pytest.mark.parametrize('model', EVERY_MODEL)
def test_only_infeasible_paths_are_refused(model, kind, count):
    arm = Kinematics(load_robot_model(model))
    oracle = Oracle(arm.model)
    random = np.random.default_rng(31)
    driven, worst, wrong = 0, 0.0, []
    for _ in range(count):
        start, end = asked(arm, random)
        begin = arm.forward(start)
        first, last = begin[:3, 3], end[:3, 3]
        if kind == 'line':
            path, place = line(begin, end), straight(first, last)
            off = partial(from_line, first=first, last=last)
        else:
            aside = random.normal(size=3) * 0.4 * np.linalg.norm(last - first)
            via = (first + last) / 2 + aside
            circle = Circle(first, via, last)
            path, place, off = arc(begin, via, end), circle.place, circle.away
        followed = oracle.follow(start, end, place)
        try:
            trajectory = trajectory_along_runs(arm, start, runs([path], []), TOOL)
        except PathError as error:
            if followed.share == 1.0:
                wrong.append(f'{start.tolist()} to {end.tolist()} is refused: {error}')
        else:
            driven += 1
            if followed.share < 1.0 and not followed.edge:
                wrong.append(f'{start.tolist()} to {end.tolist()} is driven')
                continue
            worst = max(worst, check(oracle, start, end, trajectory, off))
            turns_evenly(oracle, start, end, trajectory)
            assert trajectory.positions[-1] == pytest.approx(followed.joints, abs=1e-6)
    print(f'{model}: {driven} of {count} {kind}s driven, {worst * 1e3:.3f} mm off at most')
    assert not wrong
    assert 0.1 < driven / count < 0.9


@pytest.mark.slow
@pytest.mark.parametrize('model', EVERY_MODEL)
def test_corners_are_cut_only_within_their_blend(model):
    arm = Kinematics(load_robot_model(model))
    oracle = Oracle(arm.model)
    random = np.random.default_rng(32)
    driven, worst, most = 0, 0.0, 0.0
    for _ in range(30):
        start, corner = asked(arm, random)
        end = corner.copy()
        end[:3, 3] += random.normal(size=3) * 0.05
        first = arm.forward(start)
        three = np.array([first[:3, 3], corner[:3, 3], end[:3, 3]])
        if np.linalg.norm(np.diff(three, axis=0), axis=1).min() < BLEND_M:
            continue
        way = [line(first, corner), line(corner, end)]
        try:
            trajectory = trajectory_along_runs(arm, start, runs(way, [BLEND_M]), TOOL)
        except PathError:
            continue
        driven += 1
        cut = []

        def off(places, three=three, cut=cut):
            away = np.minimum(from_line(places, *three[:2]), from_line(places, *three[1:]))
            near = np.linalg.norm(places - three[1], axis=1) < BLEND_M + ACCURACY_M
            cut.append(np.max(away[near]))
            return away[~near]

        worst = max(worst, check(oracle, start, end, trajectory, off))
        most = max(most, *cut)
        assert most < BLEND_M / 2
    print(f'{model}: {driven} blends, {most * 1e3:.2f} mm cut, {worst * 1e3:.3f} mm off elsewhere')
    assert driven > 4
