# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes hashes.txt: what every file that may be installed must be, by its SHA-256.

Run it after a change to constraints.txt (`make hashes`). For each package and version there it
asks the index that pip is set up for, by pip itself, and keeps the files for the Pythons and
systems that are supported, and sources. Nothing is downloaded but the index's pages. Tests compare
names and versions; `make` installs nothing that is not listed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pip._internal.commands import create_command
from pip._internal.index.collector import LinkCollector, parse_links
from pip._internal.models.link import Link
from pip._vendor.packaging.tags import Tag
from pip._vendor.packaging.utils import (
    InvalidSdistFilename,
    InvalidWheelFilename,
    parse_sdist_filename,
    parse_wheel_filename,
)
from pip._vendor.packaging.version import Version

FOLDER = Path(__file__).parent
CONSTRAINTS, HASHES = FOLDER / 'constraints.txt', FOLDER / 'hashes.txt'
MINORS = range(11, 15)
"""Of Python 3."""

HEAD = """\
# The SHA-256 of every file that may be installed: Python 3.11 to 3.14; Linux on x86-64 and arm64,
# macOS on arm64. For pip's -c, beside constraints.txt: with it, pip installs nothing else.
# Written by `make hashes`.
"""


def pinned() -> Iterator[tuple[str, str]]:
    """Yield name and version of each package in the constraints."""
    text = CONSTRAINTS.read_text(encoding='utf-8')
    yield from re.findall(r'(?m)^([\w.-]+)==(\S+)', text)


def wanted(filename: str, version: str) -> bool:
    """Return whether a file is of this version, and for a Python and system that we support."""
    try:
        if filename.endswith('.whl'):
            _, found, _, tags = parse_wheel_filename(filename)
            return found == Version(version) and any(map(_fits, tags))
        return parse_sdist_filename(filename)[1] == Version(version)
    except (InvalidWheelFilename, InvalidSdistFilename):
        return False


def _fits(tag: Tag) -> bool:
    return _fits_python(tag.interpreter, tag.abi) and _fits_system(tag.platform)


def _fits_python(interpreter: str, abi: str) -> bool:
    if interpreter == 'py3':
        return abi == 'none'
    match = re.fullmatch(r'(?:cp|py)3(\d+)', interpreter)
    if match is None:
        return False
    minor = int(match[1])
    if abi in ('abi3', 'none'):
        return minor <= MINORS[-1]
    return abi == interpreter and minor in MINORS


def _fits_system(platform: str) -> bool:
    if platform.startswith('macosx'):
        return platform.endswith(('_arm64', '_universal2'))
    linux = r'(manylinux|linux)\w*_(x86_64|aarch64)'
    return platform == 'any' or re.fullmatch(linux, platform) is not None


def hashes(name: str, version: str, collector: LinkCollector) -> list[str]:
    """Return the SHA-256 of each file of a package that is wanted, sorted, from all indexes."""
    found: set[str] = set()
    for location in collector.search_scope.get_index_urls_locations(name):
        page = collector.fetch_response(Link(location), package_name=name)
        for link in parse_links(page) if page is not None else ():
            if link.hash_name == 'sha256' and link.hash and wanted(link.filename, version):
                found.add(link.hash)
    return sorted(found)


def block(name: str, version: str, found: list[str]) -> str:
    """Return a package's lines in the file."""
    return ' \\\n    '.join([f'{name}=={version}', *(f'--hash=sha256:{each}' for each in found)])


def main() -> int:
    """Write the file; return 1, and leave it as it is, if a package has no hash."""
    command: Any = create_command('index')
    options, _ = command.parse_args(['versions'])
    blocks, lacking = [], []
    with command.main_context():
        collector = LinkCollector.create(command.get_default_session(options), options=options)
        for name, version in pinned():
            found = hashes(name, version, collector)
            if not found:
                lacking.append(f'{name}=={version}')
            blocks.append(block(name, version, found))
    if lacking:
        print(f'the index has no hash for {", ".join(lacking)}', file=sys.stderr)
        return 1
    HASHES.write_text(HEAD + '\n'.join(blocks) + '\n', encoding='utf-8')
    print(f'{HASHES}: {len(blocks)} packages')
    return 0


if __name__ == '__main__':
    sys.exit(main())
