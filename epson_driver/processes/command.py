# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The command that starts a module of this package as a process, and the file that it runs.

With -P, Python imports nothing from the current folder, so a `random.py` there is not executed.
The package is imported from the location of this file. The environment is unchanged, so modules in
PYTHONPATH are found, as a sourced workspace needs.
"""

import sys
from pathlib import Path
from runpy import run_module

_FILE = Path(__file__).absolute()


def safe_python() -> list[str]:
    """Return the command of this Python without the current folder in sys.path."""
    return [sys.executable, '-P']


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of this package, like `python -m`."""
    return [*safe_python(), str(_FILE), module, *arguments]


def _run() -> None:
    root = str(_FILE.parents[2])
    if root not in sys.path:  # neither installed nor in PYTHONPATH
        sys.path.insert(0, root)
    module = sys.argv.pop(1)
    run_module(module, run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    _run()
