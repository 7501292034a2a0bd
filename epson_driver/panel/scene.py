# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One arm in the 3D view: its meshes, the plan as a ghost, and the tool's path."""

import numpy as np
import viser
from numpy.typing import NDArray

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.panel.smooth_mesh import Mesh, arm_meshes, quaternion
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics

MIN_CHANGE = 2e-5
"""A joint that moved by less is not redrawn, rad or m: a fiftieth of a pixel."""

MAX_PATH_POINTS = 600
MIN_STEP_M = 0.002
"""The tool's path has a point wherever it went on by this much, m."""

MAX_PLAN_POINTS = 300

DRIVEN_COLOUR = (19, 111, 209)
PLANNED_COLOUR = (240, 140, 20)
DRIVEN_M, PLANNED_M = 0.0035, 0.005
"""How thick the paths are, m: each shows beside the other where they agree."""

GHOST_COLOUR = (245, 159, 40)
GHOST_MARGIN_M = 0.0012
"""The ghost is larger than the arm by this much, m: surfaces in one place would flicker."""

STALE_COLOUR = (150, 150, 150)


class ArmScene:
    """An arm below `path` in the scene, its base at `place`, shape (3,), m."""

    def __init__(
        self, viewer: viser.ViserServer, path: str, model: RobotModel, place: Array, label: str
    ) -> None:
        self._viewer = viewer
        self._path = path
        self._model = model
        self._kinematics = Kinematics(model)
        viewer.scene.add_frame(path, show_axes=False, position=place)
        shape = arm_meshes(model)
        self._arm = _Joints(viewer, f'{path}/arm', model, shape, None)
        self._ghost = _Joints(viewer, f'{path}/ghost', model, shape, GHOST_COLOUR)
        self._ghost.visible(False)
        if label:
            viewer.scene.add_label(f'{path}/name', label, position=(0.0, 0.0, -0.06))
        self._driven = _Path()
        self._followed: _Path | None = _Path()
        """The way of the reference, as it goes, of a goal whose plan is not known."""

    def show(self, joints: Array) -> None:
        """Draw the arm with its joints where they were measured, and go on with the path."""
        if not self._arm.show(joints):
            return
        self._driven.add(self._kinematics.forward(joints)[:3, 3])

    def grey(self, stale: bool) -> None:
        """Take the colours away while it is not known where the arm is."""
        self._arm.grey(stale)

    def show_path(self) -> None:
        """Draw the path that the tool has driven, and that of the plan, if they have gone on."""
        if (driven := self._driven.news()) is not None:
            self._line('driven', driven, DRIVEN_COLOUR, DRIVEN_M)
        if self._followed is not None and (planned := self._followed.news()) is not None:
            self._line('planned', planned, PLANNED_COLOUR, PLANNED_M)

    def show_ghost(self, joints: Array | None) -> None:
        """Draw where the plan is now, or nothing for None."""
        self._ghost.visible(joints is not None)
        if joints is not None and self._ghost.show(joints) and self._followed is not None:
            self._followed.add(self._kinematics.forward(joints)[:3, 3])

    def show_plan(self, plan: Trajectory | None) -> None:
        """Draw the tool's path of a plan, and forget what was driven before.

        None: the plan is not known, and its path is drawn as the reference goes on.
        """
        self._driven = _Path()
        self._followed = _Path() if plan is None else None
        self._remove('driven')
        self._remove('planned')
        if plan is None or len(plan.times) < 2:
            return
        times = np.linspace(plan.times[0], plan.times[-1], MAX_PLAN_POINTS)
        way = Interpolation(plan.times, plan.positions, plan.velocities)
        dense, _, _ = way.at(times)
        points = np.array([self._kinematics.forward(joints)[:3, 3] for joints in dense])
        self._line('planned', points, PLANNED_COLOUR, PLANNED_M)

    def _line(
        self, name: str, points: Array, colour: tuple[int, int, int], thickness: float
    ) -> None:
        self._viewer.scene.add_line_segments(
            f'{self._path}/{name}',
            np.stack([points[:-1], points[1:]], axis=1).astype(np.float32),
            colour,
            thickness=thickness,
        )

    def _remove(self, name: str) -> None:
        self._viewer.scene.remove_by_name(f'{self._path}/{name}')


class _Path:
    """Where the tool was: a point wherever it went on by MIN_STEP_M."""

    def __init__(self) -> None:
        self._points: list[Array] = []
        self._drawn: Array | None = None

    def add(self, point: Array) -> None:
        """Go on to a point, shape (3,), m."""
        if not self._points or np.linalg.norm(point - self._points[-1]) >= MIN_STEP_M:
            self._points.append(point)
            del self._points[:-MAX_PATH_POINTS]

    def news(self) -> Array | None:
        """Return all points, shape (n, 3), if there are more than when last asked, else None."""
        if len(self._points) < 2 or self._points[-1] is self._drawn:
            return None
        self._drawn = self._points[-1]
        return np.array(self._points)


class _Joints:
    """The links of an arm, each below the one before, so that a joint is one small message."""

    def __init__(
        self,
        viewer: viser.ViserServer,
        path: str,
        model: RobotModel,
        shape: list[list[Mesh]],
        ghost: tuple[int, int, int] | None,
    ) -> None:
        self._chain, self._types = model.chain, model.joint_types
        self._shown = np.full(len(model.joint_types), np.nan)
        self._root = viewer.scene.add_frame(path, show_axes=False)
        self._links = []
        self._meshes: list[tuple[viser.MeshHandle, tuple[int, int, int]]] = []
        self._grey = False
        below = path
        for index, meshes in enumerate(shape):
            if index:
                below = f'{below}/link_{index}'
                origin = self._chain.origins[index - 1]
                self._links.append(viewer.scene.add_frame(below, show_axes=False, position=origin))
            elif ghost is not None:
                continue  # the base stands where it stands
            for number, mesh in enumerate(meshes):
                handle = viewer.scene.add_mesh_simple(
                    f'{below}/mesh_{number}',
                    mesh.vertices if ghost is None else _grown(mesh),
                    mesh.faces,
                    color=ghost or mesh.colour,
                    opacity=None if ghost is None else 0.28,
                    cast_shadow=ghost is None,
                    receive_shadow=ghost is None,
                )
                self._meshes.append((handle, mesh.colour))
        self.show(np.zeros(len(self._types)))

    def show(self, joints: Array) -> bool:
        """Turn the joints and return whether anything was worth drawing."""
        changed = ~(np.abs(joints - self._shown) < MIN_CHANGE)
        for index in np.flatnonzero(changed):
            axis, value = self._chain.axes[index], float(joints[index])
            if self._types[index] == 'prismatic':
                self._links[index].position = self._chain.origins[index] + axis * value
            else:
                self._links[index].wxyz = quaternion(axis, value)
            self._shown[index] = value
        return bool(changed.any())

    def grey(self, grey: bool) -> None:
        """Show it without its colours, or with them."""
        if grey != self._grey:
            self._grey = grey
            for handle, colour in self._meshes:
                handle.color = STALE_COLOUR if grey else colour

    def visible(self, shown: bool) -> None:
        """Show or hide all of it."""
        if self._root.visible != shown:
            self._root.visible = shown


def _grown(mesh: Mesh) -> NDArray[np.float32]:
    """Return the vertices of a mesh, moved outwards by GHOST_MARGIN_M."""
    corners = mesh.vertices[mesh.faces]
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], facets)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return mesh.vertices + np.float32(GHOST_MARGIN_M) * normals
