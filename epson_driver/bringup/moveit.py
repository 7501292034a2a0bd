# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""MoveIt configuration of a robot model, as parameters for launch files or as a ROS package.

Values shared by all models are in config/moveit/. The other values are derived from the model's
data.
"""

from pathlib import Path
from typing import Any

import yaml

from epson_driver.bringup.description import robot_description, semantic_description
from epson_driver.inputs import MEGABYTE, read_file, read_yaml, write_file
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.robots.kinematics import singularity_thresholds
from epson_driver.share import share_path

JOINTS_OF_A_FREE_TOOL = 6
"""Minimum number of joints of an arm whose tool can have any orientation. For fewer joints,
MoveIt's KDL solver is set to solve for the position only."""

MARGIN_FRACTION = 0.05
"""Maximum margin of MoveIt Servo at each joint limit, as a fraction of the joint's range. It
reduces the margin of a joint with a short range, such as a SCARA's shaft."""

SCARA_CORNERS = 0.01
"""`path_tolerance` of MoveIt's TOTG (time-optimal trajectory generation) for a SCARA, rad and m.
MoveIt's default of 0.1 would permit the shaft to leave the path by 10 cm."""

OWN_ACTION = 'epson_driver'
"""Name of the driver's node, whose action follow_joint_trajectory executes MoveIt's plans."""

PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>0.1.0</version>
  <description>MoveIt configuration of {model}, written by epson_driver</description>
  <maintainer email="you@example.org">you</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <exec_depend>epson_driver_moveit</exec_depend>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""

CMAKE_LISTS = """cmake_minimum_required(VERSION 3.22)
project({name} NONE)
find_package(ament_cmake REQUIRED)
install(DIRECTORY config DESTINATION share/${{PROJECT_NAME}})
ament_package()
"""


def move_group_parameters(
    model: str, prefix: str = '', controller: str = OWN_ACTION, *, fix_start_state: bool = False
) -> dict[str, Any]:
    """Return the parameters of move_group, without the robot's URDF and SRDF."""
    joints = [prefix + joint for joint in load_robot_model(model).joint_names]
    rviz = rviz_parameters(model, prefix)
    if fix_start_state:
        for pipeline in rviz['planning_pipelines']:
            rviz[pipeline]['fix_start_state'] = True
    return {
        **rviz,
        **_controllers(joints, controller),
        **_load('planning_scene_monitor.yaml'),
    }


def rviz_parameters(model: str, prefix: str = '') -> dict[str, Any]:
    robot = load_robot_model(model)
    limits = joint_limits(robot, prefix)
    pipelines = _load('planning_pipelines.yaml')
    return {
        'robot_description_kinematics': _load(_kinematics(robot)),
        'robot_description_planning': {**limits, **_load('pilz_cartesian_limits.yaml')},
        **pipelines,
        **{name: _planner(name, robot) for name in pipelines['planning_pipelines']},
    }


def servo_parameters(model: str) -> dict[str, Any]:
    parameters = _load('servo.yaml')
    robot = load_robot_model(model)
    (margin,) = parameters['moveit_servo']['joint_limit_margins']
    ranges = robot.limits.position_max - robot.limits.position_min
    margins = [min(margin, round(MARGIN_FRACTION * item, 4)) for item in ranges.tolist()]
    parameters['moveit_servo']['joint_limit_margins'] = margins
    lower, stop = singularity_thresholds(robot)
    parameters['moveit_servo']['lower_singularity_threshold'] = lower
    parameters['moveit_servo']['hard_stop_singularity_threshold'] = stop
    return parameters


def joint_limits(model: RobotModel, prefix: str = '') -> dict[str, Any]:
    """Return MoveIt's joint_limits.yaml for a model.

    The position limits are not in this file, but in the URDF.
    """
    rows: dict[str, dict[str, Any]] = {prefix + joint: {} for joint in model.joint_names}
    for quantity in ('velocity', 'acceleration', 'jerk'):
        for row, value in zip(rows.values(), getattr(model.limits, quantity), strict=True):
            row[f'has_{quantity}_limits'] = True
            row[f'max_{quantity}'] = float(value)
    return _load('joint_limits.yaml') | {'joint_limits': rows}


def write_moveit_package(name: str, folder: Path) -> list[Path]:
    """Write a ROS package for MoveItConfigsBuilder, and return its files.

    The package has the name of the folder. The builder finds it by the model's name if the folder
    is called MODEL_moveit_config. Raises OSError if the folder exists already.
    """
    model = load_robot_model(name)
    urdf, srdf = robot_description(name), semantic_description(name)
    folder.mkdir(parents=True)
    config = folder / 'config'
    config.mkdir()
    for file in share_path('config', 'moveit').glob('*.yaml'):
        if not file.name.startswith(('kinematics', 'joint_limits')):
            write_file(config / file.name, read_file(file, MEGABYTE))
    kinematics = share_path('config', 'moveit', _kinematics(model))
    write_file(config / 'kinematics.yaml', read_file(kinematics, MEGABYTE))
    if not _free_tool(model):
        write_file(config / 'ompl_planning.yaml', _text(_planner('ompl', model)))
    controllers = _controllers(list(model.joint_names))
    origins = ''.join(
        f'# {quantity} ({item.worst}): {item.source}\n'
        for quantity, item in model.provenance.items()
        if quantity in ('speed', 'acceleration', 'jerk')
    )
    for path, text in {
        config / f'{model.name}.urdf': urdf,
        config / f'{model.name}.srdf': srdf,
        config / 'joint_limits.yaml': origins + _text(joint_limits(model)),
        config / 'moveit_controllers.yaml': _text(controllers),
        folder / 'package.xml': PACKAGE_XML.format(name=folder.name, model=model.name),
        folder / 'CMakeLists.txt': CMAKE_LISTS.format(name=folder.name),
    }.items():
        write_file(path, text)
    return sorted(path for path in folder.rglob('*') if path.is_file())


def _controllers(joints: list[str], controller: str = OWN_ACTION) -> dict[str, Any]:
    controllers = _load('moveit_controllers.yaml')
    manager = controllers['moveit_simple_controller_manager']
    manager['controller_names'] = [controller]
    manager[controller] = manager.pop(OWN_ACTION) | {'joints': joints}
    return controllers


def _free_tool(model: RobotModel) -> bool:
    return len(model.joint_names) >= JOINTS_OF_A_FREE_TOOL


def _kinematics(model: RobotModel) -> str:
    return 'kinematics.yaml' if _free_tool(model) else 'kinematics_scara.yaml'


def _planner(name: str, model: RobotModel) -> dict[str, Any]:
    values = _load(f'{name}_planning.yaml')
    relaxed = name == 'ompl' and not _free_tool(model)
    return values | {'totg': {'path_tolerance': SCARA_CORNERS}} if relaxed else values


def _text(values: dict[str, Any]) -> str:
    return str(yaml.safe_dump(values, sort_keys=False))


def _load(*parts: str) -> dict[str, Any]:
    path = share_path('config', 'moveit', *parts)
    values: dict[str, Any] = read_yaml(path)
    return values
