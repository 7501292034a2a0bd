# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The collision model: the arm with its gripper, the obstacles, and the part it carries.

Geometry from the model's URDF, distances from pinocchio and coal; the pairs of links that never
touch are those of the SRDF.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio
import pinocchio as pin

from epson_driver.motion import Array
from epson_driver.planning.shapes import Box, Shape
from epson_driver.planning.workspace import workspace
from epson_driver.robots import RobotModel
from epson_driver.robots.urdf import srdf, urdf


class Links(NamedTuple):
    """pinocchio's kinematic model and its geometry model: boxes and cylinders."""

    model: Any
    bodies: Any


def solid_links(model: RobotModel) -> Links:
    """Return the collision geometry of a model."""
    text = urdf(model.file)
    links = pinocchio.buildModelFromXML(text)
    kind = pinocchio.GeometryType.COLLISION
    return Links(links, pinocchio.buildGeomFromUrdfString(links, text, kind))


OBSTACLE_MARGIN_M = 0.010
"""What a plan keeps away from obstacles, m."""

SELF_MARGIN_M = 0.002
"""What two links keep from each other in a plan, m."""

MAX_CONTACT_DEPTH_M = 0.001
"""Where the part and what it stands on or hangs on touch, they may overlap so much, m."""

PART, GRIPPER = 'part', 'gripper'


@dataclass(frozen=True)
class Clearance:
    """Smallest distances, m: of arm and part to obstacles, and of links to each other.

    Below zero: a collision, `pair` names one. Contact that is meant (the part on its support)
    counts only as a collision if it is deeper than MAX_CONTACT_DEPTH_M.
    """

    obstacles: float
    links: float
    pair: tuple[str, str]

    @property
    def collides(self) -> bool:
        """Whether anything overlaps."""
        return min(self.obstacles, self.links) < 0.0


class Scene:
    """An arm among obstacles. `check` returns a collision check, with or without a held part.

    `part` is the size of the part, m; `supports` the names of what it may stand on.
    """

    def __init__(
        self,
        model: RobotModel,
        obstacles: Sequence[Shape],
        part: tuple[float, float, float],
        supports: Iterable[str],
    ) -> None:
        self.workspace = workspace(model)
        self.obstacles = (*self.workspace.fixed, *obstacles)
        self.part = part
        self.supports = frozenset(supports)
        self.robot = model
        self.model, self._arm = solid_links(model)
        self._arm.addAllCollisionPairs()
        pin.removeCollisionPairsFromXML(self.model, self._arm, srdf(model.file), False)
        self._tool = self.model.getFrameId('tool0')
        self._hand = pin.SE3(self.workspace.hand.frame)

    def hand_pose(self, joints: Array) -> Array:
        """Return the pose of the gripper in base_link, shape (4, 4): its z points to the part."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, joints)
        return np.asarray((data.oMf[self._tool] * self._hand).homogeneous)

    def check(
        self,
        standing: Array | None,
        *,
        margin: float = 0.0,
        self_margin: float = 0.0,
        touching: bool = True,
    ) -> 'Check':
        """Return a collision check of joint positions.

        `standing`: the pose of the hand that would grip the part where it stands, shape (4, 4);
        None while it is held. `touching`: the part may touch what it stands on or hangs on.
        """
        geometry = pin.GeometryModel(self._arm)
        links = [link.name for link in geometry.geometryObjects]
        length, radius = self.workspace.hand.length, self.workspace.hand.radius
        frame = self.model.frames[self._tool]
        hand = pin.GeometryObject(
            GRIPPER,
            frame.parentJoint,
            self._tool,
            frame.placement * self._hand * _along_z(length / 2),
            coal.Cylinder(radius, length),
        )
        moving = [*links, GRIPPER]
        geometry.addGeometryObject(hand)
        in_hand = _along_z(length + self.part[2] / 2)
        if standing is None:
            held = pin.GeometryObject(
                PART,
                hand.parentJoint,
                self._tool,
                frame.placement * self._hand * in_hand,
                coal.Box(*self.part),
            )
            moving.append(PART)
            still = []
        else:
            held = pin.GeometryObject(PART, 0, pin.SE3(standing) * in_hand, coal.Box(*self.part))
            still = [PART]
        geometry.addGeometryObject(held)
        for obstacle in self.obstacles:
            geometry.addGeometryObject(
                pin.GeometryObject(obstacle.name, 0, _placement(obstacle), _geometry(obstacle))
            )
            still.append(obstacle.name)
        own = len(geometry.collisionPairs)
        for pair in self._pairs(geometry, moving, still):
            geometry.addCollisionPair(
                pin.CollisionPair(*(geometry.getGeometryId(n) for n in pair))
            )
        return Check(self, geometry, own, margin, self_margin, touching)

    def _pairs(
        self, geometry: Any, moving: Sequence[str], still: Sequence[str]
    ) -> Iterable[tuple[str, str]]:
        """Yield the pairs of names that must not touch, but those of links."""
        level = {link.name: link.parentJoint for link in geometry.geometryObjects}
        for first, second in combinations(moving, 2):
            # what the hand holds never turns against the last link, nor moves along its axis
            if second in (GRIPPER, PART) and level[first] < self.model.njoints - 2:
                yield first, second
        for first, second in product(moving, still):
            if level[first] > 0:  # what stands still cannot come nearer
                yield first, second


class Check:
    """Judges joint positions, shape (n,), for one place of the part."""

    def __init__(
        self,
        scene: Scene,
        geometry: Any,
        own: int,
        margin: float,
        self_margin: float,
        touching: bool,
    ) -> None:
        self._model, self._geometry = scene.model, geometry
        self._data, self._results = scene.model.createData(), pin.GeometryData(geometry)
        names = [o.name for o in geometry.geometryObjects]
        self._pairs = [(names[p.first], names[p.second]) for p in geometry.collisionPairs]
        contacts = {frozenset((PART, name)) for name in (GRIPPER, *scene.supports)}
        self._contact = np.array([frozenset(pair) in contacts for pair in self._pairs])
        self._own = np.array([index < own for index in range(len(self._pairs))])
        # the gripper and the part against links are the arm against itself, too
        moving = {o.name for o in geometry.geometryObjects if o.parentJoint > 0}
        self._own |= np.array([set(pair) <= moving for pair in self._pairs])
        for index, request in enumerate(self._results.collisionRequests):
            if touching and self._contact[index]:
                request.security_margin = -MAX_CONTACT_DEPTH_M
            else:
                request.security_margin = self_margin if self._own[index] else margin

    def valid(self, joints: Array) -> bool:
        """Return whether everything keeps its margin."""
        return not pin.computeCollisions(
            self._model, self._data, self._geometry, self._results, joints, True
        )

    def path_valid(self, path: Array) -> bool:
        """Return whether all of a path is valid, shape (k, n), at the points given."""
        return all(self.valid(joints) for joints in path)

    def clearance(self, joints: Array) -> Clearance:
        """Return the smallest distances, without margins."""
        pin.computeDistances(self._model, self._data, self._geometry, self._results, joints)
        distances = np.array([r.min_distance for r in self._results.distanceResults])
        meant = self._contact & (distances >= -MAX_CONTACT_DEPTH_M)
        distances[meant] = np.inf
        obstacles = np.where(self._own, np.inf, distances)
        links = np.where(self._own, distances, np.inf)
        return Clearance(
            float(obstacles.min()), float(links.min()), self._pairs[int(np.argmin(distances))]
        )


def _along_z(distance: float) -> Any:
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, distance]))


def _placement(shape: Shape) -> Any:
    yaw = shape.yaw if isinstance(shape, Box) else 0.0
    return pin.SE3(pin.utils.rotate('z', yaw), np.array(shape.centre))


def _geometry(shape: Shape) -> Any:
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    return coal.Cylinder(shape.radius, shape.length)
