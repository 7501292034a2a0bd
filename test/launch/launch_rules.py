# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is held against every launch file: the names in it must exist somewhere."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from launch_stand_in import Context, DeclareLaunchArgument, ExecuteProcess, Node, description

ROOT = Path(__file__).parents[2]
OWN = 'epson_driver'

ROS_EXECUTABLES = {
    'controller_manager': {'ros2_control_node', 'spawner'},
    'joint_state_publisher_gui': {'joint_state_publisher_gui'},
    'moveit_ros_move_group': {'move_group'},
    'ros2cli': {'ros2'},
    'robot_state_publisher': {'robot_state_publisher'},
    'rviz2': {'rviz2'},
    'tf2_ros': {'static_transform_publisher'},
}
"""Executables of other packages, by package."""

NODES = {'smooth_goals'}
"""Our own ROS nodes besides the client."""

IMPORTS = {'launch', 'launch_ros'}
"""Packages that launch files import."""


MANIFESTS = {
    'epson_driver': ROOT / 'package.xml',
    'epson_driver_moveit': ROOT / 'variants/epson_driver_moveit/package.xml',
    'epson_driver_ros2_control': ROOT / 'variants/epson_driver_ros2_control/package.xml',
    'epson_driver_desktop': ROOT / 'variants/epson_driver_desktop/package.xml',
}


def dependencies(package: str = 'epson_driver') -> set[str]:
    """Return the packages that a package of ours asks for at run time, be it through others."""
    root = ElementTree.parse(MANIFESTS[package]).getroot()
    names = {str(each.text) for each in root.findall('exec_depend')}
    return names.union(*(dependencies(name) for name in names & MANIFESTS.keys()))


def own_executables() -> set[str]:
    """Return the names that setup.py installs as executables: links to one of them."""
    return {path.name for path in (ROOT / 'scripts').iterdir() if path.is_symlink()}


def faults(path: Path, context: Context) -> Iterator[str]:
    """Yield what is wrong with a launch file and with what it would start."""
    yield from argument_faults(path)
    for process in context.started:
        yield from process_faults(process)
        if isinstance(process, Node) and (process.package, process.executable) == (OWN, 'client'):
            yield from client_faults(process)


def argument_faults(path: Path) -> Iterator[str]:
    """Yield arguments without a description, and those that are declared twice."""
    seen: set[str] = set()
    for each in description(path).entities:
        if not isinstance(each, DeclareLaunchArgument):
            continue
        if not (each.description or '').endswith('.'):
            yield f'argument {each.name} has no sentence that describes it'
        if each.default_value is None:
            yield f'argument {each.name} has no default'
        if each.name in seen:
            yield f'argument {each.name} is declared twice'
        seen.add(each.name)


def process_faults(process: Any) -> Iterator[str]:
    """Yield packages and executables that nobody has."""
    if process.package == OWN:
        known = own_executables()
    elif process.package in dependencies('epson_driver_desktop'):
        known = ROS_EXECUTABLES.get(process.package, set())
    else:
        yield f'no package.xml has an exec_depend {process.package}'
        return
    if process.executable not in known:
        yield f'{process.package} has no executable {process.executable}'
    if isinstance(process, Node) and (process.package, process.executable) == (OWN, 'client'):
        if process.name not in (None, OWN):
            yield f'the client must be named {OWN}, as MoveIt knows it, not {process.name}'
    elif isinstance(process, Node) and process.package == OWN and process.executable not in NODES:
        yield f'{process.executable} is no ROS node: it takes no --ros-args'
    elif isinstance(process, ExecuteProcess) and process.package not in (OWN, 'ros2cli'):
        yield f'{process.executable} is a ROS node: use Node'


def client_faults(node: Node) -> Iterator[str]:
    """Yield parameters that the client does not declare, or not with this type or range."""
    from epson_driver.setup.table import TABLE

    rows = {row.name: row for row in TABLE}
    for name, value in node.parameters.items():
        row = rows.get(name)
        if name == 'use_sim_time' and isinstance(value, bool):  # every node has it
            continue
        if row is None:
            yield f'the client has no parameter {name}'
        elif type(value) is not type(row.default):
            yield f'parameter {name} = {value!r}: must be like {row.default!r}'
        elif row.choices and value not in row.choices:
            yield f'parameter {name} = {value!r}: must be one of {row.choices}'
        elif row.low is not None and row.high is not None and not row.low <= value <= row.high:
            yield f'parameter {name} = {value!r}: must be from {row.low} to {row.high}'
