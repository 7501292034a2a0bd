# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random lines against Pinocchio, which follows them step by step, by the URDF alone.

What it can follow is planned, on the line and in the same configuration; what it cannot is
refused.
"""

from typing import NamedTuple

import numpy as np
import pytest

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.urdf import urdf
from epson_driver.tool_motion.joint_path import PathError
from epson_driver.tool_motion.pose_path import line, runs
from epson_driver.tool_motion.tool_trajectory import ToolLimits, runs_trajectory

pinocchio = pytest.importorskip('pinocchio')

MODELS = (
    'c3_a601s',
    'c12_a1401s',
    'cx4_a601s',
    'vt6_a901s',
    'gx4_c251s',
    'gx8_c652s',
    'rs4_c351s',
    'ls6_602s',
    't6_602s',
)
ACCURACY_M = 1e-4
NOT_FARTHER_M = 2.8e-4
STEP_RAD = 0.02
"""Joints go so far at most from one look to the next."""
SMALLEST_STEP = 1e-7
"""Where so small a share of the line asks for more, the joints would have to jump."""
NEARLY = 1e-3
"""So near to the end of a range, rad or m, either answer is right."""


class Followed(NamedTuple):
    """How far a line can be followed, and the joints there; `edge`: it is a matter of rounding."""

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
        """Return joints near to others that lead to a pose, or None."""
        for _ in range(12):
            error = pinocchio.log6(self.pose(joints).actInv(wanted)).vector
            if np.linalg.norm(error) < 1e-10:
                return joints
            jacobian = pinocchio.computeFrameJacobian(self.model, self.data, joints, self.tool)
            joints = joints + np.linalg.lstsq(jacobian, error, rcond=1e-9)[0]
        return None

    def follow(self, start, end):
        """Follow a line from joints to a pose, shape (4, 4)."""
        first, last = self.pose(start), pinocchio.SE3(end)
        turn = pinocchio.log3(first.rotation.T @ last.rotation)
        share, step, joints = 0.0, 0.01, start
        while share < 1.0:
            there = min(share + step, 1.0)
            wanted = pinocchio.SE3(
                first.rotation @ pinocchio.exp3(there * turn),
                first.translation + there * (last.translation - first.translation),
            )
            found = self.near(wanted, joints)
            if found is None or np.abs(found - joints).max() > STEP_RAD:
                if step < SMALLEST_STEP:
                    return Followed(share, joints, edge=False)
                step /= 2.0
                continue
            beyond = np.maximum(
                self.limits.position_min - found, found - self.limits.position_max
            ).max()
            if beyond > 0.0:
                return Followed(share, joints, edge=beyond < NEARLY and there == 1.0)
            share, step, joints = there, min(2.0 * step, 0.01), found
        return Followed(1.0, joints, edge=False)


def asked(arm, random):
    """Return joints, and a pose that is up to 0.3 m and half a radian away."""
    limits = arm.model.limits
    low, high = np.maximum(limits.position_min, -2.8), np.minimum(limits.position_max, 2.8)
    start = random.uniform(0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high)
    end = arm.forward(start)
    end[:3, 3] += random.normal(size=3) * random.choice([0.01, 0.05, 0.15])
    turn = random.uniform(-0.5, 0.5, 3) * (1.0 if len(start) == 6 else [0.0, 0.0, 1.0])
    end[:3, :3] = end[:3, :3] @ pinocchio.exp3(turn)
    return start, end


def between(trajectory, start, count):
    """Return joints all along a trajectory, cubic between its points, `count` in each."""
    times = np.array([0.0, *trajectory.times])
    positions = np.vstack([start, trajectory.positions])
    velocities = np.vstack([0.0 * start, trajectory.velocities])
    share = np.linspace(0.0, 1.0, count)[:, None]
    found = []
    for index, dt in enumerate(np.diff(times)):
        p, q = positions[index : index + 2]
        v, w = dt * velocities[index : index + 2]
        found.append(
            p
            + share * v
            + share**2 * (3.0 * (q - p) - 2.0 * v - w)
            + share**3 * (2.0 * (p - q) + v + w)
        )
    return np.vstack(found)


def check(oracle, start, end, trajectory):
    """Assert that the way between points is on the line and ends there; return how far off."""
    looks = between(trajectory, start, 8)
    first = oracle.pose(start)
    way = end[:3, 3] - first.translation
    places = np.array([oracle.pose(joints).translation for joints in looks]) - first.translation
    along = np.clip(places @ way / max(way @ way, 1e-18), 0.0, 1.0)
    away = np.linalg.norm(places - along[:, None] * way, axis=1).max()
    assert away < NOT_FARTHER_M
    assert np.abs(oracle.pose(looks[-1]).homogeneous - end).max() < 1e-7
    assert np.abs(np.diff(looks, axis=0)).max() < 0.3
    return away


@pytest.mark.slow
@pytest.mark.parametrize('model', MODELS)
def test_lines_are_refused_where_there_is_no_way_and_only_there(model):
    arm = Kinematics(load_robot_model(model))
    oracle = Oracle(arm.model)
    random = np.random.default_rng(31)
    tool = ToolLimits(0.1, 1.0, 1.0, 10.0, ACCURACY_M, slow=True, jerk_ratio=10.0)
    driven, worst, wrong = 0, 0.0, []
    for _ in range(50):
        start, end = asked(arm, random)
        followed = oracle.follow(start, end)
        try:
            way = runs([line(arm.forward(start), end)], [])
            trajectory = runs_trajectory(arm, start, way, tool)
        except PathError as error:
            if followed.share == 1.0:
                wrong.append(f'{start.tolist()} to {end.tolist()} is refused: {error}')
        else:
            driven += 1
            if followed.share < 1.0 and not followed.edge:
                wrong.append(f'{start.tolist()} to {end.tolist()} is driven')
                continue
            worst = max(worst, check(oracle, start, end, trajectory))
            assert trajectory.positions[-1] == pytest.approx(followed.joints, abs=1e-6)
    print(f'{model}: {driven} of 50 lines driven, {worst * 1e3:.3f} mm off at most')
    assert not wrong
    assert 5 < driven < 45
