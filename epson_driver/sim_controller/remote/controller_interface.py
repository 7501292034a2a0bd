# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller, as remote commands need it."""

from collections.abc import Iterable
from typing import Protocol

from epson_driver.motion import Array
from epson_driver.profiles.profile import ControllerProfile
from epson_driver.robots import RobotModel
from epson_driver.sim_controller.arm.streaming import DeadlineCounters
from epson_driver.sim_controller.condition.errors import Rejection
from epson_driver.sim_controller.condition.spel_settings import SpelSettings
from epson_driver.sim_controller.condition.states import Condition, Event
from epson_driver.sim_controller.condition.tasks import TaskRow
from epson_driver.sim_controller.faults.faults import Faults
from epson_driver.sim_controller.io.io_points import IoPoints
from epson_driver.sim_controller.ports import CommandWindow


class ControllerInterface(Protocol):
    """The controller, as far as remote commands reach it."""

    @property
    def model(self) -> RobotModel:
        """The robot."""

    @property
    def profile(self) -> ControllerProfile:
        """The controller's profile."""

    @property
    def condition(self) -> Condition:
        """Its condition now."""

    @property
    def program_runs(self) -> bool:
        """Whether tasks of a SPEL+ program run, besides those in the background."""

    @property
    def error_number(self) -> int:
        """The error that it shows."""

    def error_text(self, number: int) -> str:
        """Return what an error number means, with file and line if it is shown now."""

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has somewhere to go, be it after a pause."""

    @property
    def commanded(self) -> Array:
        """Where the joints are to be now, shape (n,), rad or m."""

    @property
    def in_motion(self) -> bool:
        """Whether the arm moves, or is about to."""

    @property
    def io(self) -> IoPoints:
        """Its inputs, outputs and memory bits."""

    @property
    def spel(self) -> SpelSettings:
        """The settings of SPEL+ statements."""

    @property
    def faults(self) -> Faults:
        """The faults that can be asked for."""

    @property
    def timing(self) -> DeadlineCounters:
        """Missed deadlines of its motion."""

    def apply(self, event: Event) -> None:
        """Apply an event. Raises RejectedError: why not, and what to do."""

    @property
    def window(self) -> CommandWindow:
        """The program that executes $Execute."""

    def show(self, rejection: Rejection) -> None:
        """Show an error number, and log why."""

    def tasks(self) -> Iterable[TaskRow]:
        """Yield the tasks there are, as people see them."""

    def disturb(self, joint: int, push: float) -> None:
        """Push one joint (index from 0) by some rad or m. Raises RejectedError."""
