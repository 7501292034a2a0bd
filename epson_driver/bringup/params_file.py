# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client's parameters in a params_file, which description and simulation need, too."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from epson_driver.bringup.description import BringupError
from epson_driver.inputs import read_yaml

NODE_NAME = 'epson_driver'
"""The client's name in the launch files."""

PARAMETERS = 'ros__parameters'


def file_parameters(path: str, namespace: str) -> dict[str, Any]:
    """Return the parameters in a file for the client in a namespace.

    Later sections take precedence. Raises BringupError if the file does not exist or has no
    section for the client, InputError if it is not YAML.
    """
    if not Path(path).is_file():
        raise BringupError(f'launch argument params_file = {path}: there is no such file')
    node = '/' + '/'.join([*filter(None, namespace.split('/')), NODE_NAME])
    sections = node_sections(Path(path))
    matching = [values for name, values in sections.items() if _matches(name, node)]
    if not matching:
        raise BringupError(
            f'launch argument params_file = {path}: it has no {PARAMETERS} for the node {node}; '
            f'it has some for {", ".join(sections) or "no node"}'
        )
    return {name: value for values in matching for name, value in values.items()}


def node_sections(path: Path) -> dict[str, dict[str, Any]]:
    """Return a file's sections by node name, which may contain `*` and `**`.

    Raises InputError if the file is not YAML.
    """
    content = read_yaml(path)
    return dict(_sections(content)) if isinstance(content, Mapping) else {}


def _sections(content: Mapping[str, Any], above: str = '') -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the nodes of a file, which may be nested by namespace, with their parameters."""
    for name, value in content.items():
        if not isinstance(value, Mapping):
            continue
        if name == PARAMETERS:
            yield above or '/**', dict(value)
        else:
            yield from _sections(value, f'{above}/{str(name).strip("/")}')


def _matches(pattern: str, node: str) -> bool:
    """Return whether a pattern matches a node's name. `*`: one part of it, `**`: any number."""
    expression = re.escape(pattern).replace(r'/\*\*', '(/.*)?').replace(r'\*', '[^/]*')
    return re.fullmatch(expression, node) is not None
