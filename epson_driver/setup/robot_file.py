# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The file of one robot, robot.yaml: address, profile, model, and ports other than the profile's.

`epson_driver connect` writes it. It is a ROS parameter file, so `--params-file` accepts it, too.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from epson_driver.inputs import MEGABYTE, InputError, printable, read_file, read_yaml, shown

KEYS = (
    *('robot_ip', 'controller', 'robot_model'),
    *('motion_port', 'state_port', 'io_port', 'remote_port'),
)
"""Settings in the file."""

_NODES, _PARAMETERS = '/**', 'ros__parameters'


def is_robot_file(name: str) -> bool:
    """Return whether a name is the path of a robot's file, by its first key."""
    try:
        return name.endswith('.yaml') and b'\n/**:' in b'\n' + read_file(Path(name), MEGABYTE)
    except InputError:
        return False


def robot_settings(name: str) -> dict[str, Any]:
    """Return the settings in a robot's file by name. Raises InputError if it is none."""
    from epson_driver.setup.table import ROWS  # imported with the first file, to start fast

    path = Path(name)
    content: Any = read_yaml(path)
    for key in (_NODES, _PARAMETERS):
        content = content.get(key) if isinstance(content, dict) else None
    if not isinstance(content, dict) or 'robot_ip' not in content:
        rule = f'must have {_NODES}, {_PARAMETERS} and robot_ip, as `epson_driver connect` writes'
        raise InputError(f'{printable(path)}: {rule}')
    for key, value in content.items():
        where = f'{printable(path)}: {key}'
        if key not in KEYS:
            raise InputError(f'{where} = {shown(value)}: must be one of {", ".join(KEYS)}')
        ROWS[key].allowed.checked(value, where)
    return content


def robot_text(settings: Mapping[str, Any], about: str) -> str:
    """Return the text of a robot's file. about: a line about its origin."""
    import yaml

    content = {_NODES: {_PARAMETERS: dict(settings)}}
    return f'# {about}\n{yaml.safe_dump(content, sort_keys=False, allow_unicode=True)}'
