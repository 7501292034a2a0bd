# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Only inputs/files.py reads and writes files. Other modules are listed with their reason."""

import re
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / 'epson_driver'

CALL = re.compile(
    r"""\.open\(['"][rwaxbt+]|\bos\.open\(|\bfdopen\(|TemporaryFile\(|\bmkstemp\(|\bmmap\("""
    r'|\.(read|write)_(text|bytes)\(|\b(np|json|yaml|pickle|tomllib)\.(load|save)z?\('
    r'|\b(loadtxt|genfromtxt|savetxt|savefig|imread|tofile|process_file|ElementTree\.parse)\('
    r'|\b(AnyReader|Writer|ZipFile|TarFile|FileIO|FileHandler)\(|\bshutil\.(copy|move)\w*\('
)
"""Calls that open files. Ruff forbids the function `open`."""

ALLOWED = {
    'inputs/files': 'the reader and the writer',
    'api/ownership cli/robots processes/command sim_controller/network/port_server': 'null device',
    'cli/__main__ pages/__init__ panel/web_server report/page': 'own data, in the package',
    'cli/fleet doctor/environment': 'files of /proc and systemd',
    'exercise/runner processes/processes': 'logs and parameters of children, in a new folder',
    'node/ros_process processes/worker': 'a new temporary file, and a pipe',
    'report/bag_file report/bag_run robots/urdf': 'libraries, in a new folder or after the reader',
    'report/smooth_study': 'into memory',
    'trace/trace': 'a new file that grows while it is read, with O_EXCL',
}


def test_only_listed_modules_open_files() -> None:
    modules = {
        path.relative_to(PACKAGE).with_suffix('').as_posix()
        for path in PACKAGE.rglob('*.py')
        if CALL.search(path.read_text('utf-8'))
    }
    advice = 'use read_file, open_file or write_file of inputs, or add a reason to ALLOWED'
    assert modules == set(' '.join(ALLOWED).split()), advice
