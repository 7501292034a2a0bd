# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""URDF and SRDF of a model, with a prefix before the names of its joints and links."""

import math
from xml.etree import ElementTree

from epson_driver.share import share_file, share_folder

WORLD = 'world'
"""The frame in which the arm is placed; it belongs to no robot and has no prefix."""

_NAMES = {
    'virtual_joint': ('name', 'child_link'),
    'chain': ('base_link', 'tip_link'),
    'joint': ('name',),
    'disable_collisions': ('link1', 'link2'),
}
"""Which attributes of an SRDF's elements are names of the robot's joints and links."""


class BringupError(RuntimeError):
    """The launch arguments cannot be satisfied; the text says why."""


def described_models() -> tuple[str, ...]:
    """Return the models that have a URDF and a MoveIt configuration, sorted."""
    return tuple(
        sorted(path.parent.name for path in share_folder('config', 'moveit').glob('*/*.srdf'))
    )


def robot_description(model: str, prefix: str = '', **arguments: str) -> str:
    """Return the URDF of a model as text, made by xacro from urdf/epson_robot.urdf.xacro.

    `arguments`: others of that file. Raises BringupError if xacro is not installed.
    """
    try:
        import xacro
    except ImportError as cause:
        raise BringupError(
            'xacro is missing: sudo apt install ros-jazzy-xacro, or pip install xacro'
        ) from cause
    path = share_file('urdf', 'epson_robot.urdf.xacro')
    mappings = {'robot_model': model, 'prefix': prefix, **arguments}
    text: str = xacro.process_file(str(path), mappings=mappings).toxml()
    return text


def pose_arguments(parent: str, xyz: str, rpy: str, prefix: str = '') -> list[str]:
    """Return the arguments of static_transform_publisher for where an arm stands.

    `xyz` (m) and `rpy` (rad) are three numbers each, separated by spaces. Raises BringupError.
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


def semantic_description(model: str, prefix: str = '', world: str = WORLD) -> str:
    """Return the SRDF of a model as text. The group's name stays `manipulator`.

    `world`: the frame in which the arm stands.
    """
    path = share_file('config', 'moveit', model, f'{model}.srdf')
    root = ElementTree.fromstring(path.read_text(encoding='utf-8'))  # noqa: S314 - our own file
    for element in root.iter():
        for attribute in _NAMES.get(element.tag, ()):
            element.set(attribute, prefix + element.attrib[attribute])
        if element.tag == 'virtual_joint':
            element.set('parent_frame', world)
    return ElementTree.tostring(root, encoding='unicode')
