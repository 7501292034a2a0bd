# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points of a robot: a mapping from names to EpsonPoints, with files."""

from collections.abc import Awaitable, Callable, Iterator
from os import PathLike
from typing import Any

from epson_driver.api.errors import checked_arguments
from epson_driver.api.ownership import Unique
from epson_driver.taught_points import EpsonPoint, Posture, TaughtPoints


class Points(Unique):
    """Taught points: a mapping from names, or P and a number, to EpsonPoints, ignoring case.

    The arm moves to a point in the configuration nearest to the current one, not in the file's.
    `here` returns the tool's point, and the arm's posture or why it is unknown.
    """

    def __init__(
        self,
        here: Callable[[], tuple[EpsonPoint, Posture | str]],
        measured: Callable[[Callable[[], Any]], Awaitable[Any]],
    ) -> None:
        self.measured = measured
        self._here = here
        self._taught = TaughtPoints()

    @checked_arguments
    def __getitem__(self, name: str) -> EpsonPoint:
        """Return a point. Raises KeyError, and ArgumentError for a label without a position."""
        return self._taught.get(name)

    @checked_arguments
    def __setitem__(self, name: str, point: EpsonPoint) -> None:
        """Set or add a point. Raises ArgumentError."""
        self._taught.set(name, point)

    @checked_arguments
    def __delitem__(self, name: str) -> None:
        """Delete a point. Raises KeyError."""
        self._taught.remove(name)

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._taught)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._taught)

    def __contains__(self, name: object) -> bool:
        """Return whether a point exists, with or without a position."""
        return name in self._taught

    @checked_arguments
    def teach(self, name: str) -> EpsonPoint:
        """Set or add a point at the current tool position, and return it.

        Raises ArgumentError, and as `Robot.joints`.
        """
        point, posture = self._here()
        self._taught.set(name, point, posture)
        return point

    @checked_arguments
    def load(self, path: str | PathLike[str]) -> int:
        """Replace all points by those in a .pts or .yaml file, and return their number.

        Raises OSError, and ArgumentError with the file and the error in it.
        """
        return self._taught.load(path)

    @checked_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write all points to a .pts or .yaml file.

        Unchanged lines of a .pts file are preserved. Raises OSError, and ArgumentError for a point
        that the file format does not support.
        """
        self._taught.save(path)
