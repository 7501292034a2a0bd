# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The YAML files of config/moveit against the SRDF, the robot model, and a running client."""

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from epson_driver.bringup import move_group_parameters, rviz_parameters
from epson_driver.cli import processes
from epson_driver.node.parameters import JOINTS, TABLE

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
    """A client in a namespace of its own, without a controller; its ROS domain."""
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
    """Return the FollowJointTrajectory actions that somebody in a domain serves."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    from rclpy.action import get_action_names_and_types
    from rclpy.context import Context
    from rclpy.node import Node

    context = Context()
    context.init(domain_id=domain)
    node = Node('onlooker', context=context)
    wanted = 'control_msgs/action/FollowJointTrajectory'
    try:
        end = time.monotonic() + patience
        names: set[str] = set()
        while not names and time.monotonic() < end:
            found = get_action_names_and_types(node)
            names = {name for name, types in found if wanted in types}
            time.sleep(0.05)
        return names
    finally:
        node.destroy_node()
        context.shutdown()


def test_moveit_calls_the_action_that_a_running_client_serves(running_client: int) -> None:
    # move_group runs in the same namespace, and takes both names as relative ones
    called = {f'/cell/{name}/{MANAGER[name]["action_ns"]}' for name in MANAGER['controller_names']}
    assert called == action_names(running_client)


def test_the_controller_is_of_the_kind_and_has_the_joints_of_the_client() -> None:
    plugin = 'moveit_simple_controller_manager/MoveItSimpleControllerManager'
    assert CONTROLLERS['moveit_controller_manager'] == plugin
    assert set(MANAGER) == {'controller_names', *MANAGER['controller_names']}
    (name,) = MANAGER['controller_names']
    assert MANAGER[name]['type'] == 'FollowJointTrajectory'
    assert MANAGER[name]['default'] is True
    assert MANAGER[name]['joints'] == JOINTS == DEFAULTS['joint_names']


def test_execution_fits_the_driver() -> None:
    execution = CONTROLLERS['trajectory_execution']
    assert execution['execution_duration_monitoring'] is False
    assert 0.0 < execution['allowed_start_tolerance'] <= DEFAULTS['start_tolerance']


def test_kinematics_and_planners_are_for_the_group_of_the_srdf() -> None:
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


def test_every_pipeline_has_its_file_in_the_form_of_jazzy() -> None:
    pipelines = load('planning_pipelines.yaml')
    assert pipelines['default_planning_pipeline'] in pipelines['planning_pipelines']
    files = {f'{name}_planning.yaml' for name in pipelines['planning_pipelines']}
    assert {path.name for path in FOLDER.glob('*_planning.yaml')} == files
    for name in files:
        pipeline = load(name)
        for kind in ('request', 'response'):
            adapters = pipeline[f'{kind}_adapters']
            assert all(each.startswith(f'default_planning_{kind}_adapters/') for each in adapters)
        assert isinstance(pipeline['planning_plugins'], list)  # planning_plugin was Humble's
    timed = 'default_planning_response_adapters/AddTimeOptimalParameterization'
    assert load('ompl_planning.yaml')['response_adapters'][0] == timed
    assert timed not in load('pilz_industrial_motion_planner_planning.yaml')['response_adapters']


def test_the_planners_that_are_configured_exist_in_ompl() -> None:
    geometric = pytest.importorskip('ompl.geometric')
    for name in load('ompl_planning.yaml')['planner_configs']:
        assert hasattr(geometric, name)


def test_cartesian_limits_are_within_what_spel_allows() -> None:
    limits = load('pilz_cartesian_limits.yaml')['cartesian_limits']
    assert 0.0 < limits['max_trans_vel'] <= 2.0  # SpeedS
    assert 0.0 < limits['max_trans_acc'] <= 15.0  # AccelS, of the longest arm
    assert limits['max_trans_dec'] == -limits['max_trans_acc']
    assert 0.0 < limits['max_rot_vel'] <= 17.4  # SpeedR


def test_move_group_gets_every_file_and_rviz_what_its_panel_needs() -> None:
    values = move_group_parameters('c3_a601s', 'left_')
    assert values['robot_description_kinematics'] == load('kinematics.yaml')
    planning = values['robot_description_planning']
    assert planning['cartesian_limits'] == load('pilz_cartesian_limits.yaml')['cartesian_limits']
    assert planning['default_velocity_scaling_factor'] == 0.1
    own = load('c3_a601s/joint_limits.yaml')['joint_limits']
    assert planning['joint_limits'] == {f'left_{joint}': each for joint, each in own.items()}
    for name in ('planning_pipelines.yaml', 'planning_scene_monitor.yaml'):
        assert load(name).items() <= values.items()
    for pipeline in values['planning_pipelines']:
        assert values[pipeline] == load(f'{pipeline}_planning.yaml')
    panel = rviz_parameters('c3_a601s', 'left_')
    assert panel.items() <= values.items()
    assert set(values) - set(panel) == {*CONTROLLERS, *load('planning_scene_monitor.yaml')}
    read = {path.name for path in FOLDER.glob('*.yaml')} - {'servo.yaml'}  # of MoveIt Servo
    assert read == {
        'kinematics.yaml',
        'kinematics_scara.yaml',
        'moveit_controllers.yaml',
        'ompl_planning.yaml',
        'pilz_cartesian_limits.yaml',
        'pilz_industrial_motion_planner_planning.yaml',
        'planning_pipelines.yaml',
        'planning_scene_monitor.yaml',
    }


def test_a_scara_has_its_four_joints_and_a_solver_that_keeps_the_turn() -> None:
    values = move_group_parameters('gx4_c251s')
    manager = values['moveit_simple_controller_manager']
    for name in manager['controller_names']:
        assert manager[name]['joints'] == ['joint_1', 'joint_2', 'joint_3', 'joint_4']
    assert values['robot_description_kinematics'] == load('kinematics_scara.yaml')
    assert values['robot_description_kinematics'][GROUP]['position_only_ik'] is False
