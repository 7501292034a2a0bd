# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The URDF of every model: valid, and consistent with the model data."""

import os
import shutil
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from support.examples import one_in
from urdf_rules import problems

from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.urdf import urdf
from epson_driver.share import share_path

NAMES = robot_models()
XACRO = [sys.executable, '-c', 'import xacro; xacro.main()']
each_model = pytest.mark.parametrize('model', one_in(5, map(load_robot_model, NAMES)), ids=NAMES)


@each_model
def test_urdf_of_each_model_has_no_problems(model):
    assert problems(urdf(model.file)) == []


@each_model
@pytest.mark.skipif(shutil.which('check_urdf') is None, reason='no check_urdf (liburdfdom-tools)')
def test_check_urdf_accepts_every_model(model, tmp_path):
    path = tmp_path / 'model.urdf'
    path.write_text(urdf(model.file), 'utf-8')
    run = subprocess.run(['check_urdf', path], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert 'Successfully Parsed XML' in run.stdout


@each_model
def test_limits_and_chain_equal_the_model_data(model):
    robot = ElementTree.fromstring(urdf(model.file))
    joints = {joint.get('name'): joint for joint in robot.findall('joint')}
    for i, name in enumerate(model.joint_names):
        joint, limits = joints[name], model.limits
        assert joint.get('type') == model.joint_types[i]
        limit = joint.find('limit')
        assert float(limit.get('lower')) == limits.position_min[i] - limits.rounding[i]
        assert float(limit.get('upper')) == limits.position_max[i] + limits.rounding[i]
        assert float(limit.get('velocity')) == limits.velocity[i]
        for tag, values in (('origin', model.chain.origins), ('axis', model.chain.axes)):
            written = [float(word) for word in joint.find(tag).get('xyz').split()]
            assert written == values[i].tolist()
    for name, frame in (('tool0', model.tool0), ('base', model.base)):
        (joint,) = robot.findall(f"joint/child[@link='{name}']/..")
        for key, values in (('xyz', frame.xyz), ('rpy', frame.rpy)):
            written = [float(word) for word in joint.find('origin').get(key).split()]
            assert written == pytest.approx(values.tolist())


def test_xacro_accepts_a_prefix(tmp_path):
    source = share_path('urdf', 'epson_robot.urdf.xacro')
    for file, folder in ((source, tmp_path), (source.name, source.parent)):  # absolute, relative
        run = subprocess.run(
            [*XACRO, str(file), 'robot_model:=c4_a601s', 'prefix:=left_'],
            cwd=folder,
            env=os.environ | {'AMENT_PREFIX_PATH': ''},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        robot = ElementTree.fromstring(run.stdout)
        assert robot.get('name') == 'c4_a601s'
        names = [item.get('name') for item in [*robot.findall('link'), *robot.findall('joint')]]
        assert all(name.startswith('left_') for name in names)
        assert {'left_base_link', 'left_base', 'left_flange', 'left_tool0'} < set(names)


def test_two_arms_fit_in_one_file(tmp_path):
    macro = share_path('urdf', 'epson_macro.xacro')
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


def test_custom_model_file_has_a_urdf(tmp_path, monkeypatch):
    """Its third joint is off the others' plane, so that it is drawn as sticks."""
    origins = '[0, 0, 196.5], [100, 0, 123.5], [0, 20, 250], [0, 0, 0], [250, 0, 0], [60, 0, 0]'
    text = f'name: mine\nlike: C3-A601S\norigins_mm: [{origins}]\n'
    (tmp_path / 'mine.yaml').write_text(text, 'utf-8')
    monkeypatch.chdir(tmp_path)
    result = urdf('mine.yaml')
    assert problems(result) == []
    root = ElementTree.fromstring(result)
    assert root.get('name') == 'mine'
    visuals = [len(link.findall('visual')) for link in root.findall('link')]
    assert visuals[:8] == [0, 1, 2, 2, 1, 2, 2, 2]
