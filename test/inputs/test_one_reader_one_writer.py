# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Only inputs/files.py reads and writes files. Every exception is listed here with its reason."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / 'epson_driver'

CALLS = {
    *('read_text', 'read_bytes', 'write_text', 'write_bytes', 'fdopen', 'mkstemp', 'touch'),
    *('NamedTemporaryFile', 'TemporaryFile', 'copyfile', 'copy', 'copy2', 'copytree', 'move'),
    *('rename', 'renames', 'link', 'symlink', 'symlink_to', 'hardlink_to', 'mmap', 'memmap'),
    *('loadtxt', 'genfromtxt', 'fromfile', 'tofile', 'savetxt', 'savefig', 'imread', 'connect'),
    *('ZipFile', 'TarFile', 'FileIO', 'FileHandler', 'AnyReader', 'Writer', 'process_file'),
}
"""Functions that open a file by its path, on any object."""

OF_MODULES = {
    'open': {'os', 'io', 'gzip', 'bz2', 'lzma', 'codecs', 'tarfile', 'shelve', 'dbm', 'wave'},
    'replace': {'os'},
    'load': {'json', 'yaml', 'np', 'numpy', 'pickle', 'tomllib', 'marshal'},
    'save': {'np', 'numpy'},
    'savez': {'np', 'numpy'},
    'parse': {'ElementTree', 'ET', 'minidom', 'etree'},
    'read': {'configparser'},
    'run_path': {'runpy'},
}
"""Functions that open a file if called on one of these modules."""

NOT_A_FILE = {'link', 'copy', 'connect', 'touch', 'move'}
"""Ambiguous names, which count only on these modules."""

MODULES = {'os', 'shutil', 'sqlite3', 'apsw'}

OWN, NULL = 'its own data, from the installed package', 'the null device'
CHILD = 'the log or the parameters of a child process, in a folder made for it'

ALLOWED = {
    'api/ownership.py: os.open': NULL,
    'cli/__main__.py: ElementTree.parse': OWN,
    'cli/__main__.py: os.open': NULL,
    'cli/fleet.py: read_text': 'files of /proc',
    'cli/robots.py: os.open': NULL,
    'doctor/environment.py: read_text': 'files of /proc and of systemd',
    'exercise/runner.py: open': CHILD,
    'exercise/runner.py: read_bytes': CHILD,
    'exercise/runner.py: read_text': CHILD,
    'inputs/files.py: fdopen': 'the writer',
    'inputs/files.py: open': 'the reader',
    'inputs/files.py: os.open': 'the reader, and the new file of the writer',
    'node/ros_process.py: NamedTemporaryFile': 'a new file in the temporary folder',
    'pages/__init__.py: read_text': OWN,
    'panel/web_server.py: read_bytes': OWN,
    'processes/processes.py: open': CHILD,
    'processes/processes.py: read_text': CHILD,
    'processes/processes.py: write_text': CHILD,
    'processes/command.py: fdopen': NULL,
    'processes/command.py: os.open': NULL,
    'processes/worker.py: fdopen': 'a pipe between two processes',
    'report/bag_file.py: Writer': 'a library, in a folder made for it, which is moved when whole',
    'report/bag_run.py: open': 'a copy in a folder made for it',
    'report/bag_run.py: AnyReader': 'a library, with limits to memory and to files',
    'report/bag_run.py: read_text': 'files of /proc',
    'report/page.py: read_text': OWN,
    'report/smooth_study.py: savefig': 'into memory',
    'robots/urdf.py: process_file': 'a library, after the reader has checked the same files',
    'robots/urdf.py: read_bytes': OWN,
    'sim_controller/network/port_server.py: os.open': NULL,
    'trace/trace.py: open': 'a new file that grows while it is read, with O_EXCL',
}


def raw(source: str) -> Iterator[str]:
    """Yield the calls that open files, in the notation of the allow-list."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        on = getattr(getattr(node.func, 'value', None), 'id', '')
        name = getattr(node.func, 'attr', getattr(node.func, 'id', ''))
        mode = [item.value for item in (*node.args, *(k.value for k in node.keywords))
                if isinstance(item, ast.Constant) and isinstance(item.value, str)]  # fmt: skip
        opens = name == 'open' and (
            isinstance(node.func, ast.Name) or any(set(item) <= set('rwaxbt+') for item in mode)
        )
        if on in OF_MODULES.get(name, ()):
            yield f'{on}.{name}'
        elif opens or (name in CALLS and (name not in NOT_A_FILE or on in MODULES)):
            yield name


def test_only_listed_calls_open_files() -> None:
    result = {
        f'{path.relative_to(PACKAGE)}: {call}'
        for path in PACKAGE.rglob('*.py')
        for call in raw(path.read_text('utf-8'))
    }
    advice = 'use read_file, open_file or write_file of inputs, or add a reason to ALLOWED'
    assert result == ALLOWED.keys(), advice
