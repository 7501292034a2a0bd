# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A model's URDF and SRDF, which xacro makes of its data and of the files in urdf/."""

import json
import threading
from pathlib import Path

from epson_driver.robots.cache import cached
from epson_driver.robots.catalogue import layers, model_name
from epson_driver.share import share_folder

_ONE_AT_A_TIME = threading.Lock()
"""xacro keeps what it works on in global variables."""


def urdf(robot_model: str, **arguments: str) -> str:
    """Return the URDF of a model, named as `load_robot_model` takes it.

    `arguments`: those of urdf/epson_robot.urdf.xacro. Raises ImportError if xacro is not
    installed, FileNotFoundError or InputError for a model that is not there.
    """
    return _described('epson_robot.urdf.xacro', robot_model, arguments)


def srdf(robot_model: str, **arguments: str) -> str:
    """Return MoveIt's semantic description of a model, as `urdf` does the other one.

    `arguments`: those of urdf/epson_robot.srdf.xacro. The group's name is `manipulator`.
    """
    return _described('epson_robot.srdf.xacro', robot_model, arguments)


def _described(xacro_file: str, robot_model: str, arguments: dict[str, str]) -> str:
    named = model_name(robot_model)
    files = {layer.path: layer.path.read_bytes() for layer in layers(named)}
    if named.endswith('.yaml'):
        named = str(Path(named).absolute())
    mappings = {**arguments, 'robot_model': named}
    sources = [path.read_bytes() for path in sorted(share_folder('urdf').glob('*.xacro'))]
    words = json.dumps([xacro_file, mappings], sort_keys=True).encode()
    return cached(
        [words, *files.values(), *sources],
        lambda: _made(str(share_folder('urdf') / xacro_file), mappings),
    )


def _made(path: str, mappings: dict[str, str]) -> str:
    import xacro

    with _ONE_AT_A_TIME:
        root = xacro.process_file(path, mappings=mappings).documentElement
        return str(root.toprettyxml(indent='  '))
