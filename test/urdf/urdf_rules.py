# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Mistakes in a URDF that parsers accept."""

from collections import Counter
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np

from epson_driver.motion import Array

MOVING = ('revolute', 'prismatic')
TYPES = (*MOVING, 'fixed')
SIZES = {'box': ('size',), 'cylinder': ('radius', 'length')}


def problems(text: str) -> list[str]:
    """Return the mistakes in a URDF, a sentence each."""
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as cause:
        return [f'not XML: {cause}']
    if robot.tag != 'robot' or not robot.get('name'):
        return ['the root is not a robot with a name']
    return [
        *_tree(robot),
        *(item for joint in robot.findall('joint') for item in _joint(joint)),
        *(item for link in robot.findall('link') for item in _link(link)),
    ]


def _tree(robot: ElementTree.Element) -> Iterator[str]:
    links = [link.get('name', '') for link in robot.findall('link')]
    joints = [joint.get('name', '') for joint in robot.findall('joint')]
    for name, count in (Counter(links) + Counter(joints)).items():
        if count > 1:
            yield f'{name}: the name is used {count} times'
    children: dict[str, list[str]] = {}
    parents = Counter[str]()
    for joint in robot.findall('joint'):
        ends = [_attribute(joint.find(end), 'link') for end in ('parent', 'child')]
        for end in ends:
            if end not in links:
                yield f'{joint.get("name")}: no link {end!r}'
        children.setdefault(ends[0], []).append(ends[1])
        parents[ends[1]] += 1
    roots = [name for name in links if not parents[name]]
    if not roots or not roots[0].endswith('base_link'):
        yield f'the root is {roots}, not base_link'
    for link in robot.findall('link'):
        if link.get('name') in roots and link.find('inertial') is not None:
            yield f'the root is {link.get("name")}, and has an inertia: not for KDL'
    reached: set[str] = set()
    waiting = roots[:1]
    while waiting:
        above = waiting.pop()
        if above not in reached:
            reached.add(above)
            waiting += children.get(above, [])
    for name in links:
        if name not in reached:
            yield f'{name}: has no parent joint'
        if parents[name] > 1:
            yield f'{name}: has {parents[name]} parent joints'


def _joint(joint: ElementTree.Element) -> Iterator[str]:
    name, kind = joint.get('name'), joint.get('type')
    if kind not in TYPES:
        yield f'{name}: type {kind} is none of {", ".join(TYPES)}'
    origin = joint.find('origin')
    for key in ('xyz', 'rpy'):
        if origin is not None and not _finite(_numbers(origin, key), 3):
            yield f'{name}: origin {key} is not three numbers'
    if kind not in MOVING:
        return
    axis = _numbers(joint.find('axis'), 'xyz')
    if not _finite(axis, 3) or abs(np.linalg.norm(axis) - 1.0) > 1e-9:
        yield f'{name}: the axis has not length 1'
    limit = joint.find('limit')
    lower, upper, velocity, effort = (
        _numbers(limit, key) for key in ('lower', 'upper', 'velocity', 'effort')
    )
    if not (_finite(lower, 1) and _finite(upper, 1) and lower[0] < upper[0]):
        yield f'{name}: the lower limit is not below the upper one'
    for key, value in (('velocity', velocity), ('effort', effort)):
        if not (_finite(value, 1) and value[0] > 0.0):
            yield f'{name}: the {key} limit is not positive'


def _link(link: ElementTree.Element) -> Iterator[str]:
    name = link.get('name')
    for shape in link.iterfind('*/geometry'):
        sizes = [_numbers(item, key) for item in shape for key in SIZES.get(item.tag, ())]
        if len(shape) != 1 or not sizes or not all(np.all(size > 0.0) for size in sizes):
            yield f'{name}: a shape is no box and no cylinder, or has no size'
    if (link.find('visual') is None) != (link.find('collision') is None):
        yield f'{name}: visual and collision do not go together'
    inertial = link.find('inertial')
    if inertial is None:
        if link.find('collision') is not None:
            yield f'{name}: has a body and no inertia'
        return
    mass = _numbers(inertial.find('mass'), 'value')
    if not (_finite(mass, 1) and mass[0] > 0.0):
        yield f'{name}: the mass is not positive'
    keys = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    tensor = np.concatenate([_numbers(inertial.find('inertia'), key) for key in keys])
    if not _finite(tensor, 6):
        yield f'{name}: the inertia is not six numbers'
        return
    xx, xy, xz, yy, yz, zz = tensor
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if moments[0] <= 0.0:
        yield f'{name}: the inertia is not positive definite'
    elif moments[0] + moments[1] < moments[2]:
        yield f'{name}: no body has this inertia: one moment is larger than the other two together'


def _attribute(element: ElementTree.Element | None, key: str) -> str:
    return '' if element is None else element.get(key, '')


def _numbers(element: ElementTree.Element | None, key: str) -> Array:
    try:
        return np.array([float(word) for word in _attribute(element, key).split()])
    except ValueError:
        return np.array([np.nan])


def _finite(numbers: Array, count: int) -> bool:
    return len(numbers) == count and bool(np.all(np.isfinite(numbers)))
