# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The STATUS of the controller, and the reasons why the condition permits no motion."""

from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection
from epson_driver.sim_controller.condition.states import (
    REGIONS,
    Condition,
    EStop,
    Fault,
    Mode,
    Motors,
    Tasks,
)
from epson_driver.simple_message import Mode as StatusMode
from epson_driver.simple_message import Status, TriState

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

_MODES = {Mode.AUTO: StatusMode.AUTO, Mode.MANUAL: StatusMode.MANUAL}


def motion_rejection(condition: Condition) -> Rejection | None:
    states = {getattr(condition, region) for region in REGIONS}
    return next((rejection for state, rejection in NO_MOTION.items() if state in states), None)


def status(
    condition: Condition,
    error: int,
    *,
    in_motion: bool,
    accepts_points: bool,
) -> Status:
    none = error == ErrorNumber.NONE
    possible = condition.tasks is Tasks.RUNNING and none and accepts_points
    return Status(
        drives_powered=_tri_state(condition.powered),
        e_stopped=_tri_state(condition.estopped),
        error_code=error,
        in_error=_tri_state(not none),
        in_motion=_tri_state(in_motion),
        mode=_MODES[condition.mode],
        motion_possible=_tri_state(possible),
    )


def _tri_state(value: bool) -> TriState:
    return TriState.TRUE if value else TriState.FALSE
