# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ros2_control with the driver: the URDF block, the controllers, and refused combinations.

No controller manager runs here. Names are compared with the documentation of
joint_state_topic_hardware_interface, controller_manager and ros2_controllers of Jazzy, and with
the driver's topics.
"""

import re
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from epson_driver.bringup import (
    CONTROLLER,
    INTERFACE,
    BringupError,
    check_streams,
    controllers_parameters,
    launch_arguments,
    move_group_parameters,
    robot_description,
    ros2_control_arguments,
)
from epson_driver.driver.servo.servo import MAX_LAG_S
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path

VALUES = {argument['name']: argument['default_value'] for argument in launch_arguments(*INTERFACE)}
VALUES['interface'] = ''


def controllers() -> dict[str, Any]:
    text = share_path('config', 'ros2_control', 'controllers.yaml').read_text('utf-8')
    return {
        name.removeprefix('/**/'): section['ros__parameters']
        for name, section in yaml.safe_load(text).items()
    }


def block(model: str, prefix: str = '', namespace: str = '') -> ElementTree.Element:
    text = robot_description(model, prefix, **ros2_control_arguments(namespace))
    (result,) = ElementTree.fromstring(text).findall('ros2_control')
    return result


@pytest.mark.parametrize('model', ['c3_a601s', 'gx4_c251s'])
@pytest.mark.parametrize('prefix', ['', 'left_'])
def test_ros2_control_block_has_every_moving_joint_of_the_urdf(model: str, prefix: str) -> None:
    """The controller manager refuses a block with an unknown joint."""
    text = robot_description(model, prefix, **ros2_control_arguments(''))
    root = ElementTree.fromstring(text)
    moving = [item.get('name') for item in root.findall('joint') if item.get('type') != 'fixed']
    result = block(model, prefix)
    assert [item.get('name') for item in result.findall('joint')] == moving
    assert moving == [prefix + name for name in load_robot_model(model).joint_names]
    assert (result.get('name'), result.get('type')) == (f'{prefix}epson', 'system')


def test_ros2_control_block_has_plugin_and_topics() -> None:
    hardware = block('c3_a601s').find('hardware')
    assert hardware is not None
    plugin = 'joint_state_topic_hardware_interface/JointStateTopicSystem'
    assert hardware.findtext('plugin') == plugin
    parameters = {item.get('name'): item.text for item in hardware.findall('param')}
    assert parameters == {
        'joint_commands_topic': '/epson_driver/joint_commands',
        'joint_states_topic': '/joint_states',
    }


def test_ros2_control_interfaces_are_position_and_velocity() -> None:
    for joint in block('c3_a601s').findall('joint'):
        for kind in ('command_interface', 'state_interface'):
            assert [item.get('name') for item in joint.findall(kind)] == ['position', 'velocity']
        assert joint.findall('.//param') == []  # an initial_value would be commanded first


@pytest.mark.parametrize('namespace', ['cell', '/cell/', 'line/two'])
def test_topics_are_in_the_namespace_of_the_driver(namespace: str) -> None:
    inside = '/' + namespace.strip('/')
    arguments = ros2_control_arguments(namespace)
    assert arguments['joint_commands_topic'] == f'{inside}/epson_driver/joint_commands'
    assert arguments['joint_states_topic'] == f'{inside}/joint_states'


def test_controllers_claim_interfaces_of_the_block() -> None:
    result = controllers()
    manager = result.pop('controller_manager')
    types = {
        name: element['type'] for name, element in manager.items() if isinstance(element, dict)
    }
    assert types == {
        CONTROLLER: 'joint_trajectory_controller/JointTrajectoryController',
        'forward_position_controller': 'forward_command_controller/ForwardCommandController',
    }
    assert set(result) == set(types)
    joints = list(load_robot_model('c3_a601s').joint_names)
    assert all(item['joints'] == joints for item in result.values())
    offered = {'position', 'velocity'}
    own = result[CONTROLLER]
    assert {*own['command_interfaces'], *own['state_interfaces']} <= offered
    assert result['forward_position_controller']['interface_name'] in offered
    assert manager['update_rate'] == 100


def test_joints_and_tolerances_match_model_and_prefix() -> None:
    own = controllers()[CONTROLLER]
    plain = controllers_parameters('c3_a601s')
    assert plain['joints'] == own['joints']
    assert plain['constraints'].items() <= own['constraints'].items()
    scara = controllers_parameters('gx4_c251s', 'left_')
    limits = load_robot_model('gx4_c251s').limits
    behind = (MAX_LAG_S * ServoSettings().scale * limits.velocity).round(3).tolist()
    assert scara['joints'] == [f'left_joint_{number}' for number in range(1, 5)]
    assert scara['constraints']['left_joint_3'] == {'trajectory': behind[2], 'goal': 0.001}  # m
    assert scara['constraints']['left_joint_4'] == {'trajectory': behind[3], 'goal': 0.01}  # rad


def test_moveit_uses_the_started_controller() -> None:
    manager = move_group_parameters('c3_a601s', 'left_', CONTROLLER)[
        'moveit_simple_controller_manager'
    ]
    assert manager['controller_names'] == [CONTROLLER]
    assert manager[CONTROLLER]['joints'] == [f'left_joint_{number}' for number in range(1, 7)]
    assert manager[CONTROLLER]['action_ns'] == 'follow_joint_trajectory'
    assert set(manager) == {'controller_names', CONTROLLER}


@pytest.mark.parametrize(
    ('given', 'why'),
    [
        ({'interface': 'download'}, 'interface = download: a download starts after'),
        ({'controller': 'abb'}, 'interface = download: a download starts after'),
        ({'controller': 'motoman'}, 'controller = motoman: it does not support streams'),
    ],
)
def test_driver_without_streams_is_refused(given: dict[str, str], why: str) -> None:
    with pytest.raises(BringupError, match=re.escape(why)):
        check_streams(VALUES | given)


def test_moveit_servo_publishes_to_the_trajectory_topic() -> None:
    file = yaml.safe_load(share_path('config', 'moveit', 'servo.yaml').read_text('utf-8'))
    (servo,) = file.values()
    assert servo['command_out_topic'] == 'epson_driver/servo'
    assert servo['command_out_type'] == 'trajectory_msgs/JointTrajectory'
    assert servo['publish_joint_positions']
    assert servo['publish_joint_velocities']
    assert servo['max_expected_latency'] < 0.5  # epson_driver.node.servo_interface.MAX_AHEAD_S
    assert servo['move_group_name'] == 'manipulator'
