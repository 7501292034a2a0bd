# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The error numbers that the controller shows in STATUS, and which one it shows now."""

import logging
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

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


class ErrorText(NamedTuple):
    """What an error number means, what a person does about it, and whether both are certain.

    `confirmed` False: from memory only; no document at hand says so.
    """

    meaning: str
    remedy: str = ''
    confirmed: bool = True


_UNCONFIRMED = False

ERRORS: dict[int, ErrorText] = {
    0: ErrorText('no error'),
    27: ErrorText('safety board: stop signal, main', 'check the safety wiring'),
    28: ErrorText('safety board: stop signal, sub', 'check the safety wiring'),
    2260: ErrorText('the task number is out of range'),
    2261: ErrorText(
        'the motion task does not exist: it was stopped, or an E-stop or an error aborted it',
        'after a stop, start; after an E-stop or an error: release, reset, motors on',
    ),
    2556: ErrorText('an endless loop without a wait'),
    2900: ErrorText('the port could not be opened as server', '', _UNCONFIRMED),
    2901: ErrorText('the port could not be opened as client', '', _UNCONFIRMED),
    2902: ErrorText('network error: the client is lost', 'connect again'),
    2904: ErrorText('the IP address is wrong', '', _UNCONFIRMED),
    2907: ErrorText('the port is in use', '', _UNCONFIRMED),
    2909: ErrorText('the port is not open', '', _UNCONFIRMED),
    2910: ErrorText('reading from the network took too long', '', _UNCONFIRMED),
    2911: ErrorText('reading from the network failed', '', _UNCONFIRMED),
    2912: ErrorText('the port is in use', '', _UNCONFIRMED),
    2913: ErrorText('writing to the network failed', '', _UNCONFIRMED),
    2914: ErrorText('the port is not connected', '', _UNCONFIRMED),
    2998: ErrorText('AbortMotion: no motion to abort'),
    2999: ErrorText('AbortMotion: the motion was aborted'),
    4001: ErrorText(
        'the arm would leave its motion range', 'send points inside the limits', _UNCONFIRMED
    ),
    4002: ErrorText('a value is out of range', '', _UNCONFIRMED),
    4007: ErrorText('the point cannot be reached', '', _UNCONFIRMED),
    4030: ErrorText('too much torque for too long', 'less load, speed or acceleration'),
    4031: ErrorText('motion attempted with the motors off', 'motors on'),
    4241: ErrorText('too fast for low power', 'power high, or slower', _UNCONFIRMED),
    4242: ErrorText('the acceleration limit was exceeded', 'less acceleration'),
    5042: ErrorText(
        'servo: a joint is too far from where it should be',
        'look for a collision or a blocked joint; reset, motors on',
        _UNCONFIRMED,
    ),
    5043: ErrorText('servo: position error overflow, in the speed loop', '', _UNCONFIRMED),
    5054: ErrorText('servo: overload', 'less load or speed; reset, motors on', _UNCONFIRMED),
    7006: ErrorText('the point is not defined'),
    7007: ErrorText('the point is not defined'),
    8000: ErrorText(
        'a motion message was corrupt, or out of sequence', 'see the log; send the trajectory anew'
    ),
    8001: ErrorText(
        'the planner of smooth motion failed; the trajectory is over', 'send the trajectory anew'
    ),
    9001: ErrorText('the wiring of the E-stop failed', 'check the wiring', _UNCONFIRMED),
    9002: ErrorText('the wiring of the safeguard failed', 'check the wiring', _UNCONFIRMED),
    9801: ErrorText('safety board: position error', 'boot the controller again'),
}
"""Error numbers with their texts; also those that only a real controller shows."""

TEXTS: dict[int, str] = {number: text.meaning for number, text in ERRORS.items()}
"""What each error number means."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a message is not obeyed: the error number, and a sentence for people."""

    number: ErrorNumber
    sentence: str

    def about(self, what: str) -> 'Refusal':
        """Return the same with what it is about in front."""
        return Refusal(self.number, f'{what}: {self.sentence}')


def corrupt(sentence: str) -> Refusal:
    """Return the refusal of a message that is wrong in itself."""
    return Refusal(ErrorNumber.CORRUPT_MESSAGE, sentence)


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
