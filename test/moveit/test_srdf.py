# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SRDF and joint limits: as generated, with the URDF's names, and poses that can be taken."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from srdf_rules import faults
from support.examples import one_in

from epson_driver.bringup import semantic_description
from epson_driver.robots import load_robot_model

pytest.importorskip('pinocchio')
pytest.importorskip('trimesh')

import pinocchio

from epson_driver.robots.link_meshes import PACKAGE_URI
from generate import moveit
from generate.self_collision import CollisionBodies, random_configurations

ROOT = Path(__file__).parents[2]
MODELS = moveit.described_models()
ROS_1_PAIRS = {(1, 3), (2, 5), (2, 6), (3, 5), (3, 6)}
"""Links that never touch, as the ROS 1 package epson_c3_support has them."""

OTHER_SEED = 7
OTHER_SAMPLES = 10_000


def srdf_text(model: str) -> str:
    return (ROOT / 'config' / 'moveit' / model / f'{model}.srdf').read_text(encoding='utf-8')


def urdf_text(model: str) -> str:
    return moveit.urdf_of(model).read_text(encoding='utf-8')


def poses(model: str) -> dict[str, dict[str, float]]:
    root = ElementTree.fromstring(srdf_text(model))
    return {
        str(state.get('name')): {
            str(joint.get('name')): float(joint.get('value', ''))
            for joint in state.findall('joint')
        }
        for state in root.findall('group_state')
    }


def test_every_model_with_a_urdf_has_a_configuration_and_no_other() -> None:
    assert 'c3_a601s' in MODELS
    folders = {path.name for path in (ROOT / 'config' / 'moveit').iterdir() if path.is_dir()}
    assert folders == set(MODELS)


def test_the_c3s_files_are_what_the_generator_makes() -> None:
    for path, text in moveit.files('c3_a601s').items():
        assert path.read_text(encoding='utf-8') == text, 'run `make generate`'


@pytest.mark.parametrize('model', MODELS)
def test_joint_limits_are_those_of_the_model(model: str) -> None:
    path = ROOT / 'config' / 'moveit' / model / 'joint_limits.yaml'
    text = path.read_text(encoding='utf-8')
    assert text == moveit.limits(load_robot_model(model)), 'run `make generate`'
    values = yaml.safe_load(text)
    limits = load_robot_model(model).limits
    assert tuple(values['joint_limits']) == limits.names
    for index, joint in enumerate(values['joint_limits'].values()):
        for quantity in ('velocity', 'acceleration', 'jerk'):
            assert joint[f'has_{quantity}_limits'] is True
            assert joint[f'max_{quantity}'] == getattr(limits, quantity)[index]
        assert 'max_position' not in joint


@pytest.mark.parametrize('model', MODELS)
def test_srdf_and_urdf_have_the_same_names(model: str) -> None:
    assert list(faults(srdf_text(model), urdf_text(model))) == []


@pytest.mark.parametrize('model', MODELS)
def test_named_poses_are_within_the_limits_and_touch_nothing(model: str) -> None:
    robot = load_robot_model(model)
    bodies = CollisionBodies(moveit.urdf_of(model))
    found = poses(model)
    assert {'zero', 'ready'} <= set(found)
    for name, values in found.items():
        angles = np.array([values[joint] for joint in robot.joint_names])
        assert np.all(angles >= robot.limits.position_min), name
        assert np.all(angles <= robot.limits.position_max), name
        assert {bodies.pairs[index] for index in bodies.touching(angles)} == set(), name


@pytest.mark.parametrize('model', one_in(4, MODELS))
def test_another_seed_sees_no_collision_of_a_pair_that_never_collides(model: str) -> None:
    pairs = ElementTree.fromstring(srdf_text(model)).findall('disable_collisions')
    never = {
        (pair.get('link1'), pair.get('link2')) for pair in pairs if pair.get('reason') == 'Never'
    }
    bodies = CollisionBodies(moveit.urdf_of(model))
    limits = load_robot_model(model).limits
    seen: set[int] = set()
    samples = OTHER_SAMPLES if model == 'c3_a601s' else OTHER_SAMPLES // 4
    for angles in random_configurations(limits, samples, OTHER_SEED):
        seen |= bodies.touching(angles)
    checked = {bodies.pairs[index] for index in seen}
    assert checked & never == set()
    # and the samples are worth something: an arm that folds does touch itself, unless it cannot
    disabled = {(pair.get('link1'), pair.get('link2')) for pair in pairs}
    assert checked or disabled == set(bodies.pairs)


def test_the_c3s_pairs_hold_those_that_ros_1_had() -> None:
    root = ElementTree.fromstring(srdf_text('c3_a601s'))
    found = {(pair.get('link1'), pair.get('link2')) for pair in root.iter('disable_collisions')}
    assert {(f'link_{first}', f'link_{second}') for first, second in ROS_1_PAIRS} <= found


def test_the_sampling_finds_a_pair_that_is_wrongly_said_to_be_never_touching() -> None:
    bodies = CollisionBodies(moveit.urdf_of('c3_a601s'))
    limits = load_robot_model('c3_a601s').limits
    pair = bodies.pairs.index(('base_link', 'link_4'))
    assert any(
        pair in bodies.touching(angles) for angles in random_configurations(limits, 2_000, 1)
    )


def test_the_matrix_says_how_it_was_made() -> None:
    text = srdf_text('c3_a601s')
    comment = re.search(r'<!-- Pairs of links.*?-->', text, re.DOTALL)
    assert comment is not None
    assert f'{moveit.SAMPLES} random configurations' in comment[0]
    assert f'Seed: {moveit.SEED}' in comment[0]
    assert moveit.SAMPLES >= 10_000


def test_samples_are_within_the_limits_and_the_same_for_the_same_seed() -> None:
    limits = load_robot_model('c3_a601s').limits
    samples = np.array(list(random_configurations(limits, 500, 3)))
    again = np.array(list(random_configurations(limits, 500, 3)))
    np.testing.assert_array_equal(samples, again)
    assert np.all(samples >= limits.position_min)
    assert np.all(samples <= limits.position_max)
    at_ends = (samples == limits.position_min) | (samples == limits.position_max)
    assert not at_ends[::2].any()
    assert 0.4 < at_ends[1::2].mean() < 0.6


def test_another_reader_of_srdf_takes_it_as_meant() -> None:
    path = str(ROOT / 'config' / 'moveit' / 'c3_a601s' / 'c3_a601s.srdf')
    text = urdf_text('c3_a601s').replace(PACKAGE_URI, f'{ROOT}/')
    robot = pinocchio.buildModelFromXML(text)
    pinocchio.loadReferenceConfigurations(robot, path, False)
    found = poses('c3_a601s')
    assert len(robot.referenceConfigurations) == len(found)
    for name, values in found.items():
        assert robot.referenceConfigurations[name].tolist() == list(values.values())
    geometry = pinocchio.buildGeomFromUrdfString(robot, text, pinocchio.GeometryType.COLLISION)
    owners = [robot.frames[each.parentFrame].name for each in geometry.geometryObjects]
    geometry.addAllCollisionPairs()
    pinocchio.removeCollisionPairs(robot, geometry, path, False)
    left = {(owners[pair.first], owners[pair.second]) for pair in geometry.collisionPairs}
    disabled = {
        (pair.get('link1'), pair.get('link2'))
        for pair in ElementTree.fromstring(srdf_text('c3_a601s')).iter('disable_collisions')
    }
    assert left == set(CollisionBodies(moveit.urdf_of('c3_a601s')).pairs) - disabled


def test_a_prefix_reaches_every_joint_and_link_and_nothing_else() -> None:
    text = semantic_description('c3_a601s', 'left_')
    urdf = urdf_text('c3_a601s')
    prefixed = re.sub(r'(<(?:link|joint) name|link)="', r'\1="left_', urdf)
    assert list(faults(text, prefixed)) == []
    root = ElementTree.fromstring(text)
    assert [joint.get('parent_frame') for joint in root.iter('virtual_joint')] == ['world']
    assert [group.get('name') for group in root.findall('group')] == ['manipulator']
    assert list(faults(semantic_description('c3_a601s'), urdf)) == []


@pytest.mark.parametrize(
    ('old', 'new', 'text'),
    [
        ('tip_link="tool0"', 'tip_link="tool1"', 'chain: no link tool1'),
        ('tip_link="tool0"', 'tip_link="link_5"', 'group manipulator has the joints'),
        ('child_link="base_link"', 'child_link="bottom"', 'virtual_joint: no link bottom'),
        ('link2="link_1"', 'link2="link_7"', 'disable_collisions: no link link_7'),
        ('link2="link_1"', 'link2="tool0"', 'base_link and tool0: nothing to collide with'),
        ('link2="link_1"', 'link2="base_link"', 'base_link: twice, or one link'),
        ('reason="Never"', 'reason="Adjacent"', 'Adjacent, but the URDF says otherwise'),
        ('reason="Never"', 'reason="Perhaps"', 'unknown reason Perhaps'),
        ('<joint name="joint_4"', '<joint name="joint_9"', 'pose zero: no joint joint_9'),
        ('<joint name="joint_4"', '<jint name="joint_4"', 'says nothing of joint joint_4'),
        ('group="manipulator"', 'group="arm"', 'pose zero: no group arm'),
        ('<robot name="c3_a601s"', '<robot name="c4"', 'the SRDF is of c4'),
    ],
)
def test_a_name_that_is_only_in_the_srdf_is_found(old: str, new: str, text: str) -> None:
    broken = srdf_text('c3_a601s')
    assert old in broken
    broken = broken.replace(old, new, 1)
    assert text in ' / '.join(faults(broken, urdf_text('c3_a601s')))


@pytest.mark.parametrize(
    ('old', 'new', 'text'),
    [
        ('"link_3"', '"elbow"', 'disable_collisions: no link link_3'),
        ('"joint_3"', '"elbow"', 'pose zero: no joint joint_3'),
        ('"joint_3"', '"elbow"', 'pose zero says nothing of joint elbow'),
        ('"tool0"', '"tip"', 'chain: no link tool0'),
        ('"link_6"', '"link_7"', 'link_5 and link_7 are adjacent and checked'),
        ('name="c3_a601s"', 'name="c4_a601s"', 'the URDF of c4_a601s'),
    ],
)
def test_a_name_that_is_only_in_the_urdf_is_found(old: str, new: str, text: str) -> None:
    urdf = urdf_text('c3_a601s')
    assert old in urdf
    assert text in ' / '.join(faults(srdf_text('c3_a601s'), urdf.replace(old, new)))
