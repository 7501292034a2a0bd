# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The error numbers that the controller shows in STATUS, the current error, and rejections."""

import logging
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from epson_driver.error_texts import load_error_texts
from epson_driver.motion import Array, JointLimits
from epson_driver.sim_controller.condition.states import (
    REGIONS,
    Condition,
    EStop,
    Fault,
    Mode,
    Motors,
    Tasks,
)

_log = logging.getLogger(__name__)


class ErrorNumber(IntEnum):
    """SPEL+ error numbers. Numbers from 8000 are defined by the program on the controller.

    8000 is from the thesis, and controller_program also uses 8004. 8001 exists only in this
    simulation.
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
    CLIENT_SILENT = 8004


ERRORS = load_error_texts('epson')
TEXTS: dict[int, str] = {number: text.meaning for number, text in ERRORS.items()}


@dataclass(frozen=True, slots=True)
class Rejection:
    """The reason for refusing a message: an error number, and a sentence for the log."""

    number: int
    sentence: str

    def about(self, subject: str) -> 'Rejection':
        return Rejection(self.number, f'{subject}: {self.sentence}')


def corrupt(sentence: str) -> Rejection:
    return Rejection(ErrorNumber.CORRUPT_MESSAGE, sentence)


class ErrorRegister:
    """The error that the controller shows, until it is cleared."""

    def __init__(self) -> None:
        self.number: int = ErrorNumber.NONE

    def enter(self, rejection: Rejection) -> None:
        self.number = rejection.number
        _log.warning('refused (%d): %s', rejection.number, rejection.sentence)

    def clear(self, only: int | None = None) -> None:
        if only in (None, self.number):
            self.number = ErrorNumber.NONE


NO_MOTION: dict[EStop | Fault | Tasks | Mode | Motors, Rejection] = {
    EStop.PRESSED: Rejection(
        ErrorNumber.TASK_ABORTED, 'the E-stop is pressed: release it, reset, motors on'
    ),
    EStop.LATCHED: Rejection(
        ErrorNumber.TASK_ABORTED, 'the E-stop is released but not reset: reset, motors on'
    ),
    Fault.CRITICAL: Rejection(
        ErrorNumber.TASK_ABORTED, 'a critical error aborted the motion task: boot the controller'
    ),
    Fault.ERROR: Rejection(
        ErrorNumber.TASK_ABORTED, 'an error aborted the motion task: reset, motors on'
    ),
    Tasks.STOPPED: Rejection(ErrorNumber.TASK_ABORTED, 'the motion task is stopped: start it'),
    Mode.MANUAL: Rejection(
        ErrorNumber.MOTORS_OFF, 'the key switch is at MANUAL: turn it to AUTO, motors on'
    ),
    Motors.OFF: Rejection(ErrorNumber.MOTORS_OFF, 'the motors are off: switch the motors on'),
    Motors.BRAKING: Rejection(ErrorNumber.MOTORS_OFF, 'the motors are going off'),
}
"""Controller state → reason for refusing points. The first match is reported.

A pause is missing, because points are accepted during a pause.
"""


def condition_rejection(condition: Condition) -> Rejection | None:
    states = {getattr(condition, region) for region in REGIONS}
    return next((rejection for state, rejection in NO_MOTION.items() if state in states), None)


def angles_rejection(angles: Array, limits: JointLimits) -> Rejection | None:
    low, high = limits.position_min, limits.position_max
    # A limit that was rounded to float32 in transit is allowed.
    inside = (angles >= np.minimum(low, low.astype(np.float32))) & (
        angles <= np.maximum(high, high.astype(np.float32))
    )
    if inside.all():
        return None
    joint = int(np.argmin(inside))
    sentence = (
        f'{limits.names[joint]} = {angles[joint]:.7g} {limits.units[joint]} is outside the limits '
        f'{low[joint]:.7g} … {high[joint]:.7g} {limits.units[joint]}'
    )
    return Rejection(ErrorNumber.OUT_OF_RANGE, sentence)


def clipped(angles: Array, limits: JointLimits) -> Array:
    nearest: Array = np.clip(angles, limits.position_min, limits.position_max)
    return nearest
