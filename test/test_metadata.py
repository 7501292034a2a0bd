# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Package manifests have the fields that release tools require, and name what is launched."""

import ast
import importlib
import runpy
import sys
from pathlib import Path

import pytest
import setuptools
import yaml
from catkin_pkg.package import parse_package

ROOT = Path(__file__).parents[1]
MANIFESTS = [ROOT / 'package.xml', *sorted(ROOT.glob('interfaces/*/package.xml'))]
MANIFESTS += sorted(ROOT.glob('variants/*/package.xml'))
COPIES = ('control_msgs', 'industrial_msgs', 'tf2_msgs')
"""Copied packages, with the versions of the originals."""


@pytest.fixture(scope='module')
def setup_arguments():
    """The arguments of setup.py for setuptools."""
    given = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setuptools, 'setup', lambda **keywords: given.update(keywords))
        patch.setattr(sys, 'argv', ['setup.py', 'bdist_wheel'])
        patch.chdir(ROOT)
        runpy.run_path(str(ROOT / 'setup.py'))
    return given


@pytest.mark.parametrize('path', MANIFESTS, ids=lambda path: path.parent.name)
def test_manifest_is_valid_for_release_tools(path):
    warnings = []
    package = parse_package(str(path), warnings=warnings)
    assert warnings == []
    package.validate()
    assert package.authors
    assert package.licenses == ['Apache-2.0']


def test_packages_have_one_version_and_maintainer(setup_arguments):
    ours = [parse_package(str(path)) for path in MANIFESTS if path.parent.name not in COPIES]
    assert {package.version for package in ours} == {setup_arguments['version']}
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert citation['version'] == setup_arguments['version']
    emails = {person.email for package in ours for person in package.maintainers}
    assert emails == {setup_arguments['maintainer_email']}


def test_data_files_of_setup_exist(setup_arguments):
    files = [file for _, files in setup_arguments['data_files'] for file in files]
    assert 'scripts/client' in files
    assert [file for file in files if not (ROOT / file).is_file()] == []


@pytest.mark.parametrize('path', sorted(ROOT.glob('launch/*.py')), ids=lambda path: path.name)
def test_packages_executables_and_imports_of_a_launch_file_exist(path):
    depends = {
        depend.name for file in MANIFESTS for depend in parse_package(str(file)).exec_depends
    }
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('epson_driver'):
            module = importlib.import_module(node.module)
            assert [item.name for item in node.names if not hasattr(module, item.name)] == []
        if isinstance(node, ast.Call):
            words = {item.arg: getattr(item.value, 'value', '') for item in node.keywords}
            if words.get('package') == 'epson_driver':
                assert (ROOT / 'scripts' / words['executable']).is_symlink()
            elif 'package' in words:
                assert words['package'] in depends
