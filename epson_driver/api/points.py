# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points of a robot: a mapping from names to EpsonPoints, with files."""

from collections.abc import Awaitable, Callable, Iterator
from os import PathLike
from typing import Any

from epson_driver.api.arguments import checked_arguments
from epson_driver.api.ownership import Unique
from epson_driver.taught_points import EpsonPoint, Posture, TaughtPoints


class Points(Unique):
    """Taught points: a mapping from names, or P and a number, to EpsonPoints, ignoring case.

    The arm goes there in the configuration nearest to where it is, not in the file's. `here`
    returns where the tool is, and the arm's posture, or why that is not known.
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
        """Return a point. Raises KeyError, and ArgumentError for a label without a place."""
        return self._taught.get(name)

    @checked_arguments
    def __setitem__(self, name: str, point: EpsonPoint) -> None:
        """Set a point, also a new one. Raises ArgumentError."""
        self._taught.set(name, point)

    @checked_arguments
    def __delitem__(self, name: str) -> None:
        """Forget a point. Raises KeyError."""
        self._taught.remove(name)

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._taught)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._taught)

    def __contains__(self, name: object) -> bool:
        """Return whether there is such a point, with a place or without."""
        return name in self._taught

    @checked_arguments
    def teach(self, name: str) -> EpsonPoint:
        """Take where the tool is now for a point, also a new one, and return it.

        Raises ArgumentError, and as `Robot.joints`.
        """
        point, posture = self._here()
        self._taught.set(name, point, posture)
        return point

    @checked_arguments
    def load(self, path: str | PathLike[str]) -> int:
        """Read a .pts or .yaml file in place of all points and return how many it has.

        Raises OSError, and ArgumentError that names the file and what is wrong in it.
        """
        return self._taught.load(path)

    @checked_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write all points to a .pts or .yaml file.

        What was read from a .pts file and not changed is written as it was. Raises OSError, and
        ArgumentError for a point that such a file cannot hold.
        """
        self._taught.save(path)
