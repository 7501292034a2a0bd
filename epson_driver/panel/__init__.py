# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The browser panel: a 3D view of the robots, their state, and buttons that operate them.

The panel uses only the driver's public topics, services and action. Its page is plain HTML and
JavaScript (`assets/`). The page draws the parts of the state that it receives over a websocket
(`window.py`). `access.py` has the access rules.
"""

from importlib.util import find_spec

INSTALL = (
    "the panel needs websockets: pip install 'epson_driver[panel]' (in the source tree: "
    'make demo ARGS=--panel)'
)


def missing() -> bool:
    """Return whether the libraries of the panel are missing."""
    return find_spec('websockets') is None
