# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of move_group and of MoveIt's panel in RViz, from config/moveit/."""

from typing import Any

from epson_driver.inputs import read_yaml
from epson_driver.share import share_file

JOINTS_OF_A_FREE_TOOL = 6
"""With fewer the tool cannot have every orientation, and KDL solves for its place alone."""

OWN_ACTION = 'epson_driver'
"""The driver, whose action executes what MoveIt plans."""


def move_group_parameters(
    model: str, prefix: str = '', controller: str = OWN_ACTION
) -> dict[str, Any]:
    """Return the parameters of move_group, without the two descriptions of the robot.

    `controller`: the node whose action follow_joint_trajectory executes.
    """
    controllers = _load('moveit_controllers.yaml')
    manager = controllers['moveit_simple_controller_manager']
    joints = _load(model, 'joint_limits.yaml')['joint_limits']
    manager['controller_names'] = [controller]
    manager[controller] = manager.pop(OWN_ACTION)
    manager[controller]['joints'] = [prefix + joint for joint in joints]
    return {
        **rviz_parameters(model, prefix),
        **controllers,
        **_load('planning_scene_monitor.yaml'),
    }


def rviz_parameters(model: str, prefix: str = '') -> dict[str, Any]:
    """Return the parameters of MoveIt's panel in RViz: kinematics, limits, and planners."""
    limits = _load(model, 'joint_limits.yaml')
    free = len(limits['joint_limits']) >= JOINTS_OF_A_FREE_TOOL
    limits['joint_limits'] = {
        prefix + joint: values for joint, values in limits['joint_limits'].items()
    }
    pipelines = _load('planning_pipelines.yaml')
    return {
        'robot_description_kinematics': _load(
            'kinematics.yaml' if free else 'kinematics_scara.yaml'
        ),
        'robot_description_planning': {**limits, **_load('pilz_cartesian_limits.yaml')},
        **pipelines,
        **{name: _load(f'{name}_planning.yaml') for name in pipelines['planning_pipelines']},
    }


def _load(*parts: str) -> dict[str, Any]:
    path = share_file('config', 'moveit', *parts)
    values: dict[str, Any] = read_yaml(path)
    return values
