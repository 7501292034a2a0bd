# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's robot language SPEL+: compiles files to a program, and runs its tasks.

The interpreter is independent of the controller and accesses it through the interface `Host`.
docs/spel.md lists the supported parts of the language.
"""

from epson_driver.spel.code import Program
from epson_driver.spel.commands import TaskType
from epson_driver.spel.errors import (
    ErrorNumber,
    Position,
    Problem,
    ProgramError,
    SpelError,
    TaskError,
)
from epson_driver.spel.files import ProgramEnvironment
from epson_driver.spel.host import (
    Caller,
    Completion,
    Host,
    Memory,
    MotionRequest,
    NetSettings,
    Terminal,
)
from epson_driver.spel.machine import Machine, TaskView
from epson_driver.spel.project import build, with_defines, with_setup
from epson_driver.spel.project_data import read_project
from epson_driver.spel.settings import Settings, read_settings
from epson_driver.spel.task import TaskState, Timing
from epson_driver.spel.values import Array, Point, Value

__all__ = [
    'Array',
    'Caller',
    'Completion',
    'ErrorNumber',
    'Host',
    'Machine',
    'Memory',
    'MotionRequest',
    'NetSettings',
    'Point',
    'Position',
    'Problem',
    'Program',
    'ProgramEnvironment',
    'ProgramError',
    'Settings',
    'SpelError',
    'TaskError',
    'TaskState',
    'TaskType',
    'TaskView',
    'Terminal',
    'Timing',
    'Value',
    'build',
    'read_project',
    'read_settings',
    'with_defines',
    'with_setup',
]
