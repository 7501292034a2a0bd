# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters for ros2_control: hardware interface to the driver, and controllers."""

from collections.abc import Mapping
from typing import Any

from epson_driver.bringup.client import effective
from epson_driver.bringup.description import BringupError
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model

CONTROLLER = 'joint_trajectory_controller'
"""Name of the ros2_control controller to start."""

DEFAULT_PROFILE = 'simulated'

GOAL_TOLERANCE = {'revolute': 0.01, 'prismatic': 0.001}
"""Joint type → goal tolerance of the controller, rad or m."""

PATH_TOLERANCE_S = 0.5
"""Time by which the arm may lag behind the setpoint, s, from which the path tolerance follows. The
lag of a working arm is smaller. A larger lag aborts the goal."""

SERVO_SCALE = 0.25
"""Default of the driver's `servo.scale`, the fraction of the joint limits that streams may use."""


def ros2_control_arguments(namespace: str) -> dict[str, str]:
    """Return the arguments of epson_robot.urdf.xacro that add the ros2_control block.

    Topics are absolute, because the hardware plugin's node may be outside of the namespace.
    """
    inside = '/' + namespace.strip('/') if namespace.strip('/') else ''
    return {
        'ros2_control': 'true',
        'joint_commands_topic': f'{inside}/epson_driver/joint_commands',
        'joint_states_topic': f'{inside}/joint_states',
    }


def first_joint_state(namespace: str) -> list[str]:
    """Return a command that exits once the first joint state has arrived."""
    topic = ros2_control_arguments(namespace)['joint_states_topic']
    words = ('ros2', 'topic', 'echo', '--once', '--qos-reliability', 'best_effort', '--field')
    return [*words, 'header', topic, 'sensor_msgs/msg/JointState']


def controllers_parameters(model: str, prefix: str = '') -> dict[str, Any]:
    """Return the model's values for config/ros2_control/controllers.yaml."""
    robot = load_robot_model(model)
    joints = [prefix + name for name in robot.joint_names]
    path_tolerances = (PATH_TOLERANCE_S * SERVO_SCALE * robot.limits.velocity).round(3).tolist()
    constraints = {
        name: {'trajectory': tolerance, 'goal': GOAL_TOLERANCE[kind]}
        for name, tolerance, kind in zip(joints, path_tolerances, robot.joint_types, strict=True)
    }
    return {'joints': joints, 'constraints': constraints}


def check_streams(values: Mapping[str, str]) -> None:
    """Raise BringupError if a driver with these arguments cannot follow setpoint streams."""
    resolved = effective(values)
    program = load_controller_profile(resolved['controller'] or DEFAULT_PROFILE).program
    interface = resolved['interface'] or program.interface
    if program.kind == 'motoman':
        why = f'controller = {resolved["controller"]}: it does not support streams'
    elif interface != 'streaming':
        why = f'interface = {interface}: a download starts after the last point'
    else:
        return
    raise BringupError(f'launch argument ros2_control: the driver must follow streams, but {why}')
