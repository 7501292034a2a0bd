# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""MoveIt's configuration, compared with the SRDF, the robot model and a running client."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from support.examples import one_in

from epson_driver.bringup import move_group_parameters, rviz_parameters
from epson_driver.processes import processes
from epson_driver.robots import load_robot_model
from epson_driver.robots.urdf import srdf, urdf
from epson_driver.setup.table import JOINTS, TABLE

FOLDER = Path(__file__).parents[2] / 'config' / 'moveit'
DEFAULTS = {row.name: row.default for row in TABLE}
GROUP = 'manipulator'


def load(name: str) -> dict[str, Any]:
    values: dict[str, Any] = yaml.safe_load((FOLDER / name).read_text(encoding='utf-8'))
    return values


CONTROLLERS = load('moveit_controllers.yaml')
MANAGER = CONTROLLERS['moveit_simple_controller_manager']


@pytest.fixture(scope='module')
def running_client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The ROS domain of a client in a namespace, without a controller."""
    folder = tmp_path_factory.mktemp('client')
    domain = processes.free_ros_domain()
    process = processes.Process(
        'client',
        ['--ros-args', '-r', '__ns:=/cell', '-p', 'motion_port:=1', '-p', 'state_port:=1'],
        folder / 'client.log',
        processes.ros_environment(domain),
    )
    with processes.ended_at_exit(process):
        yield domain


def action_names(domain: int, patience: float = 300.0) -> set[str]:
    """Return the FollowJointTrajectory actions of a domain."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    from rclpy.action import get_action_names_and_types
    from rclpy.context import Context
    from rclpy.node import Node

    context = Context()
    context.init(domain_id=domain)
    node = Node('observer', context=context)
    wanted = 'control_msgs/action/FollowJointTrajectory'
    try:
        end = time.monotonic() + patience
        names: set[str] = set()
        while not names and time.monotonic() < end:
            result = get_action_names_and_types(node)
            names = {name for name, types in result if wanted in types}
            time.sleep(0.05)
        return names
    finally:
        node.destroy_node()
        context.shutdown()


def test_moveit_calls_the_action_of_the_client(running_client: int) -> None:
    # move_group runs in the same namespace and resolves both names relative to it
    called = {f'/cell/{name}/{MANAGER[name]["action_ns"]}' for name in MANAGER['controller_names']}
    assert called == action_names(running_client)


def test_moveit_controller_matches_the_client() -> None:
    plugin = 'moveit_simple_controller_manager/MoveItSimpleControllerManager'
    assert CONTROLLERS['moveit_controller_manager'] == plugin
    assert set(MANAGER) == {'controller_names', *MANAGER['controller_names']}
    (name,) = MANAGER['controller_names']
    assert MANAGER[name]['type'] == 'FollowJointTrajectory'
    assert MANAGER[name]['default'] is True
    assert MANAGER[name]['joints'] == JOINTS == DEFAULTS['joint_names']


def test_execution_settings_match_the_driver() -> None:
    execution = CONTROLLERS['trajectory_execution']
    assert execution['execution_duration_monitoring'] is False
    assert 0.0 < execution['allowed_start_tolerance'] <= DEFAULTS['start_tolerance']


def test_kinematics_and_planners_name_the_srdf_group() -> None:
    assert set(load('kinematics.yaml')) == {GROUP}
    assert load('kinematics.yaml')[GROUP]['kinematics_solver'].startswith('kdl_')
    ompl = load('ompl_planning.yaml')
    assert set(ompl) - {GROUP} == {
        'planning_plugins',
        'request_adapters',
        'response_adapters',
        'planner_configs',
    }
    assert set(ompl[GROUP]['planner_configs']) == set(ompl['planner_configs'])
    assert ompl[GROUP]['default_planner_config'] in ompl['planner_configs']
    for name, planner in ompl['planner_configs'].items():
        assert planner['type'] == f'geometric::{name}'


def test_pipeline_files_have_the_jazzy_format() -> None:
    pipelines = load('planning_pipelines.yaml')
    assert pipelines['default_planning_pipeline'] in pipelines['planning_pipelines']
    files = {f'{name}_planning.yaml' for name in pipelines['planning_pipelines']}
    assert {path.name for path in FOLDER.glob('*_planning.yaml')} == files
    for name in files:
        pipeline = load(name)
        for kind in ('request', 'response'):
            adapters = pipeline[f'{kind}_adapters']
            assert all(
                adapter.startswith(f'default_planning_{kind}_adapters/') for adapter in adapters
            )
        assert isinstance(pipeline['planning_plugins'], list)  # planning_plugin in Humble
    timed = 'default_planning_response_adapters/AddTimeOptimalParameterization'
    assert load('ompl_planning.yaml')['response_adapters'][0] == timed
    assert timed not in load('pilz_industrial_motion_planner_planning.yaml')['response_adapters']


def test_cartesian_limits_are_within_spel_limits() -> None:
    limits = load('pilz_cartesian_limits.yaml')['cartesian_limits']
    assert 0.0 < limits['max_trans_vel'] <= 2.0  # SpeedS
    assert 0.0 < limits['max_trans_acc'] <= 15.0  # AccelS, of the longest arm
    assert limits['max_trans_dec'] == -limits['max_trans_acc']
    assert 0.0 < limits['max_rot_vel'] <= 17.4  # SpeedR


def test_move_group_and_rviz_get_their_parameters() -> None:
    values = move_group_parameters('c3_a601s', 'left_')
    assert values['robot_description_kinematics'] == load('kinematics.yaml')
    planning = values['robot_description_planning']
    assert planning['cartesian_limits'] == load('pilz_cartesian_limits.yaml')['cartesian_limits']
    assert planning['default_velocity_scaling_factor'] == 0.1
    limits = load_robot_model('c3_a601s').limits
    assert tuple(planning['joint_limits']) == tuple(f'left_{joint}' for joint in limits.names)
    for index, joint in enumerate(planning['joint_limits'].values()):
        for quantity in ('velocity', 'acceleration', 'jerk'):
            assert joint[f'has_{quantity}_limits'] is True
            assert joint[f'max_{quantity}'] == getattr(limits, quantity)[index]
        assert 'max_position' not in joint
    for name in ('planning_pipelines.yaml', 'planning_scene_monitor.yaml'):
        assert load(name).items() <= values.items()
    for pipeline in values['planning_pipelines']:
        assert values[pipeline] == load(f'{pipeline}_planning.yaml')
        fixed = move_group_parameters('c3_a601s', fix_start_state=True)[pipeline]
        assert fixed == {**values[pipeline], 'fix_start_state': True}
    panel = rviz_parameters('c3_a601s', 'left_')
    assert panel.items() <= values.items()
    assert set(values) - set(panel) == {*CONTROLLERS, *load('planning_scene_monitor.yaml')}
    read = {path.name for path in FOLDER.glob('*.yaml')} - {'servo.yaml'}  # for MoveIt Servo
    assert read == {
        'joint_limits.yaml',
        'kinematics.yaml',
        'kinematics_scara.yaml',
        'moveit_controllers.yaml',
        'ompl_planning.yaml',
        'pilz_cartesian_limits.yaml',
        'pilz_industrial_motion_planner_planning.yaml',
        'planning_pipelines.yaml',
        'planning_scene_monitor.yaml',
    }


def test_scara_has_four_joints_and_a_full_pose_solver() -> None:
    values = move_group_parameters('gx4_c251s')
    manager = values['moveit_simple_controller_manager']
    for name in manager['controller_names']:
        assert manager[name]['joints'] == ['joint_1', 'joint_2', 'joint_3', 'joint_4']
    assert values['robot_description_kinematics'] == load('kinematics_scara.yaml')
    assert values['robot_description_kinematics'][GROUP]['position_only_ik'] is False
    assert values['ompl'] == {**load('ompl_planning.yaml'), 'totg': {'path_tolerance': 0.01}}


@pytest.mark.parametrize('model', one_in(2, ['gx8_c552s', 'c4_a901s']))
@pytest.mark.slow
def test_generated_package_works_with_moveit_configs_builder(model: str, tmp_path: Path) -> None:
    """File names follow moveit_configs_utils of Jazzy."""
    folder = tmp_path / f'{model}_moveit_config'
    command = [sys.executable, '-m', 'epson_driver.cli', 'robots', model, '--moveit', str(folder)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    files = {path.relative_to(folder).as_posix() for path in folder.rglob('*') if path.is_file()}
    assert {str(folder / name) for name in files} == set(run.stdout.splitlines())
    config = {path.name: path for path in (folder / 'config').iterdir()}
    assert {f'{model}.urdf', f'{model}.srdf', 'joint_limits.yaml', 'kinematics.yaml'} < set(config)
    assert {'moveit_controllers.yaml', 'pilz_cartesian_limits.yaml'} < set(config)
    assert {'ompl_planning.yaml', 'pilz_industrial_motion_planner_planning.yaml'} < set(config)
    assert config[f'{model}.urdf'].read_text('utf-8') == urdf(model)
    assert config[f'{model}.srdf'].read_text('utf-8') == srdf(model)
    read = {name: yaml.safe_load(path.read_text('utf-8')) for name, path in config.items()}
    values = rviz_parameters(model)
    assert read['kinematics.yaml'] == values['robot_description_kinematics']
    for pipeline in values['planning_pipelines']:
        assert read[f'{pipeline}_planning.yaml'] == values[pipeline]
    planning = read['joint_limits.yaml'] | read['pilz_cartesian_limits.yaml']
    assert planning == values['robot_description_planning']
    controllers = move_group_parameters(model)['moveit_simple_controller_manager']
    assert read['moveit_controllers.yaml']['moveit_simple_controller_manager'] == controllers
    manifest = ElementTree.parse(folder / 'package.xml').getroot()
    assert manifest.findtext('name') == folder.name
    assert f'project({folder.name} ' in (folder / 'CMakeLists.txt').read_text('utf-8')
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 2
    assert 'File exists' in again.stderr
