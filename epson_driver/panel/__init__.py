# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The browser panel: a 3D view of the robots, their state, and buttons that operate them.

`robot_state.py` has the interface of a robot. `ros_panel.py` implements it with the topics,
services and action of a driver, and `api_robot.py` with the driver of a Python Robot. The page is
plain HTML and JavaScript (`assets/`). It draws the parts of the state that it receives over a
websocket (`window.py`). `access.py` has the access rules.
"""

from importlib.util import find_spec

INSTALL = (
    "the panel needs websockets: pip install 'epson_driver[panel]' (in the source tree: "
    'make demo ARGS=--panel)'
)


def missing() -> bool:
    return find_spec('websockets') is None
