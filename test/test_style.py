# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The linters find nothing: what they must not find is set in pyproject.toml."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize(
    'command',
    ['ruff check .', 'ruff format --check .', pytest.param('mypy', marks=pytest.mark.slow)],
)
def test_the_linters_find_nothing(command: str) -> None:
    run = subprocess.run(
        [sys.executable, '-m', *command.split()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
