# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A small ray tracer for pictures without a graphics card: sun, sky, soft shadows, a floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from epson_driver.motion import Array

BACKGROUND = np.array([0.955, 0.962, 0.972])
SUN = np.array([0.55, -0.75, 1.0]) / np.linalg.norm([0.55, -0.75, 1.0])
SUN_SIZE = 0.11
"""How soft the shadows are: the sun's radius over its distance."""

CREASE_ANGLE_RAD = np.radians(35.0)
"""Faces that meet at a smaller angle are shaded as one smooth surface."""

RAYS_AT_ONCE = 1_000_000
"""How many rays are followed at once."""


@dataclass(frozen=True)
class Body:
    """A surface in the world with its colour (red, green, blue from 0 to 1) and its gloss."""

    mesh: trimesh.Trimesh
    colour: Sequence[float]
    gloss: float = 0.3


@dataclass(frozen=True)
class Camera:
    """Position of the eye, the point it looks at, and the height of the picture there; m."""

    eye: Sequence[float]
    target: Sequence[float]
    height: float


def render(
    bodies: Sequence[Body], camera: Camera, size: tuple[int, int], samples: int = 48
) -> Array:
    """Return a picture of bodies on the floor z = 0: shape (height, width, 3), of 0…255."""
    world = _World(bodies)
    width, height = size
    picture = np.zeros((height * width, 3))
    rows = max(RAYS_AT_ONCE // (width * samples), 1)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        v, u = np.mgrid[top:bottom, 0:width]
        pixels = np.stack([u.ravel(), v.ravel()], axis=1).repeat(samples, axis=0)
        chance = _even_numbers(len(pixels) // samples, samples, seed=top)
        origins, rays = _rays(camera, pixels + chance[:, :2], width, height)
        colours = np.clip(world.shade(origins, rays, chance[:, 2:]), 0.0, 1.0)
        picture[top * width : bottom * width] = colours.reshape(-1, samples, 3).mean(axis=1)
    return np.asarray(np.round(255.0 * picture.reshape(height, width, 3) ** (1 / 1.1)), np.uint8)


def _even_numbers(pixels: int, samples: int, seed: int) -> Array:
    """Return six numbers from 0 to 1 per sample, shape (pixels * samples, 6).

    Within a pixel they are spread more evenly than chance does (multiples of powers of the root
    of x^7 = x + 1, shifted by chance), so that fewer samples do.
    """
    root = 1.0
    for _ in range(30):
        root = (1.0 + root) ** (1.0 / 7.0)
    steps = np.arange(samples)[:, None] * root ** -np.arange(1.0, 7.0)
    shifts = np.random.default_rng(seed).random((pixels, 1, 6))
    return np.asarray(((shifts + steps) % 1.0).reshape(-1, 6))


def _axes(camera: Camera) -> tuple[Array, Array, Array]:
    """Return the vector to the target, and the picture's unit vectors to the right and up."""
    forward = np.array(camera.target) - np.array(camera.eye)
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    return forward, right, _unit(np.cross(right, forward))


def _rays(camera: Camera, pixels: Array, width: int, height: int) -> tuple[Array, Array]:
    forward, right, up = _axes(camera)
    scale = camera.height / height
    x, y = (pixels[:, 0] - width / 2.0) * scale, (height / 2.0 - pixels[:, 1]) * scale
    rays = _unit(forward + x[:, None] * right + y[:, None] * up)
    return np.broadcast_to(np.array(camera.eye), rays.shape), rays


class _World:
    """All triangles in one scene, with normals at their corners, and the floor."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        counts = [len(body.mesh.faces) for body in bodies]
        self._normals = np.concatenate([corner_normals(body.mesh) for body in bodies])
        self._colours = np.repeat([body.colour for body in bodies], counts, axis=0)
        self._gloss = np.repeat([body.gloss for body in bodies], counts)
        self._scene = rtcore_scene.EmbreeScene()
        triangles = np.concatenate([body.mesh.triangles for body in bodies])
        TriangleMesh(self._scene, triangles.astype(np.float32))

    def shade(self, origins: Array, rays: Array, chance: Array) -> Array:
        """Return the colour that each ray sees, shape (m, 3); chance: four numbers for each."""
        found = self._scene.run(
            origins.astype(np.float32), rays.astype(np.float32), query='INTERSECT', output=True
        )
        hit = found['primID'] >= 0
        colours = np.tile(BACKGROUND, (len(rays), 1))
        with np.errstate(divide='ignore'):
            depth = -origins[:, 2] / rays[:, 2]
        floor = ~hit & (depth > 0.0)
        points = origins[floor] + depth[floor, None] * rays[floor]
        colours[floor] *= self._floor_light(points, chance[floor])[:, None]
        which = found['primID'][hit]
        u, v = found['u'][hit, None], found['v'][hit, None]
        corners = self._normals[which]
        normals = _unit((1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2])
        normals[np.sum(normals * rays[hit], axis=1) > 0.0] *= -1.0
        points = origins[hit] + found['tfar'][hit, None] * rays[hit] + 1e-4 * normals
        sun, half = self._sun(points, chance[hit]), _unit(SUN - rays[hit])
        sky = self._sky(points, normals, chance[hit])
        light = 0.60 * np.maximum(normals @ SUN, 0.0) * sun + 0.54 * sky + 0.05
        shine = self._gloss[which] * np.maximum(np.sum(normals * half, axis=1), 0.0) ** 40 * sun
        edge = (1.0 - np.abs(np.sum(normals * rays[hit], axis=1))) ** 4
        shine += 0.25 * self._gloss[which] * edge * sky
        colours[hit] = self._colours[which] * light[:, None] + shine[:, None]
        return colours

    def _floor_light(self, points: Array, chance: Array) -> Array:
        up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        points = points + 1e-4 * up
        light = 0.45 * self._sun(points, chance) + 0.55 * self._sky(points, up, chance)
        return np.asarray(0.35 + 0.65 * light)

    def _sun(self, points: Array, chance: Array) -> Array:
        """Return whether each point sees one piece of the sun, as 0 or 1."""
        side = _unit(np.cross(SUN, [0.0, 0.0, 1.0]))
        angle, radius = 2.0 * np.pi * chance[:, 0], SUN_SIZE * np.sqrt(chance[:, 1])
        across = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(SUN, side)
        return self._free(points, _unit(SUN + radius[:, None] * across))

    def _sky(self, points: Array, normals: Array, chance: Array) -> Array:
        """Return how bright one piece of the sky is, or 0 where it is hidden."""
        height, angle = 2.0 * chance[:, 2] - 1.0, 2.0 * np.pi * chance[:, 3]
        across = np.sqrt(1.0 - height**2)
        sphere = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
        rays = _unit(normals + 0.999 * sphere)
        bright = np.where(rays[:, 2] > 0.0, 0.75 + 0.35 * rays[:, 2], 0.62 + 0.2 * rays[:, 2])
        return np.asarray(self._free(points, rays) * bright)

    def _free(self, points: Array, rays: Array) -> Array:
        if not len(points):
            return np.zeros(0)
        hits = self._scene.run(
            points.astype(np.float32), rays.astype(np.float32), query='OCCLUDED'
        )
        return np.asarray(hits == -1, dtype=float)


def corner_normals(mesh: trimesh.Trimesh) -> Array:
    """Return a normal for each corner of each face, shape (faces, 3, 3).

    That of the faces around the corner that meet this one smoothly, the larger ones more.
    """
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    areas = np.cross(b - a, c - a)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1), 1e-30)[:, None]
    around = mesh.vertex_faces[mesh.faces]  # (faces, 3, most), -1 where there are fewer
    together = np.einsum('fx,fcmx->fcm', normals, normals[around]) > np.cos(CREASE_ANGLE_RAD)
    together &= around >= 0
    sums = np.einsum('fcm,fcmx->fcx', together.astype(float), areas[around])
    lost = np.linalg.norm(sums, axis=2) < 1e-30
    sums[lost] = np.broadcast_to(normals[:, None], sums.shape)[lost]
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=2), 1e-30)[:, :, None])


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
