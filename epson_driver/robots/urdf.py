# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A model's URDF and SRDF, which xacro makes of its data and of the files in urdf/."""

import contextlib
import hashlib
import json
import os
import threading
from collections.abc import Callable, Iterable
from pathlib import Path

from epson_driver.inputs import MEGABYTE, read_file, write_file
from epson_driver.robots.catalogue import layers, model_name
from epson_driver.share import share_folder


def cached(made_of: Iterable[bytes], make: Callable[[], str]) -> str:
    """Return what `make` makes of these bytes, from the cache if it is there.

    A folder that cannot be read or written, or a file that is damaged, costs time and nothing
    else. Other processes see a file as a whole or not at all.
    """
    key = hashlib.sha256()
    for part in made_of:
        key.update(hashlib.sha256(part).digest())
    path = _folder() / key.hexdigest()
    with contextlib.suppress(ValueError):
        digest, _, text = read_file(path, 10 * MEGABYTE).decode().partition('\n')
        if digest == _digest(text):
            return text
    text = make()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, f'{_digest(text)}\n{text}')
    return text


def _folder() -> Path:
    chosen = Path(os.environ.get('XDG_CACHE_HOME', ''))  # a relative one counts as none
    try:
        home = chosen if chosen.is_absolute() else Path.home() / '.cache'
    except RuntimeError:  # a user without a home
        home = Path(os.devnull)  # nothing can be made in it
    return home / 'epson_driver'


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode('utf-8')).hexdigest()


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
    files = {layer.path: read_file(layer.path, MEGABYTE) for layer in layers(named)}
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
