# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The browser panel: a 3D view of the robots, their state and buttons for the driver's services.

It uses only the driver's public topics, services and action. Its page is plain HTML and JavaScript
(`assets/`), which draws the parts received over a websocket (`window.py`). Access rules:
`access.py`.
"""

from importlib.util import find_spec

INSTALL = (
    "the panel needs websockets: pip install 'epson_driver[panel]' (in the source tree: "
    'make demo ARGS=--panel)'
)


def missing() -> bool:
    """Return whether the extra is not installed."""
    return find_spec('websockets') is None
