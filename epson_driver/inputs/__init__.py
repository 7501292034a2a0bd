# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of user input: files, parameters and arguments.

Input that breaks a rule is refused with one sentence that names its place, the value and the rule
(InputError). No other exception is raised, whatever the bytes are.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from epson_driver.inputs.files import MEGABYTE, open_file, read_file, write_file
from epson_driver.inputs.rules import (
    FRAME_NAME,
    HOST,
    JOINT_NAMES,
    InputError,
    Rule,
    choice,
    count,
    decimal,
    list_of,
    near_name,
    number,
    printable,
    shown,
)

__all__ = [
    'FRAME_NAME',
    'HOST',
    'JOINT_NAMES',
    'MEGABYTE',
    'InputError',
    'Rule',
    'choice',
    'count',
    'decimal',
    'list_of',
    'near_name',
    'number',
    'open_file',
    'printable',
    'read_file',
    'read_yaml',
    'shown',
    'write_file',
    'yaml_line',
]


def read_yaml(path: Path, *, largest: int = MEGABYTE, several: bool = False) -> Any:
    """Return the data of a YAML file, as `yaml_file.read_yaml` does.

    PyYAML is loaded by the first file: many who import this package read none.
    """
    from epson_driver.inputs import yaml_file

    return yaml_file.read_yaml(path, largest=largest, several=several)


def yaml_line(path: Path, keys: Sequence[str]) -> int | None:
    """Return the line of a key, as `yaml_file.yaml_line` does."""
    from epson_driver.inputs import yaml_file

    return yaml_file.yaml_line(path, keys)
