# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a check for collision costs with the collision meshes and with the visual ones.

Part of `make bench`. The C3 in random configurations, its links against each other (but for those
that a joint connects) and against a table with a fixture and a post. What is asked: whether bodies
touch, whether they come closer than a margin, and how far apart they are (servoing, optimising
planners, clearance). The first two are mostly decided by a tree of boxes around the bodies, as in
MoveIt, so that triangles count little; the last one needs them.
"""

import itertools
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.share import share_file

MARGIN_M = 0.01
"""How near is too near, m."""

MIN_DISTANCE_RATIO = 20.0
"""How many times cheaper a distance must be."""

Block: TypeAlias = tuple[str, tuple[float, float, float], tuple[float, float, float]]
"""A box: its name, its size and where its centre is in base_link, m."""

CELL: tuple[Block, ...] = (
    ('table', (1.2, 1.2, 0.04), (0.4, 0.0, -0.021)),
    ('fixture', (0.2, 0.3, 0.25), (0.42, 0.1, 0.13)),
    ('post', (0.05, 0.05, 0.6), (0.2, -0.35, 0.3)),
)

CONFIGURATIONS = 100
ROUNDS = 3


@dataclass(frozen=True)
class Result:
    """Times, s, of one check by each kind of mesh, and how many of the checks found a contact."""

    visual: float
    collision: float
    found: tuple[int, int]

    @property
    def ratio(self) -> float:
        """How many times cheaper the collision meshes are."""
        return self.visual / self.collision


class Checker:
    """Collision of a model's links with each other and with a cell, by pinocchio and coal."""

    def __init__(self, model: RobotModel, convex: bool, cell: Sequence[Block] = ()) -> None:
        """Take the collision meshes, as the convex solids they are, or the visual ones."""
        import coal
        import pinocchio

        from epson_driver.planning.links import convex_links, visual_links

        self._library: Any = pinocchio
        urdf = share_file('urdf', f'{model.name}.urdf')
        self._model, self._geometry, _ = convex_links(urdf) if convex else visual_links(urdf)
        bodies = self._geometry.geometryObjects
        pairs = [
            (i, j)
            for i, j in itertools.combinations(range(len(bodies)), 2)
            if abs(bodies[i].parentJoint - bodies[j].parentJoint) > 1
        ]
        moving = [i for i, body in enumerate(bodies) if body.parentJoint > 1]
        for name, size, place in cell:
            frame = pinocchio.SE3(np.eye(3), np.array(place))
            solid = pinocchio.GeometryObject(name, 0, frame, coal.Box(*size))
            index = self._geometry.addGeometryObject(solid)
            pairs += [(i, index) for i in moving]
        for pair in pairs:
            self._geometry.addCollisionPair(pinocchio.CollisionPair(*pair))
        self._data = self._model.createData()
        self._results = self._geometry.createData()
        self._margin = -1.0
        self._tree: Any = None

    def touches(self, position: Array, margin: float = 0.0) -> bool:
        """Return whether two bodies come nearer than `margin`, m."""
        if margin != self._margin:  # the tree keeps the requests it was made with
            self._margin = margin
            for request in self._results.collisionRequests:
                request.security_margin = margin
            self._tree = self._library.BroadPhaseManager_DynamicAABBTreeCollisionManager(
                self._model, self._geometry, self._results
            )
        found: bool = self._library.computeCollisions(
            self._model, self._data, self._tree, position, False
        )
        return found

    def near(self, position: Array) -> bool:
        """Return whether two bodies come nearer than MARGIN_M."""
        return self.touches(position, MARGIN_M)

    def distance(self, position: Array) -> float:
        """Return the smallest distance, m, of any two bodies."""
        nearest = self._library.computeDistances(
            self._model, self._data, self._geometry, self._results, position
        )
        return float(self._results.distanceResults[nearest].min_distance)

    def apart(self, position: Array) -> bool:
        """Return whether the smallest distance is none."""
        return self.distance(position) <= 0.0


QUESTIONS: dict[str, tuple[Callable[[Checker, Array], bool], float]] = {
    'do bodies touch': (Checker.touches, 1.0),
    f'are they nearer than {MARGIN_M * 1e3:.0f} mm': (Checker.near, 1.0),
    'how far are they apart': (Checker.apart, MIN_DISTANCE_RATIO),
}
"""What is asked, and how many times cheaper it must be."""


def measure(name: str = 'c3_a601s', configurations: int = CONFIGURATIONS) -> dict[str, Result]:
    """Return the result of each question for a model."""
    model = load_robot_model(name)
    low, high = model.limits.position_min, model.limits.position_max
    positions = np.random.default_rng(0).uniform(low, high, (configurations, len(low)))
    checkers = Checker(model, False, CELL), Checker(model, True, CELL)
    results = {}
    for question, (ask, _) in QUESTIONS.items():
        best, found = [np.inf, np.inf], [0, 0]
        for _ in range(ROUNDS):  # in turn, so that a busy machine is hard on both
            for i, checker in enumerate(checkers):
                begin = time.perf_counter()
                found[i] = sum(ask(checker, position) for position in positions)
                best[i] = min(best[i], (time.perf_counter() - begin) / len(positions))
        results[question] = Result(best[0], best[1], (found[0], found[1]))
    return results


def main() -> int:
    """Print a row for each question; return 1 if a ratio is too small."""
    print('C3-A601S in a cell         visual meshes   collision meshes   ratio   yes with either')
    missed = False
    for question, result in measure().items():
        missed |= result.ratio < QUESTIONS[question][1]
        print(
            f'{question:24}   {result.visual * 1e6:10.0f} us   {result.collision * 1e6:13.0f} us'
            f'   {result.ratio:5.1f}   {result.found[0]:6} {result.found[1]:5} of {CONFIGURATIONS}'
        )
    return 1 if missed else 0


if __name__ == '__main__':
    sys.exit(main())
