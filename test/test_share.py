# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Data files are found in the source tree and in an installed prefix."""

import importlib.util
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from epson_driver import share
from epson_driver.share import share_path

ROOT = Path(__file__).resolve().parents[1]


def test_file_of_the_source_tree_is_found() -> None:
    path = share_path('config', 'robots', 'c3.yaml')
    assert path.is_absolute()
    assert path.read_bytes() == (ROOT / 'config' / 'robots' / 'c3.yaml').read_bytes()


@pytest.fixture
def installed(tmp_path: Path) -> Callable[..., Path]:
    """Install share.py and a data file like pip and colcon. Return the installed function."""
    package = tmp_path / 'lib' / 'python3.12' / 'site-packages' / 'epson_driver'
    package.mkdir(parents=True)
    shutil.copy(share.__file__, package)
    data = tmp_path / 'share' / 'epson_driver' / 'config' / 'robots'
    data.mkdir(parents=True)
    (data / 'mine.yaml').touch()
    spec = importlib.util.spec_from_file_location('installed_share', package / 'share.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    result: Callable[..., Path] = module.share_path
    return result


def test_file_of_an_installed_prefix_is_found(
    installed: Callable[..., Path], tmp_path: Path
) -> None:
    expected = tmp_path / 'share' / 'epson_driver' / 'config' / 'robots' / 'mine.yaml'
    assert installed('config', 'robots', 'mine.yaml') == expected.resolve()
