# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures that start cells and end them after the test."""

import os
from contextlib import closing

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

from collections.abc import Iterator
from typing import Any

import pytest
from support.cell import Cell, cell_with


@pytest.fixture
def make_cell(tmp_path: Any) -> Iterator[Any]:
    cells: list[Cell] = []

    def make(*arguments: str, program: str = 'built-in', **parameters: Any) -> Cell:
        cells.append(cell_with(tmp_path, program, *arguments, **parameters))
        return cells[-1]

    yield make
    for cell in cells:
        cell.close()


@pytest.fixture
def cell(make_cell: Any) -> Cell:
    """A running cell with the arm disabled."""
    return make_cell().ready()


@pytest.fixture(scope='module')
def one_cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One cell for all tests of a module, with the arm disabled at first."""
    with closing(Cell(tmp_path_factory.mktemp('cell'))) as one:
        yield one.ready()


@pytest.fixture(scope='module')
def shared_cell(one_cell: Cell) -> Cell:
    """One enabled cell for all tests of a module that restore its state."""
    one_cell.peer.enable()
    return one_cell
