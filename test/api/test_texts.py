# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Texts of the driver, which ROS and Python share, mention neither ROS services nor goals."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import epson_driver.driver

FILES = sorted(Path(epson_driver.driver.__file__).parent.rglob('*.py'))

OF_ROS = re.compile(r'~/|\bgoals?\b')

ALLOWED = re.compile(
    r'(at|to|from|than to) the goal|goal_time'  # a target position
    r'|new(er)? goal|goal before|cancelled goal'
    r'|^goal$'  # name of a counter
)


def texts(tree: ast.AST) -> Iterator[str]:
    """Yield every string literal of a module, except docstrings."""
    documented = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in documented:
            yield str(node.value)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_driver_texts_mention_no_ros_services_or_goals(path: Path) -> None:
    for text in texts(ast.parse(path.read_text('utf-8'))):
        assert not OF_ROS.search(ALLOWED.sub('', text)), text
