# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Links of an arm that touch each other, determined by Pinocchio."""

from collections.abc import Iterator
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pinocchio

from epson_driver.motion import Array, JointLimits
from epson_driver.robots import RobotModel
from epson_driver.robots.urdf import urdf

LIMIT_PROBABILITY = 0.5
"""Probability of a joint at one of its limits, in every other sample."""


class CollisionBodies:
    """The collision geometry of a model, which determines touching pairs of links.

    Pairs are numbered like `pairs`, and links are in the order of the chain.
    """

    def __init__(self, model: RobotModel) -> None:
        text = urdf(model.file)
        self._model = pinocchio.buildModelFromXML(text)
        self._bodies = pinocchio.buildGeomFromUrdfString(
            self._model, text, pinocchio.GeometryType.COLLISION
        )
        self._data = self._model.createData()
        owners = [
            self._model.frames[body.parentFrame].name for body in self._bodies.geometryObjects
        ]
        self.links = tuple(dict.fromkeys(owners))
        self.pairs = tuple(combinations(self.links, 2))
        self.adjacent = frozenset(_neighbours(text)) & frozenset(self.pairs)
        number = {pair: index for index, pair in enumerate(self.pairs)}
        self._pair_of_check = []
        for first, second in combinations(range(len(owners)), 2):
            pair = number.get((owners[first], owners[second]))
            # None: two bodies of one link. Neighbours always overlap in their joint
            if pair is not None and self.pairs[pair] not in self.adjacent:
                self._bodies.addCollisionPair(pinocchio.CollisionPair(first, second))
                self._pair_of_check.append(pair)
        self._checks = self._bodies.createData()

    def touching(self, angles: Array) -> set[int]:
        """Return the numbers of touching pairs, except neighbours, for angles in rad, (n,)."""
        pinocchio.computeCollisions(
            self._model, self._data, self._bodies, self._checks, angles, False
        )
        results = self._checks.collisionResults
        return {
            pair
            for pair, result in zip(self._pair_of_check, results, strict=True)
            if result.isCollision()
        }

    def distance(self, angles: Array) -> float:
        """Return the smallest distance of two links without a common joint, m."""
        nearest = pinocchio.computeDistances(
            self._model, self._data, self._bodies, self._checks, angles
        )
        return float(self._checks.distanceResults[nearest].min_distance)


def random_configurations(limits: JointLimits, number: int, seed: int) -> Iterator[Array]:
    """Yield configurations within the limits, shape (n,), which depend on the seed alone.

    Every other one, from the first, is uniform. In the others each joint may be at one of its
    limits like in a folded arm, which uniform samples rarely reach.
    """
    random = np.random.default_rng(seed)
    low, high = limits.position_min, limits.position_max
    for index in range(number):
        angles = random.uniform(low, high)
        if index % 2:
            ends = np.where(random.random(low.size) < 0.5, low, high)
            angles = np.where(random.random(low.size) < LIMIT_PROBABILITY, ends, angles)
        yield angles


def _neighbours(text: str) -> Iterator[tuple[str, str]]:
    for joint in ElementTree.fromstring(text).findall('joint'):
        parent, child = joint.find('parent'), joint.find('child')
        if parent is not None and child is not None:
            yield parent.get('link', ''), child.get('link', '')
