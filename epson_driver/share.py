# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where this package's data files are: in the source tree, or installed beside the code."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_SOURCE_TREE = _PACKAGE.parent


def share_folder(*parts: str) -> Path:
    """Return the path of a folder of data files, as in `share_folder('config', 'robots')`."""
    if (_SOURCE_TREE / 'package.xml').is_file():
        root = _SOURCE_TREE
    else:  # <prefix>/lib/python3.x/site-packages/epson_driver, for pip as for colcon
        root = _PACKAGE.parents[3] / 'share' / 'epson_driver'
    return root.joinpath(*parts)


def share_file(*parts: str) -> Path:
    """Return the path of a data file, as in `share_file('config', 'robots', 'c3_a601s.yaml')`.

    Raises FileNotFoundError that says where it was looked for and what is there instead.
    """
    path = share_folder(*parts[:-1]) / parts[-1]
    if not path.is_file():
        there = ', '.join(sorted(p.stem for p in path.parent.glob(f'*{path.suffix}'))) or 'nothing'
        raise FileNotFoundError(f'no {path.name} in {path.parent} (there is: {there})')
    return path
