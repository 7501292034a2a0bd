# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Several robots from lists; the prefix of each is made from its namespace."""

from collections.abc import Mapping

from epson_driver.bringup.description import BringupError

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
    """Return the arguments of one robot per namespace: what differs from the other robots.

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


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(',')]
