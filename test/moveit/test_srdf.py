# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The SRDF of every model: names, valid poses, and pairs that never collide."""

from xml.etree import ElementTree

import numpy as np
import pytest
from srdf_rules import faults
from support.examples import one_in

from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.urdf import srdf, urdf

pytest.importorskip('pinocchio')

import pinocchio
from support.self_collision import CollisionBodies, random_configurations

MODELS = robot_models()

SAMPLES = 2_500


def poses(model: str) -> dict[str, dict[str, float]]:
    root = ElementTree.fromstring(srdf(model))
    return {
        str(state.get('name')): {
            str(joint.get('name')): float(joint.get('value', ''))
            for joint in state.findall('joint')
        }
        for state in root.findall('group_state')
    }


@pytest.mark.parametrize('model', one_in(5, MODELS))
def test_srdf_and_urdf_have_the_same_names(model: str) -> None:
    assert list(faults(srdf(model), urdf(model))) == []


@pytest.mark.parametrize('model', one_in(5, MODELS))
def test_named_poses_are_within_limits_and_collision_free(model: str) -> None:
    robot = load_robot_model(model)
    bodies = CollisionBodies(robot)
    result = poses(model)
    assert {'zero', 'ready'} <= set(result)
    for name, values in result.items():
        angles = np.array([values[joint] for joint in robot.joint_names])
        assert np.all(angles >= robot.limits.position_min), name
        assert np.all(angles <= robot.limits.position_max), name
        assert {bodies.pairs[index] for index in bodies.touching(angles)} == set(), name


@pytest.mark.parametrize('model', one_in(50, MODELS))
def test_disabled_pairs_never_collide(model: str) -> None:
    pairs = ElementTree.fromstring(srdf(model)).findall('disable_collisions')
    free = {(pair.get('link1'), pair.get('link2')) for pair in pairs}
    robot = load_robot_model(model)
    bodies = CollisionBodies(robot)
    seen: set[int] = set()
    for angles in random_configurations(robot.limits, SAMPLES, 7):
        seen |= bodies.touching(angles)
    checked = {bodies.pairs[index] for index in seen}
    assert checked & free == set()


def test_pinocchio_reads_the_srdf() -> None:
    text, semantic = urdf('c3_a601s'), srdf('c3_a601s')
    robot = pinocchio.buildModelFromXML(text)
    pinocchio.loadReferenceConfigurationsFromXML(robot, semantic, False)
    result = poses('c3_a601s')
    assert len(robot.referenceConfigurations) == len(result)
    for name, values in result.items():
        assert robot.referenceConfigurations[name].tolist() == list(values.values())
    geometry = pinocchio.buildGeomFromUrdfString(robot, text, pinocchio.GeometryType.COLLISION)
    owners = [
        robot.frames[geometryobject.parentFrame].name
        for geometryobject in geometry.geometryObjects
    ]
    geometry.addAllCollisionPairs()
    pinocchio.removeCollisionPairsFromXML(robot, geometry, semantic, False)
    left = {(owners[pair.first], owners[pair.second]) for pair in geometry.collisionPairs}
    disabled = {
        (pair.get('link1'), pair.get('link2'))
        for pair in ElementTree.fromstring(semantic).iter('disable_collisions')
    }
    assert left == set(CollisionBodies(load_robot_model('c3_a601s')).pairs) - disabled


def test_prefix_is_added_to_joints_and_links_only() -> None:
    text = srdf('c3_a601s', prefix='left_')
    assert list(faults(text, urdf('c3_a601s', prefix='left_'))) == []
    root = ElementTree.fromstring(text)
    assert [joint.get('parent_frame') for joint in root.iter('virtual_joint')] == ['world']
    assert [group.get('name') for group in root.findall('group')] == ['manipulator']
