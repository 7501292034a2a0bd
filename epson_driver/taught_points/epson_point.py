# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A place of the tool as a teach pendant shows it."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from epson_driver.inputs import number
from epson_driver.motion import Array
from epson_driver.robots.kinematics import rotation_of_uvw, uvw
from epson_driver.tool_motion.tool_pose import finite_numbers, homogeneous

_LENGTH = number(-1e6, 1e6, 'mm')
_ANGLE = number(-36000.0, 36000.0, 'degrees')


@dataclass(frozen=True)
class EpsonPoint:
    """A point as a teach pendant shows it: X, Y, Z in mm, and U, V, W in degrees.

    Its frame is EPSON's world, unless another one is named where it is used. On a SCARA V and W
    are 0.
    """

    x: float
    y: float
    z: float
    u: float = 0.0
    v: float = 0.0
    w: float = 0.0

    def __post_init__(self) -> None:
        for name in ('x', 'y', 'z'):
            _LENGTH.checked(plain(getattr(self, name)), name)
        for name in ('u', 'v', 'w'):
            _ANGLE.checked(plain(getattr(self, name)), name)

    @property
    def pose(self) -> Array:
        """The point as a homogeneous matrix, shape (4, 4), m."""
        angles = np.radians([self.u, self.v, self.w])
        return homogeneous(rotation_of_uvw(angles), np.array([self.x, self.y, self.z]) / 1e3)

    def moved(
        self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, u: float = 0.0
    ) -> 'EpsonPoint':
        """Return the point moved by mm and degrees, as SPEL+'s `P1 +Z(50)`."""
        for name, value in (('x', x), ('y', y), ('z', z)):
            _LENGTH.checked(plain(value), name)
        _ANGLE.checked(plain(u), 'u')
        return replace(self, x=self.x + x, y=self.y + y, z=self.z + z, u=self.u + u)

    def before(self, distance: float) -> 'EpsonPoint':
        """Return where the tool approaches it from, mm back along its own Z axis."""
        pose = self.pose
        pose[:3, 3] -= pose[:3, 2] * (_LENGTH.checked(plain(distance), 'distance') / 1e3)
        return EpsonPoint.of(pose)

    @classmethod
    def of(cls, pose: npt.ArrayLike) -> 'EpsonPoint':
        """Return the point of a homogeneous matrix, shape (4, 4), m. Raises ValueError."""
        pose = finite_numbers('pose', pose)
        if pose.shape != (4, 4):
            raise ValueError(f'pose has shape {pose.shape}: must be (4, 4), m')
        return cls(*(pose[:3, 3] * 1e3).tolist(), *np.degrees(uvw(pose[:3, :3])).tolist())


def plain(value: object) -> object:
    """Return a number of numpy's as Python's own."""
    return value.item() if isinstance(value, np.generic) else value
