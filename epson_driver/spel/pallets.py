# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Pallets: places in even rows and columns between three or four corners (SPEL+ pages 596-602)."""

from dataclasses import dataclass

from epson_driver.spel.errors import ErrorNumber, SpelError, bad
from epson_driver.spel.values import Point

_MOST_PLACES = 32_767


@dataclass(frozen=True, slots=True)
class Pallet:
    """One pallet. `corners`: the first one, the end of its row, that of its column, the opposite.

    With `outside`, columns and rows beyond those there are can be asked for.
    """

    corners: tuple[Point, ...]
    columns: int
    rows: int
    outside: bool

    def place(self, number: int, position: int, row: int | None) -> Point:
        """Return a place by its position, from 1 along the first row, or by column and row.

        The orientation is that of the first corner. `number` is the pallet's, for the error.
        Raises SpelError.
        """
        if row is None:
            column, row = (position - 1) % self.columns + 1, (position - 1) // self.columns + 1
            within = 1 <= position <= self.columns * self.rows
        else:
            column = position
            within = self.outside or (1 <= column <= self.columns and 1 <= row <= self.rows)
        if not within:
            text = f'Pallet {number}: {self.columns} columns, {self.rows} rows have no such place'
            raise SpelError(ErrorNumber.ARGUMENT, text)
        across = (column - 1) / max(self.columns - 1, 1)
        along = (row - 1) / max(self.rows - 1, 1)
        first, second, third, *opposite = (corner.values for corner in self.corners)
        moved = []
        for axis in range(3):
            a, b, c = first[axis], second[axis], third[axis]
            d = opposite[0][axis] if opposite else b + c - a
            near = a + across * (b - a)
            moved.append(near + along * (c + across * (d - c) - near))
        return Point('xy', (*moved, *first[3:]), self.corners[0].flags)


def new_pallet(given: tuple[Point, ...], columns: int, rows: int, out: bool) -> Pallet:
    """Return a pallet between corners that are places in space. Raises SpelError."""
    for name, count in (('columns', columns), ('rows', rows)):
        if not 1 <= count <= _MOST_PLACES:
            raise bad('Pallet', f'{count} {name} are not in 1..{_MOST_PLACES}')
    if columns * rows >= _MOST_PLACES:
        raise bad('Pallet', f'{columns} times {rows} places are not below {_MOST_PLACES}')
    if any(corner.kind != 'xy' or len(corner.values) < 3 for corner in given):
        raise bad('Pallet', 'the corners must be places in space')
    return Pallet(given, columns, rows, out)
