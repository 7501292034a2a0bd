# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Straight moves in joint space with blends between them.

In a blend, the tool stays within the blend radius of the corner. The blend cuts the corner
symmetrically: at full speed, the joints need equal times before and after the corner. A blend has
two continuous derivatives. The joints stay between the positions of the two moves, and therefore
within their ranges.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.interpolation import hermite, polynomial
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.joint_path import Checkpoint, JointPath
from epson_driver.tool_motion.path_timing import TimedRun, timed
from epson_driver.tool_motion.pose_path import BlendError
from epson_driver.tool_motion.speed_profile import PartLimits, fraction_of_limits, highest

SAMPLES = 100
"""Number of samples of each move and of each blend."""

STEP_RAD = 0.01
"""Joint step between samples of the tool's distance from a corner, rad or m."""

MIN_SAMPLES, MAX_SAMPLES = 50, 2000

SHRINK = 0.8
"""Factor by which a blend is reduced repeatedly until the tool stays within the radius."""

MAX_SHRINKS = 60

ACCURACY_FRACTION = 0.1
"""Maximum distance of the tool from the path between points, relative to the smallest radius."""

SHORTEST_MOVE_S = 1e-6
"""Minimum duration of a move at full speed."""

RESERVE_FRACTION = 0.01
"""Unused fraction of the limits in a blend, because its derivatives are only sampled."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A move without its blends, or a blend.

    size: duration at full speed, s. coefficients: coefficients of polynomials from the fraction of
    the part, [0, 1], to the joint positions, shape (6, n).
    """

    size: float
    coefficients: Array
    limits: JointLimits
    blend: bool

    def derivative(self, fractions: Array, order: int = 0) -> Array:
        return polynomial(self.coefficients, fractions, order)


def blended_joints(
    kinematics: Kinematics,
    start: Array,
    targets: Sequence[Array],
    radii: Sequence[float],
    limits: Sequence[JointLimits],
    checkpoint: Checkpoint = lambda: None,
) -> TimedRun:
    """Return the fastest motion from rest to rest, straight in joint space except in blends.

    radii: blend radius of the tool at the end of each move except the last, m. limits: joint
    limits of each move. A blend respects the limits of both moves. checkpoint: called at every
    step of planning. It may raise to cancel.

    Raises BlendError if a blend does not fit or a move has no length, or PathError if no motion is
    possible.
    """
    parts = _parts(kinematics, [start, *targets], radii, limits, checkpoint)
    seams = np.concatenate([[0.0], np.cumsum([part.size for part in parts])])
    samples = [np.linspace(*ends, SAMPLES, endpoint=False) for ends in pairwise(seams)]
    distances = np.concatenate([*samples, seams[-1:]])

    def joints_at(queried: Array) -> Array:
        indices = np.clip(np.searchsorted(seams, queried, 'right') - 1, 0, len(parts) - 1)
        joints = np.empty((len(queried), len(start)))
        for index, part in enumerate(parts):
            inside = indices == index
            joints[inside] = part.derivative((queried[inside] - seams[index]) / part.size)
        return joints

    joints = joints_at(distances)
    positions = _tool_positions(kinematics, joints, checkpoint)
    blends = [part.blend for part in parts]
    ends = np.append((seams[:-1] + seams[1:])[blends] / 2.0, seams[-1])
    return timed(
        JointPath('the way', kinematics, distances, joints, positions, joints_at, checkpoint),
        [_part_limits(part) for part in parts],
        ends,
        accuracy=ACCURACY_FRACTION * min(radii),
        slow=True,  # only because of rounding: the parts respect the limits
    )


def _parts(
    kinematics: Kinematics,
    corners: Sequence[Array],
    radii: Sequence[float],
    limits: Sequence[JointLimits],
    checkpoint: Checkpoint,
) -> list[_Part]:
    """Return the moves, and a blend between successive moves.

    Raises BlendError if a blend does not fit.
    """
    steps = [last - first for first, last in pairwise(corners)]
    sizes = [
        float(np.max(np.abs(step) / maximum.velocity))
        for step, maximum in zip(steps, limits, strict=True)
    ]
    for index, size in enumerate(sizes):
        if size < SHORTEST_MOVE_S:
            raise BlendError(index, 'the joints are already at the target')
    positions = partial(_tool_positions, kinematics, checkpoint=checkpoint)
    blends: list[_Part] = []
    for index, radius in enumerate(radii):
        corner, after = corners[index + 1], index + 1
        extent = min(
            sizes[index] * _fraction_within(positions, corner, -steps[index], radius, index),
            sizes[after] * _fraction_within(positions, corner, steps[after], radius, after),
        )
        rates = steps[index] / sizes[index], steps[after] / sizes[after]
        extent, coefficients = _blend(positions, corner, rates, extent, radius, index)
        blend_limits = _stricter(limits[index], limits[after])
        blends.append(_Part(2.0 * extent, coefficients, blend_limits, blend=True))
    cuts = [0.0, *(blend.size / 2.0 for blend in blends), 0.0]
    parts: list[_Part] = []
    for index, (step, size) in enumerate(zip(steps, sizes, strict=True)):
        remaining = size - cuts[index] - cuts[index + 1]
        if remaining < 0.0:
            raise BlendError(
                index, 'the blends at both ends of the motion overlap: reduce one of them'
            )
        if remaining >= SHORTEST_MOVE_S:
            coefficients = np.zeros((6, len(step)))
            coefficients[0] = corners[index] + step * (cuts[index] / size)
            coefficients[1] = step * (remaining / size)
            parts.append(_Part(remaining, coefficients, limits[index], blend=False))
        parts.extend(blends[index : index + 1])
    return parts


def _tool_positions(kinematics: Kinematics, joints: Array, checkpoint: Checkpoint) -> Array:
    positions = np.empty((len(joints), 3))
    for index, item in enumerate(joints):
        checkpoint()
        positions[index] = kinematics.forward(item)[:3, 3]
    return positions


def _fraction_within(
    positions: Callable[[Array], Array], corner: Array, step: Array, radius: float, index: int
) -> float:
    """Return the first fraction of a move at which the tool is `radius` m from the start corner.

    step: joint displacement of the move. Raises BlendError with `index` if the tool stays nearer.
    """
    count = int(np.clip(np.max(np.abs(step)) / STEP_RAD, MIN_SAMPLES, MAX_SAMPLES))
    (origin,) = positions(corner[None, :])

    def distances_at(fractions: Array) -> Array:
        return np.asarray(
            np.linalg.norm(positions(corner + fractions[:, None] * step) - origin, axis=1)
        )

    fractions = np.linspace(0.0, 1.0, count + 1)
    distances = distances_at(fractions)
    outside = np.flatnonzero(distances > radius)
    if not len(outside):
        raise BlendError(
            index,
            f'a blend of {radius:g} m is longer than the largest distance of the '
            f'tool from the corner, {distances.max():.4g} m',
        )
    near, far = fractions[outside[0] - 1 : outside[0] + 1].tolist()
    return highest(
        lambda fraction: bool(distances_at(np.array([fraction]))[0] <= radius), near, far
    )


def _blend(
    positions: Callable[[Array], Array],
    corner: Array,
    rates: tuple[Array, Array],
    extent: float,
    radius: float,
    index: int,
) -> tuple[float, Array]:
    """Return a blend's extent to each side of a corner, s at full speed, and its coefficients.

    rates: joint velocities at full speed before and after the corner. extent: maximum extent, s.
    It is reduced until the tool stays within `radius`, m. index: index of the move, for
    BlendError.
    """
    (origin,) = positions(corner[None, :])
    fractions = np.linspace(0.0, 1.0, SAMPLES + 1)
    zero = np.zeros_like(corner)
    for _ in range(MAX_SHRINKS):
        ends = [
            (corner + side * extent * rate, 2.0 * extent * rate, zero)
            for side, rate in zip((-1.0, 1.0), rates, strict=True)
        ]
        coefficients = hermite(ends[0], ends[1])
        distances = np.linalg.norm(positions(polynomial(coefficients, fractions)) - origin, axis=1)
        if distances.max() <= radius * (1.0 + 1e-9):
            return extent, coefficients
        extent *= SHRINK
    raise BlendError(index, f'no blend keeps the tool within {radius:g} m of the corner')


def _stricter(first: JointLimits, second: JointLimits) -> JointLimits:
    return replace(
        first,
        **{
            name: np.minimum(getattr(first, name), getattr(second, name))
            for name in ('velocity', 'acceleration', 'jerk')
        },
    )


def _part_limits(part: _Part) -> PartLimits:
    fractions = np.linspace(0.0, 1.0, SAMPLES + 1 if part.blend else 2)
    first, second, third = (
        np.max(np.abs(part.derivative(fractions, order)), axis=0) / part.size**order
        for order in (1, 2, 3)
    )
    limits = part.limits
    with np.errstate(divide='ignore'):
        speed = float(np.min(limits.velocity / first))
        acceleration = float(np.min(limits.acceleration / first))
        jerk = float(np.min(limits.jerk / first))
    if part.blend:
        derivatives = (first, second, third)
        fraction = float(fraction_of_limits(limits, derivatives, speed, acceleration, jerk))
        fraction *= 1.0 - RESERVE_FRACTION
        speed, acceleration, jerk = (
            fraction * speed,
            fraction**2 * acceleration,
            fraction**3 * jerk,
        )
    return PartLimits(part.size, speed, acceleration, jerk)
