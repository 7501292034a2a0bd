# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Which links of an arm cannot collide, or always do: found by sampling its configurations.

The links are the collision geometry of urdf/NAME.urdf, each piece taken as its convex hull; coal
tells whether two of them touch, pinocchio where they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio

from epson_driver.motion import Array, JointLimits
from epson_driver.planning.links import convex_links

ROOT = Path(__file__).resolve().parents[1]
LIMIT_PROBABILITY = 0.5
"""In every other sample, the probability that a joint is at one of its limits."""


@dataclass(frozen=True, order=True)
class Pair:
    """Two links that need no collision check, and why: Adjacent, Always, Default or Never."""

    link1: str
    link2: str
    reason: str


class CollisionBodies:
    """The collision geometry of one URDF, to ask which pairs of links touch.

    Pairs are numbered as in `pairs`; links come in the order of the chain.
    """

    def __init__(self, urdf: Path) -> None:
        self._model, self._bodies, text = convex_links(urdf)
        self._data = self._model.createData()
        owners = [
            self._model.frames[each.parentFrame].name for each in self._bodies.geometryObjects
        ]
        self.links = tuple(dict.fromkeys(owners))
        self.pairs = tuple(combinations(self.links, 2))
        self.adjacent = frozenset(_neighbours(text)) & frozenset(self.pairs)
        number = {pair: index for index, pair in enumerate(self.pairs)}
        self._pair_of_check = []
        for first, second in combinations(range(len(owners)), 2):
            pair = number.get((owners[first], owners[second]))
            # None: two pieces of one link. Neighbours overlap in their joint: not worth a check
            if pair is not None and self.pairs[pair] not in self.adjacent:
                self._bodies.addCollisionPair(pinocchio.CollisionPair(first, second))
                self._pair_of_check.append(pair)
        self._checks = self._bodies.createData()

    def touching(self, angles: Array) -> set[int]:
        """Return the numbers of the pairs that touch, neighbours apart; angles in rad, (n,)."""
        pinocchio.computeCollisions(
            self._model, self._data, self._bodies, self._checks, angles, False
        )
        results = self._checks.collisionResults
        return {
            pair
            for pair, result in zip(self._pair_of_check, results, strict=True)
            if result.isCollision()
        }


def random_configurations(limits: JointLimits, number: int, seed: int) -> Iterator[Array]:
    """Yield configurations within the limits, shape (n,), the same ones for the same seed.

    The first and every other one is uniform; in the rest each joint may be at one of its
    limits, as a folded arm does: uniform samples hardly ever come there.
    """
    random = np.random.default_rng(seed)
    low, high = limits.position_min, limits.position_max
    for index in range(number):
        angles = random.uniform(low, high)
        if index % 2:
            ends = np.where(random.random(low.size) < 0.5, low, high)
            angles = np.where(random.random(low.size) < LIMIT_PROBABILITY, ends, angles)
        yield angles


def disabled_pairs(
    bodies: CollisionBodies, limits: JointLimits, number: int, seed: int
) -> list[Pair]:
    """Return the pairs that a planner need not check, in the order of the chain."""
    counts = [0] * len(bodies.pairs)
    for angles in random_configurations(limits, number, seed):
        for pair in bodies.touching(angles):
            counts[pair] += 1
    at_zero = bodies.touching(np.zeros(len(limits.names)))
    found = []
    for index, links in enumerate(bodies.pairs):
        if links in bodies.adjacent:
            reason = 'Adjacent'
        elif counts[index] == number:
            reason = 'Always'
        elif index in at_zero:
            reason = 'Default'
        elif counts[index] == 0:
            reason = 'Never'
        else:
            continue
        found.append(Pair(*links, reason))
    return found


def _neighbours(text: str) -> Iterator[tuple[str, str]]:
    for joint in ElementTree.fromstring(text).findall('joint'):
        parent, child = joint.find('parent'), joint.find('child')
        if parent is not None and child is not None:
            yield parent.get('link', ''), child.get('link', '')
