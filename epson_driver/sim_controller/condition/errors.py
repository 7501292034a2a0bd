# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The error numbers that the controller shows in STATUS, and which one it shows now."""

import logging
from dataclasses import dataclass
from enum import IntEnum

from epson_driver.error_texts import load_error_texts

_log = logging.getLogger(__name__)


class ErrorNumber(IntEnum):
    """SPEL+ error numbers; 8000 is the first user error, as the thesis' program uses it.

    8001 is ours, for what only the simulation can have.
    """

    NONE = 0
    TASK_ABORTED = 2261
    NO_MOTION = 2998
    MOTION_ABORTED = 2999
    OUT_OF_RANGE = 4001
    MOTORS_OFF = 4031
    SERVO_ERROR = 5042
    CORRUPT_MESSAGE = 8000
    PLANNER_FAILED = 8001
    SAFETY_BOARD_POSITION = 9801


ERRORS = load_error_texts('epson')
"""Error numbers with their texts; also those that only a real controller shows."""

TEXTS: dict[int, str] = {number: text.meaning for number, text in ERRORS.items()}
"""What each error number means."""


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why a message is not obeyed: the error number, and a sentence for people."""

    number: ErrorNumber
    sentence: str

    def about(self, what: str) -> 'Rejection':
        """Return the same with what it is about in front."""
        return Rejection(self.number, f'{what}: {self.sentence}')


def corrupt(sentence: str) -> Rejection:
    """Return the rejection of a message that is wrong in itself."""
    return Rejection(ErrorNumber.CORRUPT_MESSAGE, sentence)


class ErrorRegister:
    """The error that the controller shows, until something clears it."""

    def __init__(self) -> None:
        self.number = ErrorNumber.NONE

    def enter(self, rejection: Rejection) -> None:
        """Show the rejection's error, and log its sentence."""
        self.number = rejection.number
        _log.warning('refused (%d): %s', rejection.number, rejection.sentence)

    def clear(self, only: ErrorNumber | None = None) -> None:
        """Show no error any more; with `only`, if it is that one."""
        if only in (None, self.number):
            self.number = ErrorNumber.NONE
