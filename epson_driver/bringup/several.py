# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Several robots from lists or from one file, each with the prefix of its namespace."""

from collections.abc import Mapping
from pathlib import Path

from epson_driver.bringup.description import BringupError
from epson_driver.bringup.params_file import NODE_NAME, node_sections

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
"""Arguments that may have one value for all robots, or one for each, separated by commas."""


def several_robots(values: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the arguments of one robot per namespace that differ between the robots.

    Raises BringupError if the lists do not match.
    """
    namespaces = values['namespaces']
    names = _words(namespaces)
    if '' in names or len(set(names)) != len(names):
        raise BringupError(
            f'namespaces = {namespaces}: each must have a name, and no two the same'
        )
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
                'give one for all, or one for each'
            )
        lists[argument] = words if len(words) == len(names) else words * len(names)
    return [
        {'namespace': name, 'tf_prefix': name.strip('/').replace('/', '_') + '_'}
        | {argument: words[index] for argument, words in lists.items()}
        for index, name in enumerate(names)
    ]


def fleet_robots(values: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the arguments of each robot in params_file, or only of the robots in `robots`.

    A robot is a section named after its node, `/robot_1/epson_driver`. Raises BringupError if the
    file has no robot or lacks one of `robots`, InputError if it is not YAML.
    """
    path = values['params_file']
    if not Path(path).is_file():
        raise BringupError(f'launch argument params_file = {path}: there is no such file')
    there = [
        name.removesuffix(f'/{NODE_NAME}').strip('/')
        for name in node_sections(Path(path))
        if name.endswith(f'/{NODE_NAME}') and '*' not in name
    ]
    names = _words(values['robots']) if values['robots'] else there
    lacking = [name for name in names if name not in there]
    if lacking or not names:
        which = lacking[0] if lacking else 'robot'
        raise BringupError(
            f'launch argument robots: there is no {which} in {path}; its robots are '
            f'{", ".join(there) or "none"} (a section /NAME/{NODE_NAME} for each)'
        )
    given = dict.fromkeys(EACH, '') | {'origin_xyz': '0 0 0', 'origin_rpy': '0 0 0'}
    lists = {'namespaces': ','.join(names), 'robot_ips': ',' * (len(names) - 1)}
    return [robot | {'params_file': path} for robot in several_robots(given | lists)]


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(',')]
