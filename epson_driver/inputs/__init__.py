# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of user input: files, parameters and arguments.

Input that breaks a rule is refused with one sentence that names its place, the value and the rule
(InputError). No other exception is raised, whatever the bytes are.
"""

from epson_driver.inputs.files import read_file
from epson_driver.inputs.rules import (
    FRAME_NAME,
    HOST,
    JOINT_NAMES,
    InputError,
    Rule,
    choice,
    count,
    list_of,
    near_name,
    number,
    printable,
    shown,
)
from epson_driver.inputs.yaml_file import read_yaml, yaml_line

__all__ = [
    'FRAME_NAME',
    'HOST',
    'JOINT_NAMES',
    'InputError',
    'Rule',
    'choice',
    'count',
    'list_of',
    'near_name',
    'number',
    'printable',
    'read_file',
    'read_yaml',
    'shown',
    'yaml_line',
]
