# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A folder of modules that fail on import. Programs started there must not import from it."""

import sys
from pathlib import Path

INSTALLED = (
    'epson_driver',
    'matplotlib',
    'numpy',
    'rclpy',
    'rich',
    'ruckig',
    'websockets',
    'yaml',
)
TRAP = """
import os
with open(os.path.join(os.path.dirname(__file__), 'PWNED'), 'a') as file:
    print(__name__, file=file)
raise ImportError('the trap ' + __name__)
"""


def trap_folder(parent: Path) -> Path:
    """Return a new folder with a module for each standard module and dependency."""
    folder = parent / 'traps'
    folder.mkdir()
    for name in {*sys.stdlib_module_names, *INSTALLED, 'sitecustomize', 'usercustomize'}:
        (folder / f'{name}.py').write_text(TRAP, encoding='utf-8')
    return folder


def sprung(folder: Path) -> str:
    """Return the executed modules, one per line."""
    record = folder / 'PWNED'
    return record.read_text(encoding='utf-8') if record.exists() else ''
