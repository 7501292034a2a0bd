# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes docs/licences.md: the licence of every Python package in constraints.txt.

Run it after a change there (`make licences`; what is not installed is installed into a folder that
goes again). A licence is what the installed package says of itself: License-Expression, else the
classifiers, else License, else the package.xml of a package of ROS, else its licence file;
ros-jazzy-NAME is empty, and brings ros-NAME. Tests compare the page with what is installed.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageMetadata, distributions
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS, HASHES = (ROOT / 'requirements' / f'{name}.txt' for name in ('constraints', 'hashes'))
PAGE = ROOT / 'docs' / 'licences.md'
NOT_STATED = 'not stated'
MAX_LENGTH = 60
"""Of a License field that is a name; longer ones are a whole licence."""

HEAD = """\
# Licences of what is installed

epson_driver is under the Apache License 2.0. These are the licences of the Python packages that
`make` installs, in the versions of `requirements/constraints.txt`, as each package states them.
The driver asks for those marked **run**, which bring some of the others; the rest is for tests,
docs and benchmarks. Written by `make licences`; a test compares it with what is installed.

"""

NO_NAMES = ('', 'UNKNOWN', 'LICENSE', 'any-OSI')
"""What stands in a License field that nobody filled in."""

NO_LICENCES = ('OSI Approved', 'DFSG approved', 'Other/Proprietary License')
"""Classifiers that name none."""

SENTENCES = {
    'Apache License': 'Apache-2.0',
    'Mozilla Public License Version 2.0': 'MPL-2.0',
    'GNU LESSER GENERAL PUBLIC LICENSE': 'LGPL',
    'GNU GENERAL PUBLIC LICENSE': 'GPL',
    'Permission is hereby granted, free of charge': 'MIT',
    'Neither the name': 'BSD-3-Clause',
    'Redistribution and use in source and binary forms': 'BSD-2-Clause',
}
"""By what a licence file is known, the first that is found in it."""

WORDS = {
    'MIT License': 'MIT',
    'The MIT License (MIT)': 'MIT',
    'Apache License 2.0': 'Apache-2.0',
    'Apache 2.0': 'Apache-2.0',
    'Apache Software License': 'Apache-2.0',
    'Apache License, Version 2.0': 'Apache-2.0',
    'BSD': 'BSD',
    'BSD License': 'BSD',
    '3-Clause BSD License': 'BSD-3-Clause',
    'BSD 3-Clause License': 'BSD-3-Clause',
    'Mozilla Public License 2.0 (MPL 2.0)': 'MPL-2.0',
    'ISC License (ISCL)': 'ISC',
    'Python Software Foundation License': 'PSF-2.0',
    'zlib License': 'Zlib',
}
"""Other names for the same licence."""


def canonical(name: str) -> str:
    """Return the name by which a package is the same in every spelling."""
    return re.sub(r'[-_.]+', '-', name).lower()


def pinned() -> dict[str, tuple[str, str]]:
    """Return name and version of each package in the constraints, by its canonical name."""
    text = CONSTRAINTS.read_text(encoding='utf-8')
    found = re.findall(r'(?m)^([\w.-]+)==(\S+)', text)
    return {canonical(name): (name, version) for name, version in found}


def licence(package: Distribution) -> str:
    """Return what an installed package says that its licence is."""
    stated = (
        list(_stated(package.metadata))
        or sorted(_of_manifests(package))
        or sorted(_of_licence_files(package))
    )
    names = [WORDS.get(name, name) for name in stated]
    return ', '.join(dict.fromkeys(names)) or NOT_STATED


def _stated(about: PackageMetadata) -> Iterator[str]:
    if 'License-Expression' in about:
        yield about['License-Expression']
        return
    classifiers = about.get_all('Classifier') or []
    found = [each.split(' :: ')[-1] for each in classifiers if each.startswith('License :: ')]
    found = [
        each
        for each in found
        if each not in ('OSI Approved', 'DFSG approved', 'Other/Proprietary License')
    ]
    if found:
        yield from found
        return
    field = about['License'].strip().strip('"%') if 'License' in about else ''
    if field not in NO_NAMES and len(field) <= MAX_LENGTH and field.isprintable():
        yield field


def _of_manifests(package: Distribution) -> set[str]:
    """Return the licences in the package.xml files that came with a package."""
    found = set()
    for file in package.files or ():
        path = Path(str(package.locate_file(file)))
        if path.name == 'package.xml' and path.is_file():
            root = ElementTree.parse(path).getroot()  # noqa: S314 - of an installed package
            found |= {str(each.text).strip() for each in root.findall('license') if each.text}
    return found


def _of_licence_files(package: Distribution) -> set[str]:
    """Return the licences whose texts came with a package."""
    found = set()
    for file in package.files or ():
        path = Path(str(package.locate_file(file)))
        if re.match(r'(?i)(licen[cs]e|copying)', path.name) and path.is_file():
            text = ' '.join(path.read_text(encoding='utf-8', errors='replace').split())
            names = [name for words, name in SENTENCES.items() if words in text]
            found |= set(names[:1])
    return found


def installed(folder: str | None = None) -> dict[str, tuple[str, str]]:
    """Return version and licence of each pinned package that is here, by its canonical name."""
    wanted = pinned()
    found = {}
    for package in distributions() if folder is None else distributions(path=[folder]):
        name = canonical(package.metadata['Name'])
        if name in wanted and package.version == wanted[name][1]:
            found[name] = (package.version, licence(package))
    for name, (version, words) in found.items():
        brought = found.get(name.replace('ros-jazzy-', 'ros-'))
        if words == NOT_STATED and brought is not None:
            found[name] = (version, brought[1])
    return found


def listed(text: str) -> dict[str, tuple[str, str]]:
    """Return version and licence of each package that a page lists, by its canonical name."""
    rows = re.findall(r'(?m)^\| ([\w.-]+) \| (\d\S*) \| (.+?) \| .*\|$', text)
    return {canonical(name): (version, words) for name, version, words in rows}


def run_names() -> set[str]:
    """Return the packages that the driver itself asks for, by their canonical names."""
    text = (ROOT / 'requirements' / 'runtime.txt').read_text(encoding='utf-8')
    return {canonical(name) for name in re.findall(r'(?m)^([A-Za-z][\w.-]*)', text)}


def page(known: dict[str, tuple[str, str]]) -> str:
    """Return the page for these packages."""
    rows = []
    for name, (shown, version) in sorted(pinned().items()):
        words = known[name][1] if known.get(name, ('',))[0] == version else NOT_STATED
        mark = '**run**' if name in run_names() else ''
        rows.append(f'| {shown} | {version} | {words.replace("|", "/")} | {mark} |\n')
    return f'{HEAD}| package | version | licence | |\n|---|---|---|---|\n{"".join(rows)}'


def main() -> int:
    """Write the page; what is not installed here stays as it is listed, in the same version."""
    before = listed(PAGE.read_text(encoding='utf-8')) if PAGE.is_file() else {}
    known = before | installed()
    unknown = [f'{n}=={v}' for k, (n, v) in pinned().items() if known.get(k, ('',))[0] != v]
    if unknown:
        with tempfile.TemporaryDirectory() as folder:
            words = ['install', '--quiet', '--no-deps', '--target', folder, '-c', str(HASHES)]
            subprocess.run([sys.executable, '-m', 'pip', *words, *unknown], check=True)  # noqa: S603
            known |= installed(folder)
    PAGE.write_text(page(known), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
