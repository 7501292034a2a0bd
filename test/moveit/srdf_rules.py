# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Consistency rules between the names of an SRDF and its URDF."""

from collections.abc import Iterator
from xml.etree import ElementTree

LINK_ATTRIBUTES = {
    'virtual_joint': ('child_link',),
    'chain': ('base_link', 'tip_link'),
    'disable_collisions': ('link1', 'link2'),
}
REASONS = {'Adjacent', 'Always', 'Default', 'Never'}


def faults(srdf: str, urdf: str) -> Iterator[str]:
    """Yield every name that the other file lacks."""
    semantic, robot = ElementTree.fromstring(srdf), ElementTree.fromstring(urdf)
    if semantic.get('name') != robot.get('name'):
        yield f'the SRDF is of {semantic.get("name")}, the URDF of {robot.get("name")}'
    links = {item.get('name') for item in robot.findall('link')}
    for element in semantic.iter():
        for attribute in LINK_ATTRIBUTES.get(element.tag, ()):
            if element.get(attribute) not in links:
                yield f'{element.tag}: no link {element.get(attribute)}'
    yield from _group_faults(semantic, robot)
    yield from _pair_faults(semantic, robot)


def end(joint: ElementTree.Element, which: str) -> str:
    """Return a joint's parent or child link."""
    result = joint.find(which)
    return '' if result is None else result.get('link', '')


def _group_faults(semantic: ElementTree.Element, robot: ElementTree.Element) -> Iterator[str]:
    moving = {item.get('name') for item in robot.findall('joint') if item.get('type') != 'fixed'}
    groups = {item.get('name'): item for item in semantic.findall('group')}
    for name, group in groups.items():
        joints = _joints_of_chain(group, robot)
        if joints != moving:
            has, other = sorted(joints), sorted(map(str, moving))
            yield f'group {name} has the joints {has}, the URDF {other}'
    for state in semantic.findall('group_state'):
        if state.get('group') not in groups:
            yield f'pose {state.get("name")}: no group {state.get("group")}'
        names = [item.get('name') for item in state.findall('joint')]
        for joint in names:
            if joint not in moving:
                yield f'pose {state.get("name")}: no joint {joint}'
        for joint in moving - set(names):
            yield f'pose {state.get("name")} lacks joint {joint}'


def _joints_of_chain(group: ElementTree.Element, robot: ElementTree.Element) -> set[str]:
    """Return the moving joints between the tip and the base of a group's chain."""
    above = {end(item, 'child'): item for item in robot.findall('joint')}
    joints = set()
    for chain in group.findall('chain'):
        link = chain.get('tip_link')
        while link != chain.get('base_link') and link in above:
            joint = above[link]
            if joint.get('type') != 'fixed':
                joints.add(joint.get('name', ''))
            link = end(joint, 'parent')
    return joints


def _pair_faults(semantic: ElementTree.Element, robot: ElementTree.Element) -> Iterator[str]:
    links = robot.findall('link')
    bodies = {link.get('name') for link in links if link.find('collision') is not None}
    joined = {
        frozenset((end(item, 'parent'), end(item, 'child'))) for item in robot.findall('joint')
    }
    seen = {}
    for element in semantic.findall('disable_collisions'):
        pair = frozenset((element.get('link1'), element.get('link2')))
        words = ' and '.join(sorted(map(str, pair)))
        if pair in seen or len(pair) != 2:
            yield f'{words}: twice, or one link'
        seen[pair] = element.get('reason')
        if element.get('reason') not in REASONS:
            yield f'{words}: unknown reason {element.get("reason")}'
        if not pair <= bodies:
            yield f'{words}: nothing to collide with'
        if (element.get('reason') == 'Adjacent') != (pair in joined):
            yield f'{words}: {element.get("reason")}, unlike the URDF'
    for pair in joined:
        if pair <= bodies and pair not in seen:
            yield f'{" and ".join(sorted(map(str, pair)))} are adjacent and checked'
