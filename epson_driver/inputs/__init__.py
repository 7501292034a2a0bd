# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What people hand to the package: files, parameters, arguments.

It keeps to its rule, or it is refused with one sentence that names where it stands, the value and
the rule. No other exception leaves here, whatever the bytes are.
"""

from epson_driver.inputs.files import read_file
from epson_driver.inputs.rules import (
    HOST,
    JOINT_NAMES,
    InputError,
    Rule,
    choice,
    count,
    list_of,
    number,
    printable,
    shown,
)
from epson_driver.inputs.yaml_file import read_yaml

__all__ = [
    'HOST',
    'JOINT_NAMES',
    'InputError',
    'Rule',
    'choice',
    'count',
    'list_of',
    'number',
    'printable',
    'read_file',
    'read_yaml',
    'shown',
]
