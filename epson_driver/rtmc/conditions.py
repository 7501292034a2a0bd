# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conditions under which a controller accepts Real-time Motion Control's requests, and refusals.

Source: readme.md of EPSON's client library ("Request Acceptance Conditions"). The conditions are
checked in the order of its table, but the motion mode is checked last. An E-stop, an open
safeguard or an error ends the motion mode, and EPSON's demo expects this cause as the reason.
"""

from dataclasses import dataclass
from enum import IntEnum

from epson_driver.rtmc.messages import OperationMode, Request, RtmcStatus


class Refusal(IntEnum):
    """Reasons for a refusal, the low byte of the reply's low word.

    For an EXECUTION error, the high byte contains a detail.
    """

    EXECUTION = 0
    NOT_AUTO = 1
    MODEL_NOT_CHECKED = 2
    MOTION_MODE = 3
    TIMEOUT = 4
    ERROR = 5
    ESTOP = 6
    SAFEGUARD = 7


class Detail(IntEnum):
    """Details of an EXECUTION error. Their meaning depends on the request."""

    PASSWORD = 1
    NO_OPTION = 2
    REMOTE_IO = 1
    MOTORS_OFF = 1
    DECELERATING = 2


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions under which the controller accepts a request.

    `mode`: required state of the motion mode (None: either).
    """

    auto: bool = True
    checked: bool = False
    mode: bool | None = False
    safe: bool = False
    """Whether the request requires a closed safeguard, no E-stop and no error."""


_ANY_MODE = Conditions(auto=False, mode=None)
_CHECKED = Conditions(checked=True)
_SAFE = Conditions(safe=True)
_CHECKED_AND_SAFE = Conditions(checked=True, safe=True)

CONDITIONS: dict[int, Conditions] = {
    **dict.fromkeys(Request, Conditions()),
    Request.STATUS: _ANY_MODE,
    Request.FORMATS: _ANY_MODE,
    Request.MESSAGES: _ANY_MODE,
    Request.CONNECT: Conditions(auto=False),
    Request.JOINTS: Conditions(auto=False),
    Request.JOINTS_AT_REST: Conditions(auto=False),
    Request.SET_MOTORS: _CHECKED_AND_SAFE,
    Request.SET_POWER: _CHECKED,
    Request.SET_WEIGHT: _CHECKED,
    Request.SET_INERTIA: _CHECKED,
    Request.SET_OUTPUTS: _SAFE,
    Request.MODE: Conditions(mode=None),
    Request.MOVE: Conditions(checked=True, mode=True, safe=True),
}
del CONDITIONS[Request.STATUS_NOTICE], CONDITIONS[Request.JOINTS_NOTICE]

ENABLE = Conditions(checked=True, mode=None, safe=True)
DISABLE = Conditions(checked=True, mode=None)
"""Conditions of SET_MODE with the low word 1 (ENABLE) and 0 (DISABLE)."""

REMEDIES: dict[Refusal, str] = {
    Refusal.NOT_AUTO: 'the operation mode is not Auto: select Auto',
    Refusal.MODEL_NOT_CHECKED: 'the robot model is not checked: check it first',
    Refusal.MOTION_MODE: 'the motion mode is wrong for this request: enable or disable it first',
    Refusal.TIMEOUT: 'the controller took too long: see its error, then reset',
    Refusal.ERROR: 'there is an error: reset, then enable',
    Refusal.ESTOP: 'the E-stop is pressed or not reset: release it, reset, then enable',
    Refusal.SAFEGUARD: 'the safeguard is open: close it, then enable',
}
"""Reason for a refusal → text with the reason and the remedy.

The texts of EXECUTION errors are in DETAILS.
"""

DETAILS: dict[tuple[int, int], str] = {
    (Request.CONNECT, Detail.PASSWORD): 'the password is wrong: use the one of the controller',
    (Request.CONNECT, Detail.NO_OPTION): 'the option is not enabled: enable it in RC+',
    **{
        (request, Detail.REMOTE_IO): 'remote I/O is assigned to standard I/O: unassign it in RC+'
        for request in (
            Request.SET_SEND_FORMAT,
            Request.SET_RECEIVE_FORMAT,
            Request.SET_OUTPUTS,
        )
    },
    (Request.SET_MODE, Detail.MOTORS_OFF): 'the motors are off: switch them on first',
    (Request.SET_MODE, Detail.DECELERATING): 'the arm is still braking: try again at rest',
}
"""(request, detail) → text with the reason and the remedy of an EXECUTION error."""


def required(request: int, low: int) -> Conditions | None:
    """Return the conditions for accepting a request, or None if the request is unknown."""
    if request == Request.SET_MODE:
        return ENABLE if low else DISABLE
    return CONDITIONS.get(request)


def refusal(
    conditions: Conditions, status: RtmcStatus, *, checked: bool, mode: bool
) -> Refusal | None:
    """Return why a request is refused, or None.

    `checked`: whether the robot model is checked. `mode`: whether the motion mode is enabled.
    """
    if conditions.auto and status.mode is not OperationMode.AUTO:
        return Refusal.NOT_AUTO
    if conditions.checked and not checked:
        return Refusal.MODEL_NOT_CHECKED
    if conditions.safe:
        if status.safeguard_open:
            return Refusal.SAFEGUARD
        if status.estop:
            return Refusal.ESTOP
        if status.error:
            return Refusal.ERROR
    if conditions.mode is not None and conditions.mode is not mode:
        return Refusal.MOTION_MODE
    return None


def sentence(request: int, low: int) -> str:
    """Return the reason and the remedy of a refusal. `low`: low word of the reply."""
    reason, detail = low & 0xFF, low >> 8
    if reason in REMEDIES:
        return REMEDIES[Refusal(reason)]
    if reason == Refusal.EXECUTION:
        return DETAILS.get((request, detail), 'the request failed: see the error in RC+')
    return f'unknown reason {low:#06x}'
