# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Verdict on received joint states: the clearance of the arm, and the poses it reached."""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array
from epson_driver.planning.path import dense
from epson_driver.planning.plan import Motion, Plan

POSITION_TOLERANCE_M = 1e-3
"""How far from a pose the tool may end, m."""

ANGLE_TOLERANCE_RAD = np.radians(0.2)
"""And how far turned away from it, rad."""

STANDING_CHANGE_RAD = 2e-6
"""Joint states that differ by less, rad, are from an arm that stands: some encoder pulses."""

MIN_STOP_S = 0.02
"""It must stand for so long, s: joint states that came late and at once are no stop."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """One executed motion, judged by its joint states, in m and rad.

    clearances: to obstacles, at each state, shape (k,). links: the smallest distance of two links.
    pair: what came nearest to each other, obstacles or links. collides: at a state, or on the
    straight line between two. stops: on the way. missed, turned: the tool against the pose at the
    end, 0 for home.
    """

    clearances: Array
    links: float
    pair: tuple[str, str]
    collides: bool
    stops: int
    missed: float
    turned: float

    @property
    def reached(self) -> bool:
        """Whether the pose at the end was reached."""
        return self.missed <= POSITION_TOLERANCE_M and self.turned <= ANGLE_TOLERANCE_RAD


def judge(plan: Plan, motion: Motion, times: Array, positions: Array) -> Verdict:
    """Return the verdict on joint states in the order they came: (k,), s, and (k, n), rad."""
    check = plan.scene.check(motion.standing)
    found = [check.clearance(joints) for joints in positions]
    worst = min(found, key=lambda each: min(each.obstacles, each.links))
    between = check.path_valid(dense(positions, plan.scene.workspace.metric))
    missed, turned = 0.0, 0.0
    if motion.reaches is not None:
        hand = plan.scene.hand_pose(positions[-1])
        missed, turned = apart(hand, motion.reaches)
    return Verdict(
        np.array([each.obstacles for each in found]),
        min(each.links for each in found),
        worst.pair,
        worst.collides or not between,
        stops(times, positions),
        missed,
        turned,
    )


def stops(times: Array, positions: Array) -> int:
    """Return how often the arm stood for a while between its first and its last movement."""
    still = np.abs(np.diff(positions, axis=0)).max(axis=1) < STANDING_CHANGE_RAD
    moving = np.flatnonzero(~still)
    if not moving.size:
        return 0
    edges = np.diff(still[: moving[-1] + 1].astype(int), prepend=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    ends = ends[len(ends) - len(begins) :]
    stood = times[ends] - times[begins] >= MIN_STOP_S
    return int(np.sum(stood & (begins > moving[0])))


def apart(pose: Array, other: Array) -> tuple[float, float]:
    """Return how far two poses are from each other, m, and by how much turned, rad.

    Quarter turns about the tool's own axis do not count: the part looks the same.
    """
    turn = pose[:3, :3].T @ other[:3, :3]
    tilt = np.arccos(np.clip(turn[2, 2], -1.0, 1.0))
    about = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    about = (about + np.pi / 4) % (np.pi / 2) - np.pi / 4
    return float(np.linalg.norm(pose[:3, 3] - other[:3, 3])), float(np.hypot(tilt, about))
