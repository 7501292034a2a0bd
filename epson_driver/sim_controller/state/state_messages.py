# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the state port tells of the controller, and why a point is refused: two views of one."""

from typing import TYPE_CHECKING

from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection
from epson_driver.sim_controller.condition.states import REGIONS, EStop, Fault, Mode, Motors, Tasks
from epson_driver.simple_message import (
    JointFeedback,
    JointPosition,
    Status,
    TriState,
    ValidFields,
    joint_data,
)
from epson_driver.simple_message import Mode as StatusMode

if TYPE_CHECKING:
    from epson_driver.sim_controller.core import Controller

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
"""Why a point is refused, the first that applies; points that come in a pause wait."""

_MODES = {Mode.AUTO: StatusMode.AUTO, Mode.MANUAL: StatusMode.MANUAL}


def motion_rejection(controller: 'Controller') -> Rejection | None:
    """Return why the controller's condition forbids motion, or None."""
    states = {getattr(controller.condition, region) for region in REGIONS}
    return next((rejection for state, rejection in NO_MOTION.items() if state in states), None)


def joint_position(controller: 'Controller') -> JointPosition:
    """Return where the encoders say that the joints are."""
    return JointPosition(0, joint_data(controller.servo.position.tolist()))


def joint_feedback(controller: 'Controller') -> JointFeedback:
    """Return where the joints are and how fast, with the controller's time."""
    return JointFeedback(
        0,
        ValidFields.TIME | ValidFields.POSITION | ValidFields.VELOCITY,
        controller.clock.now,
        joint_data(controller.servo.position.tolist()),
        joint_data(controller.servo.velocity.tolist()),
    )


def status(controller: 'Controller') -> Status:
    """Return the controller's status; what its profile does not tell is UNKNOWN."""
    condition, told = controller.condition, controller.profile.state
    error = controller.error_number
    none = error is ErrorNumber.NONE
    runs = condition.tasks is Tasks.RUNNING
    possible = runs and none and controller.motion_rejection() is None
    return Status(
        drives_powered=_tri_state(condition.powered),
        e_stopped=_tri_state(condition.estopped),
        error_code=error,
        in_error=_tri_state(not none),
        in_motion=_tri_state(controller.in_motion) if told.in_motion else TriState.UNKNOWN,
        mode=_MODES[condition.mode],
        motion_possible=_tri_state(possible) if told.motion_possible else TriState.UNKNOWN,
    )


def _tri_state(value: bool) -> TriState:
    return TriState.TRUE if value else TriState.FALSE
