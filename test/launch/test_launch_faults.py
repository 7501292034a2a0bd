# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The checks of launch files find what is wrong with a broken one."""

from pathlib import Path

import pytest
from launch_rules import faults
from launch_stand_in import LaunchError, launched

FILE = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument('robot_ip', default_value='', description='Its address.'),
            ENTITY
        ]
    )
"""


def problems(entity: str, folder: Path) -> str:
    """Return everything that the checks say about a file with one more entity."""
    path = folder / 'broken.launch.py'
    path.write_text(FILE.replace('ENTITY', entity), encoding='utf-8')
    try:
        return ' / '.join(faults(path, launched(path)))
    except (LaunchError, SyntaxError, NameError, TypeError) as error:
        return f'{type(error).__name__}: {error}'


CLIENT = "Node(package='epson_driver', executable='client'"


@pytest.mark.parametrize(
    ('entity', 'text'),
    [
        ('', ''),
        (f"{CLIENT}, parameters=[{{'io_port': 0, 'timing': 'as_planned'}}])", ''),
        (f"{CLIENT}, parameters=[{{'robot_iq': 'x'}}])", 'the client has no parameter robot_iq'),
        (f"{CLIENT}, parameters=[{{'motion_port': '11000'}}])", 'would become 11000'),
        (f"{CLIENT}, parameters=[{{'motion_port': 11000.0}}])", 'must be like 11000'),
        (f"{CLIENT}, parameters=[{{'motion_port': 0}}])", 'must be from 1 to 65535'),
        (f"{CLIENT}, parameters=[{{'interface': 'telepathy'}}])", 'must be one of'),
        (f"{CLIENT}, parameters=[{{'robot_ip': ''}}])", "robot_ip = '' would become None"),
        (f"{CLIENT}, parameters=[{{'joint_names': []}}])", 'joint_names = []: empty'),
        (f"{CLIENT}, parameters=['/no/such/file.yaml'])", 'file.yaml does not exist'),
        (f"{CLIENT}, name='driver')", 'the client must be named epson_driver'),
        (f'{CLIENT}, node_namespace="x")', 'unexpected keyword'),
        ("Node(package='epson_driver', executable='klient')", 'has no executable klient'),
        ("Node(package='epson_driver', executable='sim_controller')", 'is no ROS node'),
        ("Node(package='rviz3', executable='rviz3')", 'no package.xml has an exec_depend rviz3'),
        ("Node(package='rviz2', executable='rviz')", 'rviz2 has no executable rviz'),
        (
            "ExecuteProcess(cmd=[ExecutableInPackage(executable='rviz2', package='rviz2')])",
            'rviz2 is a ROS node: use Node',
        ),
        ("DeclareLaunchArgument('speed', default_value='1')", 'argument speed has no sentence'),
        ("DeclareLaunchArgument('speed', description='How fast.')", 'speed was not provided'),
        (
            "DeclareLaunchArgument('robot_ip', default_value='', description='Once more.')",
            'argument robot_ip is declared twice',
        ),
        (
            "DeclareLaunchArgument('a', default_value='x', description='A.', choices=['y'])",
            'default x of a is not among',
        ),
        (
            "IncludeLaunchDescription(PythonLaunchDescriptionSource('no.launch.py'))",
            'no.launch.py does not exist',
        ),
        (
            'IncludeLaunchDescription(PythonLaunchDescriptionSource('
            f"'{Path(__file__).parents[2]}/launch/rviz.launch.py'), "
            "launch_arguments=[('robot_ip', '')])",
            "rviz.launch.py does not declare ['robot_ip']",
        ),
        (
            "Node(package='rviz2', executable='rviz2', namespace=LaunchConfiguration('ns'))",
            'launch configuration ns does not exist',
        ),
        ('LaunchDescription(', 'SyntaxError'),
        ('TimerAction()', 'NameError'),
    ],
)
def test_a_fault_is_found(entity: str, text: str, tmp_path: Path) -> None:
    found = problems(entity, tmp_path)
    assert text in found
    assert bool(found) == bool(text)
