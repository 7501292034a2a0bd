# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reasons why the arm does not move, each with a cause, a remedy and a text.

InhibitTable (why_not.py) determines the reason that applies. The node, the Python API, the panel
and the doctor describe the remedy in their own terms, for example the service to call or the
button to press.
"""

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum, Flag, auto

from epson_driver.driver.remedy import Remedy
from epson_driver.error_texts import NO_ERROR, ErrorTexts
from epson_driver.remote_ethernet.answers import CONTROL_DEVICES, REMOTE_ETHERNET
from epson_driver.simple_message import Mode, Status, TriState


class Purpose(Flag):
    """An action that may be inhibited. The driver checks the inhibits before each action.

    * REPORT: report why the arm does not move. COMMAND: send a command to the controller.
    * ENABLE: start to enable the arm. OPEN: open the arm gate.
    * RUN: keep the gate open and motion running.
    * GOAL: accept a goal although joints are unavailable during a motion.
    * READY: accept a goal or plan it, from known joint positions.
    * ALONE: accept a goal only if no other goal runs. START: start a goal.
    * STREAM: start a stream of setpoints. FOLLOW: send the next setpoint.
    * LET_GO: keep a stream for which STOP was sent, for example after a silence.
    * RESUME: resume a paused goal.
    """

    REPORT = auto()
    COMMAND = auto()
    ENABLE = auto()
    OPEN = auto()
    RUN = auto()
    GOAL = auto()
    READY = auto()
    ALONE = auto()
    START = auto()
    STREAM = auto()
    FOLLOW = auto()
    LET_GO = auto()
    RESUME = auto()


class Cause(Enum):
    """The cause of an inhibit. InhibitTable.ROWS defines the actions that each cause inhibits."""

    NO_STATE_LINK = auto()
    NO_JOINTS = auto()
    NO_STATUS = auto()
    STOP_FAILED = auto()
    SECOND_DRIVER = auto()
    NO_MOTION_LINK = auto()
    ESTOP = auto()
    ERROR = auto()
    SAFEGUARD = auto()
    MANUAL_MODE = auto()
    CONTROL_DEVICE = auto()
    NOT_ENABLED = auto()
    MOTORS_OFF = auto()
    MAIN_ENDED = auto()
    PAUSED = auto()
    NOT_POSSIBLE = auto()
    NO_STREAMS = auto()
    GOAL_RUNS = auto()
    STOPPING = auto()
    STREAM = auto()
    NO_POSE = auto()
    MOVES = auto()


@dataclass(frozen=True, slots=True)
class Inhibit:
    """A reason why the arm may not move. `past`: text for when the cause has passed, or ''."""

    cause: Cause
    remedy: Remedy
    text: str  # the reason, as part of a sentence
    advice: str = ''  # the manufacturer's first remedy for a controller error, or ''
    past: str = ''

    @property
    def reason(self) -> str:
        """The reason for disabling the arm, in words that stay true after the cause has passed."""
        return self.past or self.text

    @property
    def text_with_remedy(self) -> str:
        return f'{self.text}: {self.advice}' if self.advice else self.text


PAUSED = Inhibit(
    Cause.PAUSED,
    Remedy.CONTINUE,
    'the controller is paused, or main is not running (it reports that motion is not possible)',
)


MAIN_ENDED = Inhibit(Cause.MAIN_ENDED, Remedy.START_MAIN, 'main is not running')

MANUAL = Inhibit(Cause.MANUAL_MODE, Remedy.TURN_TO_AUTO, 'the key switch is at MANUAL')


def second_driver(who: str) -> Inhibit:
    return Inhibit(
        Cause.SECOND_DRIVER, Remedy.RENAME, f'a second driver uses the same names: {who}'
    )


def main_ended(status: Status, errors: ErrorTexts) -> Inhibit:
    text = f'the controller reports that motion is not possible, {_error(status, errors)}'
    return Inhibit(Cause.MAIN_ENDED, Remedy.START_MAIN, text)


def _error(status: Status, errors: ErrorTexts) -> str:
    return f'error {errors.phrase(status.error_code)}'


def not_enabled(reason: str, refusal: Inhibit | None = None) -> Inhibit:
    """Return the inhibit for a closed gate.

    `refusal`: why the last attempt to enable the arm failed, or None.
    """
    if refusal is not None:
        text = f'the arm is not enabled (at the last attempt {refusal.reason})'
        return Inhibit(Cause.NOT_ENABLED, refusal.remedy, text, refusal.advice)
    return Inhibit(Cause.NOT_ENABLED, Remedy.ENABLE, f'the arm is not enabled ({reason})')


def controller_error(status: Status, errors: ErrorTexts) -> Inhibit:
    number = status.error_code
    return Inhibit(
        Cause.ERROR,
        Remedy.RESET,
        f'the controller is in error {errors.phrase(number)}',
        errors.advice(number, 'remove the cause'),
        f'the controller was in error {errors.phrase(number)}',
    )


def status_inhibit(status: Status, errors: ErrorTexts) -> Inhibit | None:
    """Return the inhibit for an E-stop, an error or motors that are off in STATUS, or None."""
    number = status.error_code
    error = '' if number == NO_ERROR else f', error {errors.phrase(number)}'
    if status.e_stopped == TriState.TRUE:
        text = f'the E-stop is pressed or not reset{error}'
        past = f'the E-stop was pressed{error.partition(" (")[0]}'  # shown in brackets itself
        return Inhibit(Cause.ESTOP, Remedy.RELEASE_ESTOP, text, past=past)
    if status.in_error == TriState.TRUE:
        return controller_error(status, errors)
    if status.drives_powered == TriState.FALSE:
        text, advice = f'the motors are off{error}', errors.advice(number, '')
        return Inhibit(Cause.MOTORS_OFF, Remedy.ENABLE, text, advice)
    return None


def manual_inhibit(status: Status) -> Inhibit | None:
    """Return MANUAL if the key switch is at MANUAL and motion is not possible, else None."""
    manual = status.mode == Mode.MANUAL and status.motion_possible != TriState.TRUE
    return MANUAL if manual else None


def seen_inhibit(status: Status, errors: ErrorTexts) -> Inhibit | None:
    """Return why the arm cannot move according to STATUS, or None.

    The key switch and motion_possible also count.
    """
    result = status_inhibit(status, errors)
    if result is None or result.cause is Cause.MOTORS_OFF:
        result = manual_inhibit(status) or result
    if result is None and status.motion_possible == TriState.FALSE:
        text = (
            'the controller reports that motion is not possible (a safeguard is open, it is '
            'paused, or main is not running)'
        )
        return Inhibit(Cause.NOT_POSSIBLE, Remedy.LOOK_AT_CONTROLLER, text)
    return result


def flags_inhibit(flags: Collection[str], number: int, errors: ErrorTexts) -> Inhibit | None:
    """Return why the arm cannot move according to the flags of GetStatus, or None."""
    error = f'error {errors.phrase(number)}'
    advice = errors.advice(number, 'remove the cause')
    for flag, cause, remedy, text in (
        ('EStop', Cause.ESTOP, Remedy.RELEASE_ESTOP, 'the E-stop is pressed or not reset'),
        ('SError', Cause.ERROR, Remedy.BOOT, f'there is a critical error: {error}'),
        ('Safeguard', Cause.SAFEGUARD, Remedy.CLOSE_SAFEGUARD, 'the safeguard door is open'),
        ('Teach', Cause.MANUAL_MODE, Remedy.TURN_TO_AUTO, 'the mode is TEACH'),
        ('Test', Cause.MANUAL_MODE, Remedy.TURN_TO_AUTO, 'the mode is TEST'),
        ('Error', Cause.ERROR, Remedy.RESET, f'the controller is in {error}'),
        ('Paused', Cause.PAUSED, Remedy.CONTINUE, 'the tasks are paused'),
    ):
        if flag in flags:
            past = text.replace(' is ', ' was ').replace(' are ', ' were ')
            past = past.replace(' or not reset', '')
            return Inhibit(cause, remedy, text, advice if cause is Cause.ERROR else '', past)
    return None


def refusal_inhibit(
    flags: Collection[str], number: int, device: int | None, errors: ErrorTexts
) -> Inhibit | None:
    """Return why Remote Ethernet refuses a command, or None if the reason is unknown."""
    return flags_inhibit(flags, number, errors) or device_inhibit(device)


def device_inhibit(device: int | None) -> Inhibit | None:
    if device is None or device == REMOTE_ETHERNET:
        return None
    name = CONTROL_DEVICES[device]
    text = f'the control device is {name}: only this device controls the motors and main'
    return Inhibit(Cause.CONTROL_DEVICE, Remedy.CHOOSE_CONTROL_DEVICE, text)
