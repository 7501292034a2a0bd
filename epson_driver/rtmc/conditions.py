# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conditions under which a controller accepts Real-time Motion Control's requests, and refusals.

Source: readme.md of EPSON's client library ("Request Acceptance Conditions"). The conditions are
checked in the order of its table, but the motion mode is checked last. An E-stop, an open
safeguard or an error ends the motion mode, and EPSON's demo expects this cause as the reason.
"""

from enum import IntEnum, IntFlag

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


class Needs(IntFlag):
    """Conditions under which the controller accepts a request."""

    NONE = 0
    AUTO = 1
    CHECKED = 2  # the robot model is checked
    SAFE = 4  # the safeguard is closed, and there is no E-stop and no error
    MODE = 8  # the motion mode is enabled
    NO_MODE = 16


_CHECKED = Needs.AUTO | Needs.CHECKED | Needs.NO_MODE

CONDITIONS: dict[int, Needs] = {
    **dict.fromkeys(Request, Needs.AUTO | Needs.NO_MODE),
    **dict.fromkeys((Request.STATUS, Request.FORMATS, Request.MESSAGES), Needs.NONE),
    **dict.fromkeys((Request.CONNECT, Request.JOINTS, Request.JOINTS_AT_REST), Needs.NO_MODE),
    **dict.fromkeys((Request.SET_POWER, Request.SET_WEIGHT, Request.SET_INERTIA), _CHECKED),
    Request.SET_MOTORS: _CHECKED | Needs.SAFE,
    Request.SET_OUTPUTS: Needs.AUTO | Needs.SAFE | Needs.NO_MODE,
    Request.SET_MODE: Needs.AUTO | Needs.CHECKED,  # and SAFE to enable it
    Request.MODE: Needs.AUTO,
    Request.MOVE: Needs.AUTO | Needs.CHECKED | Needs.SAFE | Needs.MODE,
}
del CONDITIONS[Request.STATUS_NOTICE], CONDITIONS[Request.JOINTS_NOTICE]

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


def required(request: int, low: int) -> Needs | None:
    """Return the conditions for accepting a request, or None if the request is unknown."""
    needs = CONDITIONS.get(request)
    return Needs.SAFE | needs if needs and request == Request.SET_MODE and low else needs


def refusal(needs: Needs, status: RtmcStatus, *, checked: bool, mode: bool) -> Refusal | None:
    """Return why a request is refused, or None.

    `checked`: whether the robot model is checked. `mode`: whether the motion mode is enabled.
    """
    unmet = (
        (Needs.AUTO, status.mode is not OperationMode.AUTO, Refusal.NOT_AUTO),
        (Needs.CHECKED, not checked, Refusal.MODEL_NOT_CHECKED),
        (Needs.SAFE, status.safeguard_open, Refusal.SAFEGUARD),
        (Needs.SAFE, status.estop, Refusal.ESTOP),
        (Needs.SAFE, status.error, Refusal.ERROR),
        (Needs.MODE, not mode, Refusal.MOTION_MODE),
        (Needs.NO_MODE, mode, Refusal.MOTION_MODE),
    )
    return next((why for need, missing, why in unmet if missing and need & needs), None)


def sentence(request: int, low: int) -> str:
    """Return the reason and the remedy of a refusal. `low`: low word of the reply."""
    reason, detail = low & 0xFF, low >> 8
    if reason in REMEDIES:
        return REMEDIES[Refusal(reason)]
    if reason == Refusal.EXECUTION:
        return DETAILS.get((request, detail), 'the request failed: see the error in RC+')
    return f'unknown reason {low:#06x}'
