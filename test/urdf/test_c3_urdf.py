# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The C3's URDF against the model data and against known poses of its Tool 0."""

from xml.etree import ElementTree

import numpy as np
import pytest

from epson_driver.robots import load_robot_model
from epson_driver.share import share_file

ROBOT = ElementTree.parse(share_file('urdf', 'c3_a601s.urdf')).getroot()
JOINTS = {joint.get('name'): joint for joint in ROBOT.findall('joint')}
MODEL = load_robot_model('c3_a601s')

# joints in degrees; X, Y, Z in mm and U, V, W in degrees of Tool 0 in EPSON's world
POSES = [
    ((0, 0, 0, 0, 0, 0), (0, 415, 570), (0, -90, -90)),
    ((0, 0, 0, 0, -90, 0), (0, 350, 505), (90, 0, 180)),
    ((0, -45, 45, 0, -90, 0), (0, 526.777, 431.777), (90, 0, 180)),
    ((0, -90, 90, 0, 0, 0), (0, 665, 320), (0, -90, -90)),
    ((0, 0, 90, 0, 0, 0), (0, 100, 885), None),
    ((90, 0, 0, 0, 0, 0), (-415, 0, 570), None),
    ((30, 0, 0, 0, 0, 0), (-207.5, 359.401, 570), (0, -90, -60)),
    ((0, -30, 0, 0, 0, 0), (0, 497.798, 379.006), (90, -60, 180)),
    ((0, 0, 30, 0, 0, 0), (0, 372.798, 727.5), (-90, -60, 0)),
    ((0, 0, 0, 30, 0, 0), (0, 415, 570), (180, -60, 90)),
    ((0, 0, 0, 0, 0, 30), (0, 415, 570), (180, -60, 90)),
    ((20, -20, 30, 25, 15, 40), (-174.576, 458.855, 624.253), (-143.539, -21.006, 64.715)),
]


def numbers(text):
    return np.array([float(word) for word in text.split()])


def about(axis, angle):
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def rpy(roll, pitch, yaw):
    return about((0, 0, 1), yaw) @ about((0, 1, 0), pitch) @ about((1, 0, 0), roll)


def step(joint, angle=0.0):
    """Return the child's frame in the parent's, as rotation and translation."""
    origin = joint.find('origin')
    rotation = rpy(*numbers(origin.get('rpy', '0 0 0')))
    axis = joint.find('axis')
    if axis is not None:
        rotation = rotation @ about(numbers(axis.get('xyz')), angle)
    return rotation, numbers(origin.get('xyz', '0 0 0'))


def tool0_in_epsons_world(angles):
    rotation, translation = np.eye(3), np.zeros(3)
    chain = [(JOINTS[f'joint_{i + 1}'], angle) for i, angle in enumerate(angles)]
    for joint, angle in [*chain, (JOINTS['link_6-tool0'], 0.0)]:
        turn, shift = step(joint, angle)
        translation = translation + rotation @ shift
        rotation = rotation @ turn
    world, _ = step(JOINTS['base_link-base'])
    return world.T @ rotation, world.T @ translation


@pytest.mark.parametrize(('degrees', 'millimetres', 'uvw'), POSES)
def test_tool0_is_where_the_pendant_would_show_it(degrees, millimetres, uvw):
    rotation, translation = tool0_in_epsons_world(np.radians(degrees))
    assert translation * 1e3 == pytest.approx(millimetres, abs=1e-3)
    if uvw is not None:
        u, v, w = np.radians(uvw)
        assert rotation == pytest.approx(rpy(w, v, u), abs=2e-5)


def test_limits_are_those_of_the_model_data():
    limits = MODEL.limits
    for index, name in enumerate(MODEL.joint_names):
        limit = JOINTS[name].find('limit')
        assert float(limit.get('lower')) == limits.position_min[index]
        assert float(limit.get('upper')) == limits.position_max[index]
        assert float(limit.get('velocity')) == limits.velocity[index]
        assert float(limit.get('effort')) > 0.0


def test_the_tree_hangs_together():
    links = {link.get('name') for link in ROBOT.findall('link')}
    children = [joint.find('child').get('link') for joint in JOINTS.values()]
    assert len(children) == len(set(children))
    assert links - set(children) == {'base_link'}
    assert {joint.find('parent').get('link') for joint in JOINTS.values()} <= links
    for joint in JOINTS.values():
        axis = joint.find('axis')
        assert axis is None or np.linalg.norm(numbers(axis.get('xyz'))) == 1.0
