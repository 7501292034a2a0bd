# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The browser panel: the robots in 3D, what they report, and buttons for the driver's services.

It uses the driver as any other program does: topics, services and the action. Its page is served
by viser (`[panel]` extra), behind rules of its own about who is let in (`access.py`).
"""

from importlib.util import find_spec

INSTALL = (
    "the panel needs viser: pip install 'epson_driver[panel]' (in the source tree: "
    'make demo ARGS=--panel)'
)


def missing() -> bool:
    """Return whether the extra is not installed."""
    return find_spec('viser') is None
