# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The interface of a program on the motion port: `MotionProgram`, or `MotomanProgram`."""

from collections.abc import Callable, Iterable
from typing import Protocol

from epson_driver.sim_controller.condition.tasks import TaskRow
from epson_driver.simple_message import Frame, Packet

SendPacket = Callable[[Packet], None]
"""Takes a reply."""


class Program(Protocol):
    """Has the points of one client executed, one after the other, and answers them."""

    @property
    def ready(self) -> bool:
        """Whether it takes points as far as it is up to the program itself."""

    @property
    def runs(self) -> bool:
        """Whether its tasks keep the controller from being Ready: those that are not SPEL+ do not.

        Tasks in the background do not count.
        """

    def receive(self, frame: Frame) -> None:
        """Obey, queue or refuse one frame."""

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass for the executor, which the program feeds.

        Where a point is done within `dt`, the program answers it and gives the next one, which has
        the rest of the time: from point to point without a pause, however long the steps are.
        """

    def abort(self) -> None:
        """Brake, and answer all points that are not answered yet with FAILURE."""

    def restart(self) -> None:
        """Abort, and forget the trajectory."""

    def detach(self) -> None:
        """Forget the client, which is gone, but not its acknowledged points."""

    def pause(self) -> None:
        """Give the arm no more points and answer none, until `resume`. Twice is no error.

        What is wrong is refused all the same, and a STOP obeyed. The arm itself is held by who
        pauses.
        """

    def resume(self) -> None:
        """Go on after `pause`."""

    def boot(self) -> None:
        """Begin anew, as the controller was switched off and on again."""

    def tasks(self) -> Iterable[TaskRow] | None:
        """Return its tasks as people see them, or None if they are those of condition/tasks.py."""
