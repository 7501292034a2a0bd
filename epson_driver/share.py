# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Paths of this package's data files, in the source tree or in the installed share folder."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_SOURCE_TREE = _PACKAGE.parent


def share_path(*parts: str) -> Path:
    """Return the path of a data file or folder.

    Example: `share_path('config', 'robots')`.
    """
    if (_SOURCE_TREE / 'package.xml').is_file():
        root = _SOURCE_TREE
    else:  # <prefix>/lib/python3.x/site-packages/epson_driver, both for pip and colcon
        root = _PACKAGE.parents[3] / 'share' / 'epson_driver'
    return root.joinpath(*parts)
