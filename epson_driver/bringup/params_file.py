# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client's parameters in a params_file, for one or several robots."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from epson_driver.bringup.description import BringupError
from epson_driver.setup.robot_file import PARAMETERS, fits_node, node_sections

NODE_NAME = 'epson_driver'
"""Name of the client's node in the launch files."""


def file_parameters(path: str, namespace: str) -> dict[str, Any]:
    """Return the client's parameters in a file. Later sections override earlier ones."""
    if not Path(path).is_file():
        raise BringupError(f'launch argument params_file = {path}: no such file')
    node = '/' + '/'.join([*filter(None, namespace.split('/')), NODE_NAME])
    sections = node_sections(Path(path))
    matching = [values for name, values in sections.items() if fits_node(name, node)]
    if not matching:
        raise BringupError(
            f'launch argument params_file = {path}: it has no {PARAMETERS} for the node {node}, '
            f'only for {", ".join(sections) or "no node"}'
        )
    return {name: value for values in matching for name, value in values.items()}


EACH = (
    'robot_model',
    'controller',
    'interface',
    'motion_port',
    'state_port',
    'io_port',
    'remote_port',
    'params_file',
    'parent',
    'origin_xyz',
    'origin_rpy',
)
"""Arguments with one value for all robots, or with one comma-separated value for each robot."""


def several_robots(values: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the arguments of each robot: one mapping per namespace."""
    namespaces = values['namespaces']
    names = _words(namespaces)
    if '' in names or len(set(names)) != len(names):
        raise BringupError(f'namespaces = {namespaces}: must be unique, non-empty names')
    lists = {'robot_ip': _words(values['robot_ips'])}
    if len(lists['robot_ip']) != len(names):
        raise BringupError(
            f'robot_ips has {len(lists["robot_ip"])} addresses, '
            f'but namespaces has {len(names)} names'
        )
    for argument in EACH:
        words = _words(values[argument])
        if len(words) not in (1, len(names)):
            raise BringupError(
                f'{argument} has {len(words)} values, but namespaces has {len(names)} names: '
                'give one for all, or one per name'
            )
        lists[argument] = words if len(words) == len(names) else words * len(names)
    return [
        {'namespace': name, 'tf_prefix': name.strip('/').replace('/', '_') + '_'}
        | {argument: words[index] for argument, words in lists.items()}
        for index, name in enumerate(names)
    ]


def fleet_robots(values: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the arguments of all robots in params_file, or only of the robots in `robots`."""
    path = values['params_file']
    if not Path(path).is_file():
        raise BringupError(f'launch argument params_file = {path}: no such file')
    available = [
        name.removesuffix(f'/{NODE_NAME}').strip('/')
        for name in node_sections(Path(path))
        if name.endswith(f'/{NODE_NAME}') and '*' not in name
    ]
    names = _words(values['robots']) if values['robots'] else available
    missing = [name for name in names if name not in available]
    if missing or not names:
        which = missing[0] if missing else 'robot'
        raise BringupError(
            f'launch argument robots: no {which} in {path}, only '
            f'{", ".join(available) or "none"} (sections /NAME/{NODE_NAME})'
        )
    arguments = dict.fromkeys(EACH, '') | {'origin_xyz': '0 0 0', 'origin_rpy': '0 0 0'}
    lists = {'namespaces': ','.join(names), 'robot_ips': ',' * (len(names) - 1)}
    return [robot | {'params_file': path} for robot in several_robots(arguments | lists)]


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(',')]
