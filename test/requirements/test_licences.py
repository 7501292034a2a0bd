# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/licences.md: what the installed packages say of themselves."""

import importlib.util
import re
from email.message import Message
from importlib.metadata import Distribution
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import cast

import pytest

ROOT = Path(__file__).parents[2]


def loaded() -> ModuleType:
    """Return the program that writes the page."""
    path = ROOT / 'requirements' / 'make_licences.py'
    spec = importlib.util.spec_from_file_location('make_licences', path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


make_licences = loaded()
TEXT = make_licences.PAGE.read_text(encoding='utf-8')


def test_the_page_lists_every_pinned_package_in_its_version() -> None:
    listed = make_licences.listed(TEXT)
    assert {name: version for name, (version, _) in listed.items()} == {
        name: version for name, (_, version) in make_licences.pinned().items()
    }, 'run `make licences`'


def test_the_page_says_what_the_installed_packages_say() -> None:
    listed, installed = make_licences.listed(TEXT), make_licences.installed()
    assert len(installed) > 80  # the driver's own
    assert {name: listed[name] for name in installed} == installed, 'run `make licences`'
    assert make_licences.page(listed) == TEXT


def test_what_the_driver_runs_on_is_marked_and_has_a_licence() -> None:
    marked = dict(re.findall(r'(?m)^\| (\S+) \| \S+ \| (.+?) \| \*\*run\*\* \|$', TEXT))
    assert {'numpy', 'ros-jazzy-rclpy', 'ruckig', 'rich'} <= set(marked)
    assert make_licences.NOT_STATED not in marked.values()


@pytest.mark.parametrize(
    ('fields', 'expected'),
    [
        ({'License-Expression': 'BSD-3-Clause', 'License': 'something'}, 'BSD-3-Clause'),
        ({'Classifier': 'License :: OSI Approved :: MIT License'}, 'MIT'),
        ({'License': 'Apache 2.0'}, 'Apache-2.0'),
        ({'License': 'line\n  line'}, 'not stated'),
        ({'License': 'UNKNOWN'}, 'not stated'),
        ({}, 'not stated'),
    ],
)
def test_where_a_licence_is_found(fields: dict[str, str], expected: str) -> None:
    about = Message()
    for name, value in fields.items():
        about[name] = value
    package = cast(Distribution, SimpleNamespace(metadata=about, files=()))
    assert make_licences.licence(package) == expected


def test_packages_of_ros_have_it_in_their_manifest(tmp_path: Path) -> None:
    manifest = tmp_path / 'package.xml'
    manifest.write_text('<package><license>Apache-2.0</license></package>', encoding='utf-8')
    package = SimpleNamespace(metadata=Message(), files=[manifest], locate_file=lambda file: file)
    assert make_licences.licence(cast(Distribution, package)) == 'Apache-2.0'
