# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of user input: files, parameters and arguments.

Invalid input raises InputError and no other exception. Its text is one sentence with the place,
the value and the rule.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from epson_driver.inputs.files import MEGABYTE, open_file, read_file, write_file
from epson_driver.inputs.rules import (
    FRAME_NAME,
    HOST,
    JOINT_NAMES,
    VARIABLE,
    ArgumentError,
    InputError,
    RobotError,
    Rule,
    choice,
    count,
    decimal,
    list_of,
    meant,
    near_name,
    near_names,
    number,
    printable,
    shown,
)

__all__ = [
    'FRAME_NAME',
    'HOST',
    'JOINT_NAMES',
    'MEGABYTE',
    'VARIABLE',
    'ArgumentError',
    'InputError',
    'RobotError',
    'Rule',
    'choice',
    'count',
    'decimal',
    'list_of',
    'meant',
    'near_name',
    'near_names',
    'number',
    'open_file',
    'printable',
    'read_file',
    'read_yaml',
    'shown',
    'write_file',
    'yaml_line',
    'yaml_value',
]


def read_yaml(path: Path, *, largest: int = MEGABYTE, several: bool = False) -> Any:
    """Return the data of a YAML file. See `yaml_file.read_yaml`.

    PyYAML is imported by the first call, because many importers of this package read no YAML.
    """
    from epson_driver.inputs import yaml_file

    return yaml_file.read_yaml(path, largest=largest, several=several)


def yaml_value(text: str, where: str) -> Any:
    from epson_driver.inputs import yaml_file

    return yaml_file.yaml_value(text, where)


def yaml_line(path: Path, keys: Sequence[str]) -> int | None:
    from epson_driver.inputs import yaml_file

    return yaml_file.yaml_line(path, keys)
