# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Surfaces of the links: closed, of realistic size, connected, and without collisions."""

import itertools
from xml.etree import ElementTree

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.urdf import box, cylinder, link_surfaces, srdf

NAMES = robot_models()
each_model = pytest.mark.parametrize('model', one_in(5, map(load_robot_model, NAMES)), ids=NAMES)


def volume(corners: Array) -> float:
    """Return the volume of a closed surface, m³ (negative if its faces point inwards)."""
    return float(np.einsum('ki,ki->', corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def is_closed(corners: Array) -> bool:
    """Return whether each edge belongs to two triangles, once in each direction."""
    _, index = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    edges = {
        (int(ring[k]), int(ring[(k + 1) % 3])) for ring in index.reshape(-1, 3) for k in range(3)
    }
    return all((end, start) in edges for start, end in edges)


@pytest.mark.parametrize(
    ('corners', 'expected'),
    [(box(0.1, 0.2, 0.3), 0.006), (cylinder(0.1, 0.5), np.pi * 0.005), (box(1, 1, 1e-3), 1e-3)],
)
def test_solids_of_links_are_closed_and_have_the_given_size(
    corners: Array, expected: float
) -> None:
    assert is_closed(corners)
    assert volume(corners) == pytest.approx(expected, rel=0.03)
    middle = corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))
    assert middle == pytest.approx(np.zeros(3), abs=1e-9)


def bounds(model: RobotModel) -> list[Array]:
    """Return the smallest and the largest x, y and z of each link, shape (2, 3), m."""
    links = [np.concatenate([item.corners for item in link]) for link in link_surfaces(model)]
    return [np.array([link.min(axis=(0, 1)), link.max(axis=(0, 1))]) for link in links]


def test_c3_has_its_real_size() -> None:
    """Bounding boxes of the ROS 1 support package's meshes, mm, within a few millimetres."""
    real = {
        0: ((-199.5, -90, 0), (90, 90, 196.5)),
        1: ((-82, -99, -8.5), (158, 99, 181.6)),
        2: ((-59, -99, -59), (59, 99, 299)),
        4: ((63, -55.5, -46.4), (281, 55.5, 58.5)),
        6: ((-4.2, -30, -30), (5, 30, 30)),
    }
    links = bounds(load_robot_model('c3_a601s'))
    for link, expected in real.items():
        assert links[link] * 1e3 == pytest.approx(np.array(expected), abs=5.0), link


@each_model
def test_links_do_not_collide_over_each_joint_range(model: RobotModel) -> None:
    """From the upright pose (SCARA: zero), single joints move through their ranges."""
    pytest.importorskip('pinocchio')
    from support.self_collision import CollisionBodies

    bodies = CollisionBodies(model)
    limits = model.limits
    count = len(model.joint_names)
    poses = ElementTree.fromstring(srdf(model.file)).findall('group_state')
    named = {pose.get('name'): [float(item.get('value', '')) for item in pose] for pose in poses}
    start = np.array(named.get('upright', named['zero']))
    assert bodies.distance(start) > 0.005
    for joint, fraction in itertools.product(range(count), np.linspace(0.0, 1.0, 25)):
        if count == 6 and joint == 1:  # this joint lowers the forearm to the base
            continue
        position = start.copy()
        low, high = limits.position_min[joint], limits.position_max[joint]
        position[joint] = low + fraction * (high - low)
        touching = {bodies.pairs[pair] for pair in bodies.touching(position)}
        assert touching == set(), (model.joint_names[joint], position[joint])


@pytest.mark.parametrize('name', ['gx4_c251s', 'gx8_c652s', 'rs4_c351s', 'rs6_c552s'])
def test_scara_shaft_stays_in_its_housing(name: str) -> None:
    model = load_robot_model(name)
    links = bounds(model)
    housing, shaft = links[2][:, 2], links[3][1, 2]
    for height in np.linspace(model.limits.position_min[2], model.limits.position_max[2], 5):
        frames = Kinematics(model).link_frames(np.array([0.0, 0.0, height, 0.0]))
        top = (np.linalg.inv(frames[1]) @ frames[2])[2, 3] + shaft
        assert housing[0] + 0.01 < top < housing[1], height
