# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the driver says is said to ROS and to Python alike: no names of ROS, no action's goal."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import epson_driver.driver

FILES = sorted(Path(epson_driver.driver.__file__).parent.rglob('*.py'))

OF_ROS = re.compile(r'~/|\bgoals?\b')

ALLOWED = re.compile(
    r'(at|to|from|than to) the goal|goal_time'  # where the arm is to go
    r'|new(er)? goal|goal before|goal that was given up'
    r'|^goal$'  # the name of a counter
)


def said(tree: ast.AST) -> Iterator[str]:
    """Yield every text of a program that is no docstring."""
    documented = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in documented:
            yield str(node.value)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_the_driver_names_neither_services_nor_goals_of_ros(path: Path) -> None:
    for text in said(ast.parse(path.read_text('utf-8'))):
        assert not OF_ROS.search(ALLOWED.sub('', text)), text
