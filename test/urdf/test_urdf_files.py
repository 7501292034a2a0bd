# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every URDF in urdf/: as generated, sound, and what the model data say."""

import os
import shutil
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.share import share_file, share_folder

pytest.importorskip('trimesh')

from generate.check import main as check
from generate.check import problems
from generate.meshes import described_models
from generate.urdf import urdf

MODELS = described_models()
NAMES = [model.name for model in MODELS]
XACRO = [sys.executable, '-c', 'import xacro; xacro.main()']
each_model = pytest.mark.parametrize('model', MODELS, ids=lambda model: model.name)


def text(name: str) -> str:
    return share_file('urdf', f'{name}.urdf').read_text('utf-8')


def test_every_model_has_a_urdf_and_no_other():
    assert 'c3_a601s' in NAMES
    assert sorted(path.stem for path in share_folder('urdf').glob('*.urdf')) == sorted(NAMES)


@each_model
def test_the_files_are_what_the_generator_writes(model):
    assert text(model.name) == urdf(model), 'run `make generate`'


@each_model
def test_nothing_is_wrong_with_it(model):
    assert problems(text(model.name)) == []


@each_model
@pytest.mark.skipif(shutil.which('check_urdf') is None, reason='no check_urdf (liburdfdom-tools)')
def test_check_urdf_accepts_it(model):
    path = share_file('urdf', f'{model.name}.urdf')
    run = subprocess.run(['check_urdf', path], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert 'Successfully Parsed XML' in run.stdout


@each_model
def test_limits_and_chain_are_the_numbers_of_the_data_file(model):
    robot = ElementTree.fromstring(text(model.name))
    joints = {joint.get('name'): joint for joint in robot.findall('joint')}
    for i, name in enumerate(model.joint_names):
        joint, limits = joints[name], model.limits
        assert joint.get('type') == model.joint_types[i]
        limit = joint.find('limit')
        assert float(limit.get('lower')) == limits.position_min[i]
        assert float(limit.get('upper')) == limits.position_max[i]
        assert float(limit.get('velocity')) == limits.velocity[i]
        for tag, values in (('origin', model.chain.origins), ('axis', model.chain.axes)):
            written = [float(word) for word in joint.find(tag).get('xyz').split()]
            assert written == values[i].tolist()


@each_model
def test_masses_add_up_to_that_of_the_arm_which_is_marked_as_a_guess(model):
    file = share_file('config', 'robots', f'{model.name}.yaml')
    mass = yaml.safe_load(file.read_text('utf-8'))['mass']
    assert mass['confidence'] == 'low'
    assert mass['source']
    masses = ElementTree.fromstring(text(model.name)).iter('mass')
    total = sum(float(each.get('value')) for each in masses)
    assert total == pytest.approx(mass['value'], rel=1e-3)


@each_model
def test_pinocchio_finds_tool0_where_the_data_put_it(model):
    pinocchio = pytest.importorskip('pinocchio')
    arm = pinocchio.buildModelFromXML(text(model.name))
    assert list(arm.names)[1:] == list(model.joint_names)
    assert arm.lowerPositionLimit.tolist() == model.limits.position_min.tolist()
    data = arm.createData()
    limits = model.limits
    for position in np.random.default_rng(5).uniform(
        limits.position_min, limits.position_max, (20, len(model.joint_names))
    ):
        pinocchio.framesForwardKinematics(arm, data, position)
        flange = Kinematics(model).link_frames(position)[-1]
        expected = {'tool0': flange @ model.tool0.matrix, 'base': model.base.matrix}
        expected['flange'] = flange @ np.vstack([np.c_[np.eye(3), model.tool0.xyz], [0, 0, 0, 1]])
        for name, frame in expected.items():
            found = data.oMf[arm.getFrameId(name)].homogeneous
            assert found == pytest.approx(frame, abs=1e-9), name


def test_the_xacro_takes_a_prefix(tmp_path):
    source = share_file('urdf', 'epson_robot.urdf.xacro')
    for file, folder in ((source, tmp_path), (source.name, source.parent)):  # absolute, relative
        run = subprocess.run(
            [*XACRO, str(file), 'robot_model:=c4_a601s', 'prefix:=left_', 'mesh_dir:=file:///m'],
            cwd=folder,
            env=os.environ | {'AMENT_PREFIX_PATH': ''},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        robot = ElementTree.fromstring(run.stdout)
        assert robot.get('name') == 'c4_a601s'
        names = [each.get('name') for each in [*robot.findall('link'), *robot.findall('joint')]]
        assert all(name.startswith('left_') for name in names)
        assert {'left_base_link', 'left_base', 'left_flange', 'left_tool0'} < set(names)
        assert all(each.get('filename').startswith('file:///m/') for each in robot.iter('mesh'))


def test_two_arms_in_one_file(tmp_path):
    macro = share_file('urdf', 'epson_macro.xacro')
    cell = tmp_path / 'cell.urdf.xacro'
    cell.write_text(
        f"""<robot name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro">
        <xacro:include filename="{macro}"/>
        <link name="base_link"/>
        <xacro:epson_robot robot_model="c3_a601s" prefix="left_"/>
        <xacro:epson_robot robot_model="{NAMES[-1]}" prefix="right_"/>
        <joint name="a" type="fixed">
          <parent link="base_link"/><child link="left_base_link"/></joint>
        <joint name="b" type="fixed">
          <parent link="base_link"/><child link="right_base_link"/></joint>
        </robot>""",
        'utf-8',
    )
    run = subprocess.run([*XACRO, str(cell)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert problems(run.stdout) == []


def test_a_model_can_be_described_by_its_joints_alone():
    model = load_robot_model('gx4_c251s')
    result = urdf(model, geometry='false')
    assert problems(result) == []
    assert '<mesh' not in result
    types = [each.get('type') for each in ElementTree.fromstring(result).findall('joint')]
    assert types[: len(model.joint_types)] == list(model.joint_types)


BROKEN = {
    'not XML': ('</robot>', '', 'not XML'),
    'no name': ('<robot name="c3_a601s">', '<robot>', 'not a robot with a name'),
    'inverted limits': ('lower="-2.96', 'lower="3.96', 'joint_1: the lower limit is not below'),
    'no limits': ('<limit ', '<limits ', 'joint_1: the lower limit is not below'),
    'no velocity': ('velocity="7.85"', 'velocity="0"', 'joint_1: the velocity limit is not'),
    'no effort': ('effort="100"', 'effort="0.0"', 'joint_1: the effort limit is not'),
    'axis not unit': ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 2"/>', 'joint_1: the axis'),
    'axis of two': ('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', 'joint_1: the axis'),
    'missing mesh': ('link_1_0.stl', 'link_1_9.stl', 'link_1: there is no mesh'),
    'foreign mesh': ('package://epson_driver/', 'package://other/', 'base_link: there is no mesh'),
    'orphan': ('<child link="link_4"/>', '<child link="link_3"/>', 'link_4: hangs on nothing'),
    'two parents': ('<child link="base"/>', '<child link="tool0"/>', 'tool0: hangs on 2 joints'),
    'unknown link': ('<parent link="link_5"/>', '<parent link="hand"/>', "no link 'hand'"),
    'cycle': ('<parent link="base_link"/>', '<parent link="tool0"/>', 'hangs on nothing'),
    'name twice': (
        '<joint name="joint_2"',
        '<joint name="joint_1"',
        'joint_1: the name is used 2',
    ),
    'type': ('type="revolute"', 'type="revolving"', 'joint_1: type revolving is none of'),
    'negative mass': ('<mass value="', '<mass value="-', 'base_link: the mass is not positive'),
    'no inertia tensor': ('<inertia ', '<tensor ', 'base_link: the inertia is not six numbers'),
    'bad origin': ('xyz="0 0 0.1965"', 'xyz="0 0 nan"', 'joint_1: origin xyz'),
}


@pytest.mark.parametrize(('old', 'new', 'expected'), BROKEN.values(), ids=BROKEN)
def test_the_checker_finds_what_is_wrong(old, new, expected):
    good = text('c3_a601s')
    assert old in good
    found = problems(good.replace(old, new, 1))
    assert any(expected in each for each in found), found


@pytest.mark.parametrize(
    ('moments', 'expected'),
    [
        ((1.0, 1.0, 2.5), 'no body has this inertia'),
        ((1.0, -1.0, 1.0), 'not positive definite'),
        ((1.0, 1.0, 2.0), None),
    ],
)
def test_the_checker_knows_which_inertias_there_are(moments, expected):
    robot = ElementTree.fromstring(text('c3_a601s'))
    inertia = robot.find('link/inertial/inertia')
    for key in ('ixy', 'ixz', 'iyz'):
        inertia.set(key, '0')
    for key, value in zip(('ixx', 'iyy', 'izz'), moments, strict=True):
        inertia.set(key, str(value))
    found = problems(ElementTree.tostring(robot, 'unicode'))
    assert [expected in each for each in found] == ([True] if expected else [])


def test_the_checkers_command(tmp_path, capsys):
    assert check([]) == 0
    bad = tmp_path / 'bad.urdf'
    bad.write_text(text('c3_a601s').replace('effort="100"', 'effort="0"'), 'utf-8')
    assert check([str(bad)]) == 1
    assert 'joint_6: the effort limit is not positive' in capsys.readouterr().out
