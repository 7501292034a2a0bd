# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Triangles as an image: the nearest one at each pixel, in parallel projection."""

from math import cos, sin

import numpy as np

from epson_driver.motion import Array

LIGHT = np.array([0.45, -0.35, 0.82]) / np.linalg.norm([0.45, -0.35, 0.82])
"""Where the light comes from."""


def view(azimuth: float, elevation: float) -> Array:
    """Return right, up and towards the eye as rows, (3, 3), for an eye in that direction, rad."""
    eye = (cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation))
    right = (-sin(azimuth), cos(azimuth), 0.0)
    return np.array([right, np.cross(eye, right), eye])


def rasterised(
    corners: Array,
    colours: Array,
    axes: Array,
    extent: tuple[float, float, float, float],
    size: int,
) -> Array:
    """Return an image, (h, w, 4), RGB and opacity from 0 to 1, the first row at the bottom.

    corners: shape (k, 3, 3), counter-clockwise from outside; colours: (k, 3). axes: a `view`.
    extent: left, right, bottom, top of what is shown along the first two of them, m. size: w.
    """
    left, right, bottom, top = extent
    scale = size / (right - left)
    image = np.zeros((round(scale * (top - bottom)), size, 4))
    depth = np.full(image.shape[:2], -np.inf)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals @ axes[2] > 1e-12
    normals = normals[facing] / np.linalg.norm(normals[facing], axis=1)[:, None]
    light = 0.6 + 0.4 * np.clip(normals @ LIGHT, 0.0, 1.0)
    shades = np.clip(colours[facing] * light[:, None], 0.0, 1.0)
    seen = (corners[facing] @ axes.T - (left, bottom, 0.0)) * (scale, scale, 1.0)
    lows = np.clip(np.floor(seen[..., :2].min(axis=1)).astype(int), 0, None)
    highs = np.ceil(seen[..., :2].max(axis=1)).astype(int) + 1
    for triangle, shade, (x0, y0), (x1, y1) in zip(seen, shades, lows, highs, strict=True):
        spot = depth[y0:y1, x0:x1]
        if not spot.size:
            continue
        y, x = np.ogrid[y0 : y0 + spot.shape[0], x0 : x0 + spot.shape[1]]
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangle
        double = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if double < 1e-9:
            continue
        b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / double
        c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / double
        near = az + b * (bz - az) + c * (cz - az)
        drawn = (b >= 0.0) & (c >= 0.0) & (b + c <= 1.0) & (near > spot)
        spot[drawn] = near[drawn]
        image[y0:y1, x0:x1][drawn] = (*shade, 1.0)
    return image


def halved(image: Array) -> Array:
    """Return an image of half the size, its edges smooth."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    small: Array = image[:height, :width].reshape(height // 2, 2, width // 2, 2, 4)
    weight = small[..., 3:]
    total = weight.sum(axis=(1, 3))
    colour = (small[..., :3] * weight).sum(axis=(1, 3)) / np.maximum(total, 1e-9)
    return np.concatenate([colour, total / 4.0], axis=-1)
