# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Paths of this package's data files, in the source tree or in the installed share folder."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_SOURCE_TREE = _PACKAGE.parent


def share_folder(*parts: str) -> Path:
    """Return the path of a folder of data files, such as `share_folder('config', 'robots')`."""
    if (_SOURCE_TREE / 'package.xml').is_file():
        root = _SOURCE_TREE
    else:  # <prefix>/lib/python3.x/site-packages/epson_driver, both for pip and colcon
        root = _PACKAGE.parents[3] / 'share' / 'epson_driver'
    return root.joinpath(*parts)


def share_file(*parts: str) -> Path:
    """Return the path of a data file, such as `share_file('config', 'robots', 'c3.yaml')`.

    Raises FileNotFoundError, which lists the available files, if there is no such file.
    """
    folder, name = share_folder(*parts[:-1]), parts[-1]
    suffix = Path(name).suffix
    there = {path.name: path for path in _files(folder) if path.suffix == suffix or not suffix}
    if name not in there:  # a name may be anything: too long, or with a slash or a NUL
        names = ', '.join(sorted(path.stem for path in there.values())) or 'nothing'
        raise FileNotFoundError(f'no {_one_line(name)} in {folder} (available: {names})')
    return there[name]


def _files(folder: Path) -> list[Path]:
    try:
        return [path for path in folder.iterdir() if path.is_file()]
    except (OSError, ValueError):
        return []


def _one_line(name: str) -> str:
    shown = name if name.isprintable() else repr(name)
    return shown if len(shown) <= 100 else f'{shown[:80]}…'
