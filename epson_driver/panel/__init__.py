# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The browser panel: the robots in 3D, what they report, and buttons for the driver's services.

It uses the driver as any other program does: topics, services and the action. Its page is plain
HTML and JavaScript (`assets/`), which draws the parts that come over a websocket (`window.py`),
behind rules about who is let in (`access.py`).
"""

from importlib.util import find_spec

INSTALL = (
    "the panel needs websockets: pip install 'epson_driver[panel]' (in the source tree: "
    'make demo ARGS=--panel)'
)


def missing() -> bool:
    """Return whether the extra is not installed."""
    return find_spec('websockets') is None
