# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The error numbers that the controller shows in STATUS, and which one it shows now."""

import logging
from dataclasses import dataclass
from enum import IntEnum

_log = logging.getLogger(__name__)


class ErrorNumber(IntEnum):
    """SPEL+ error numbers; 8000 is the first user error, as the thesis' program uses it.

    8001 is ours, for what only the simulation can have.
    """

    NONE = 0
    TASK_ABORTED = 2261
    OUT_OF_RANGE = 4001
    MOTORS_OFF = 4031
    CORRUPT_MESSAGE = 8000
    PLANNER_FAILED = 8001


TEXTS: dict[int, str] = {
    ErrorNumber.NONE: 'no error',
    ErrorNumber.TASK_ABORTED: 'the motion task does not exist: the E-stop aborted it',
    ErrorNumber.OUT_OF_RANGE: 'the arm would leave its motion range',
    ErrorNumber.MOTORS_OFF: 'motion attempted with the motors off',
    ErrorNumber.CORRUPT_MESSAGE: 'a motion message was corrupt, or out of sequence',
    ErrorNumber.PLANNER_FAILED: 'the planner of smooth motion failed; the trajectory is over',
}


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a message is not obeyed: the error number, and a sentence for people."""

    number: ErrorNumber
    sentence: str


class ErrorRegister:
    """The error that the controller shows, until something clears it."""

    def __init__(self) -> None:
        self.number = ErrorNumber.NONE

    def enter(self, refusal: Refusal) -> None:
        """Show the refusal's error, and log its sentence."""
        self.number = refusal.number
        _log.warning('refused (%d): %s', refusal.number, refusal.sentence)

    def clear(self, only: ErrorNumber | None = None) -> None:
        """Show no error any more; with `only`, if it is that one."""
        if only in (None, self.number):
            self.number = ErrorNumber.NONE
