# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""URDF and SRDF of a model, with a prefix before the names of its joints and links."""

import math
from collections.abc import Callable

from epson_driver.robots.urdf import srdf, urdf


class BringupError(RuntimeError):
    """A launch cannot start because its arguments are invalid or a package is missing."""


def robot_description(model: str, prefix: str = '', **arguments: str) -> str:
    """Return the URDF of a model as text.

    `arguments` are further arguments of epson_robot.urdf.xacro.
    """
    return _described(urdf, model, prefix=prefix, **arguments)


def semantic_description(model: str, prefix: str = '', world: str = 'world') -> str:
    """Return the SRDF of a model as text. `world`: the frame in which the arm is mounted."""
    return _described(srdf, model, prefix=prefix, world=world)


def _described(make: Callable[..., str], model: str, **arguments: str) -> str:
    try:
        return make(model, **arguments)
    except ImportError as cause:
        raise BringupError(
            'xacro is missing: sudo apt install ros-jazzy-xacro, or pip install xacro'
        ) from cause


def pose_arguments(parent: str, xyz: str, rpy: str, prefix: str = '') -> list[str]:
    """Return the arguments of static_transform_publisher.

    `xyz`, m, and `rpy`, rad, are texts of three numbers separated by blanks.
    """
    words = []
    for name, text, keys in (
        ('origin_xyz', xyz, ('x', 'y', 'z')),
        ('origin_rpy', rpy, ('roll', 'pitch', 'yaw')),
    ):
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != len(keys) or not all(map(math.isfinite, numbers)):
            raise BringupError(
                f"launch argument {name} = '{text}': must be three numbers, such as '0 0 0'"
            )
        for key, number in zip(keys, numbers, strict=True):
            words += [f'--{key}', f'{number:g}']
    return [*words, '--frame-id', parent, '--child-frame-id', prefix + 'base_link']
