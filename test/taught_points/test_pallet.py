# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Pallets have the same points as Pallet in the SPEL+ interpreter."""

import pytest

from epson_driver import EpsonPoint, Pallet
from epson_driver.inputs import InputError
from epson_driver.spel.frames import Point, new_pallet

CORNERS = [
    EpsonPoint(100.0, 300.0, 50.0, 90.0),
    EpsonPoint(220.0, 310.0, 52.0),
    EpsonPoint(95.0, 420.0, 47.0),
    EpsonPoint(230.0, 425.0, 55.0),
]


@pytest.mark.parametrize('corners', [3, 4])
@pytest.mark.parametrize(('columns', 'rows'), [(4, 3), (1, 5), (5, 1), (1, 1)])
def test_pallet_points_equal_the_points_of_spel(corners: int, columns: int, rows: int) -> None:
    used = CORNERS[:corners]
    opposite = used[3] if corners == 4 else None
    pallet = Pallet(used[0], used[1], used[2], columns, rows, opposite)
    spel = new_pallet(
        tuple(Point('xy', (p.x, p.y, p.z, p.u)) for p in used), columns, rows, out=False
    )
    assert len(pallet) == columns * rows
    for index, point in enumerate(pallet):
        expected = spel.place(1, index + 1, None).values
        assert (point.x, point.y, point.z, point.u) == pytest.approx(expected)


def test_pallet_is_a_sequence() -> None:
    pallet = Pallet(*CORNERS[:3], columns=4, rows=3)
    assert (pallet[0], pallet[-1], pallet[1:3]) == (CORNERS[0], pallet[11], [pallet[1], pallet[2]])
    with pytest.raises(IndexError):
        pallet[12]


@pytest.mark.parametrize(('name', 'value'), [('columns', 0), ('rows', 2.0), ('row_end', 'P2')])
def test_invalid_argument_is_named(name: str, value: object) -> None:
    arguments = dict(zip(('first', 'row_end', 'column_end'), CORNERS, strict=False))
    with pytest.raises(InputError, match=f'^{name} = '):
        Pallet(**{**arguments, 'columns': 2, 'rows': 2, name: value})  # type: ignore[arg-type]
