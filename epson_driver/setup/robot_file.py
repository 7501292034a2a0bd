# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The file of one robot, robot.yaml.

It contains address, profile, model, and the ports that differ from the profile.

`epson_driver connect` writes it. It is a ROS parameter file, so `--params-file` accepts it, too.
"""

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from epson_driver.inputs import MEGABYTE, InputError, printable, read_file, read_yaml, shown

KEYS = (
    *('robot_ip', 'controller', 'robot_model'),
    *('motion_port', 'state_port', 'io_port', 'remote_port'),
    'password_variable',
)
"""Names of the settings that a robot's file may have."""

NODES, PARAMETERS = '/**', 'ros__parameters'


def is_robot_file(name: str) -> bool:
    """Return whether `name` is the path of a robot's file: a .yaml file with the key `/**`."""
    try:
        return name.endswith('.yaml') and b'\n/**:' in b'\n' + read_file(Path(name), MEGABYTE)
    except InputError:
        return False


def robot_settings(name: str) -> dict[str, Any]:
    from epson_driver.setup.table import ROWS  # imported with the first file, to start fast

    path = Path(name)
    if not path.exists():
        raise InputError(f'{printable(path)}: no such file; `epson_driver connect` writes one')
    content = node_sections(path).get(NODES, {})
    if 'robot_ip' not in content:
        rule = f'must have {NODES}, {PARAMETERS} and robot_ip, as `epson_driver connect` writes'
        raise InputError(f'{printable(path)}: {rule}')
    for key, value in content.items():
        where = f'{printable(path)}: {key}'
        if key not in KEYS:
            raise InputError(f'{where} = {shown(value)}: must be one of {", ".join(KEYS)}')
        ROWS[key].allowed.checked(value, where)
    return content


def password_in(variable: str, usual: str) -> str:
    """Return the password in an environment variable, or `usual` if `variable` is ''."""
    if not variable:
        return usual
    password = os.environ.get(variable)
    if password is None:
        rule = f'this environment variable is not set: export {variable}=…'
        raise InputError(f'password_variable = {variable}: {rule}')
    return password


def robot_text(settings: Mapping[str, Any], about: str) -> str:
    import yaml

    content = {NODES: {PARAMETERS: dict(settings)}}
    return f'# {about}\n{yaml.safe_dump(content, sort_keys=False, allow_unicode=True)}'


def node_sections(path: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters in a file by node name, which may contain the wildcards * and **."""
    content = read_yaml(path)
    return dict(_sections(content)) if isinstance(content, Mapping) else {}


def _sections(content: Mapping[str, Any], above: str = '') -> Iterator[tuple[str, dict[str, Any]]]:
    for name, value in content.items():
        if not isinstance(value, Mapping):
            continue
        if name == PARAMETERS:
            yield above or NODES, dict(value)
        else:
            yield from _sections(value, f'{above}/{str(name).strip("/")}')


def fits_node(pattern: str, node: str) -> bool:
    expression = re.escape(pattern).replace(r'/\*\*', '(/.*)?').replace(r'\*', '[^/]*')
    return re.fullmatch(expression, node) is not None
