# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points of a Robot: a mapping from names to EpsonPoints, with files."""

from collections.abc import Awaitable, Callable, Iterator
from os import PathLike
from typing import Any

from epson_driver.api.errors import checked_arguments
from epson_driver.api.ownership import Unique
from epson_driver.taught_points import EpsonPoint, Posture, TaughtPoints


class Points(Unique):
    """Taught points: a mapping from names, such as pick or P3, to EpsonPoints. Case is ignored.

    A motion to a point uses the arm configuration nearest to the current one, and not the posture
    that is saved with the point.
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
        """Return a point. Raises ArgumentError (also a KeyError) if the name is unknown."""
        return self._taught.get(name)

    @checked_arguments
    def __setitem__(self, name: str, point: EpsonPoint) -> None:
        """Set or add a point. Raises ArgumentError if the name or the point is invalid."""
        self._taught.set(name, point)

    @checked_arguments
    def __delitem__(self, name: str) -> None:
        """Delete a point. Raises ArgumentError (also a KeyError) if the name is unknown."""
        self._taught.remove(name)

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the points."""
        return iter(self._taught)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._taught)

    def __contains__(self, name: object) -> bool:
        """Return whether a point with this name exists, even if it has no position."""
        return name in self._taught

    @property
    def places(self) -> dict[str, EpsonPoint]:
        """The points that have a position, by name."""
        return self._taught.places

    @checked_arguments
    def teach(self, name: str) -> EpsonPoint:
        """Set or add a point at the current tool position, and return it.

        Raises ArgumentError if the name is invalid, RobotError if the joints are stale.
        """
        point, posture = self._here()
        self._taught.set(name, point, posture)
        return point

    @checked_arguments
    def load(self, path: str | PathLike[str]) -> int:
        """Replace all points by the points in a .pts or .yaml file, and return their number.

        Raises ArgumentError if the file cannot be read or is invalid.
        """
        return self._taught.load(path)

    @checked_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write all points to a .pts or .yaml file.

        Unchanged content of a .pts file is preserved. Raises a RobotError that is also an OSError
        if the file cannot be written, ArgumentError if its format does not support a point.
        """
        self._taught.save(path)
