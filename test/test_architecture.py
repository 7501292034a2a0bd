# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Modules loaded by importing the package. `make lint` checks the allowed imports."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = 'epson_driver'


def loaded(code: str) -> list[str]:
    """Return the words that `code` prints in a new Python process."""
    run = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return run.stdout.split()


@pytest.mark.parametrize(
    ('package', 'libraries'),
    [
        ('simple_message', []),
        ('motion', ['numpy', 'ruckig']),
        ('robots', ['numpy', 'ruckig']),
        ('profiles', []),
    ],
)
def test_base_package_loads_only_its_libraries(package: str, libraries: list[str]) -> None:
    code = (
        'import sys; before = set(sys.modules)\n'
        f'import {PACKAGE}.{package}\n'
        'tops = {name.split(".")[0] for name in set(sys.modules) - before}\n'
        f'print(*sorted(tops - sys.stdlib_module_names - {{"{PACKAGE}"}}))'
    )
    assert [x for x in loaded(code) if not x.startswith(('_', 'cython'))] == libraries


def test_package_imports_lazily() -> None:
    code = (
        'import sys, epson_driver\n'
        f'print(*sorted(name for name in sys.modules if name.startswith("{PACKAGE}.")))\n'
        'print("numpy" in sys.modules, epson_driver.Robot.__module__, "rclpy" in sys.modules)'
    )
    assert loaded(code) == ['False', f'{PACKAGE}.robot', 'False']


def test_python_api_loads_the_driver_with_the_first_robot() -> None:
    rooms = ('driver.driver', 'link', 'motion.smoother', 'profiles', 'simple_message', 'trace')
    late = {'rclpy', 'rich', 'yaml', *(f'{PACKAGE}.{room}' for room in rooms)}
    code = (
        'import sys\n'
        f'from {PACKAGE} import Robot\n'
        f'print(*{late} & set(sys.modules))\n'
        'Robot()\n'
        f'print("{PACKAGE}.driver.driver" in sys.modules)'
    )
    assert loaded(code) == ['True']
