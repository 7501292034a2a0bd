# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's condition: motors and E-stop, as one table.

The rules (SPEL+: motors, emergency stop, reset):

* It boots with the motors off. Only a person (or the remote port) switches them on.
* Motors off, or the motion client lost, while the motors are on: the arm brakes along its line,
  and at standstill the motors go off.
* The E-stop works in every condition. Back from it in three steps, in this order: release the
  button, reset, motors on. Until the reset it is latched. A reset never switches motors on.
* Asking for what is already so is no error.
"""

from enum import Enum


class Condition(Enum):
    """What the controller is in; the value is how it is called in sentences."""

    MOTORS_OFF = 'motors off'
    MOTORS_ON = 'motors on'
    STOPPING = 'braking, then motors off'
    ESTOP_PRESSED = 'E-stop pressed'
    ESTOP_LATCHED = 'E-stop released, not reset'


class Event(Enum):
    """What happens to the controller; the value is how it is called in sentences."""

    MOTORS_ON = 'motors on'
    MOTORS_OFF = 'motors off'
    CLIENT_LOST = 'motion client lost'
    STANDSTILL = 'standstill'
    ESTOP_PRESS = 'E-stop press'
    ESTOP_RELEASE = 'E-stop release'
    RESET = 'reset'


class RefusedError(Exception):
    """An event that the condition does not allow. The text says why and what to do."""


TRANSITIONS: dict[tuple[Condition, Event], Condition] = {
    (Condition.MOTORS_OFF, Event.MOTORS_ON): Condition.MOTORS_ON,
    (Condition.MOTORS_OFF, Event.MOTORS_OFF): Condition.MOTORS_OFF,
    (Condition.MOTORS_OFF, Event.CLIENT_LOST): Condition.MOTORS_OFF,
    (Condition.MOTORS_OFF, Event.ESTOP_PRESS): Condition.ESTOP_PRESSED,
    (Condition.MOTORS_OFF, Event.ESTOP_RELEASE): Condition.MOTORS_OFF,
    (Condition.MOTORS_OFF, Event.RESET): Condition.MOTORS_OFF,
    (Condition.MOTORS_ON, Event.MOTORS_ON): Condition.MOTORS_ON,
    (Condition.MOTORS_ON, Event.MOTORS_OFF): Condition.STOPPING,
    (Condition.MOTORS_ON, Event.CLIENT_LOST): Condition.STOPPING,
    (Condition.MOTORS_ON, Event.STANDSTILL): Condition.MOTORS_ON,
    (Condition.MOTORS_ON, Event.ESTOP_PRESS): Condition.ESTOP_PRESSED,
    (Condition.MOTORS_ON, Event.ESTOP_RELEASE): Condition.MOTORS_ON,
    (Condition.MOTORS_ON, Event.RESET): Condition.MOTORS_ON,
    (Condition.STOPPING, Event.MOTORS_OFF): Condition.STOPPING,
    (Condition.STOPPING, Event.CLIENT_LOST): Condition.STOPPING,
    (Condition.STOPPING, Event.STANDSTILL): Condition.MOTORS_OFF,
    (Condition.STOPPING, Event.ESTOP_PRESS): Condition.ESTOP_PRESSED,
    (Condition.STOPPING, Event.ESTOP_RELEASE): Condition.STOPPING,
    (Condition.STOPPING, Event.RESET): Condition.STOPPING,
    (Condition.ESTOP_PRESSED, Event.MOTORS_OFF): Condition.ESTOP_PRESSED,
    (Condition.ESTOP_PRESSED, Event.CLIENT_LOST): Condition.ESTOP_PRESSED,
    (Condition.ESTOP_PRESSED, Event.STANDSTILL): Condition.ESTOP_PRESSED,
    (Condition.ESTOP_PRESSED, Event.ESTOP_PRESS): Condition.ESTOP_PRESSED,
    (Condition.ESTOP_PRESSED, Event.ESTOP_RELEASE): Condition.ESTOP_LATCHED,
    (Condition.ESTOP_LATCHED, Event.MOTORS_OFF): Condition.ESTOP_LATCHED,
    (Condition.ESTOP_LATCHED, Event.CLIENT_LOST): Condition.ESTOP_LATCHED,
    (Condition.ESTOP_LATCHED, Event.STANDSTILL): Condition.ESTOP_LATCHED,
    (Condition.ESTOP_LATCHED, Event.ESTOP_PRESS): Condition.ESTOP_PRESSED,
    (Condition.ESTOP_LATCHED, Event.ESTOP_RELEASE): Condition.ESTOP_LATCHED,
    (Condition.ESTOP_LATCHED, Event.RESET): Condition.MOTORS_OFF,
}

REFUSALS: dict[tuple[Condition, Event], str] = {
    (Condition.MOTORS_OFF, Event.STANDSTILL): 'the arm stands still already',
    (Condition.STOPPING, Event.MOTORS_ON): (
        'the arm still brakes and the motors are going off: try again when it stands'
    ),
    (Condition.ESTOP_PRESSED, Event.MOTORS_ON): (
        'the E-stop is pressed: release the E-stop, then reset, then motors on'
    ),
    (Condition.ESTOP_PRESSED, Event.RESET): (
        'the E-stop is pressed: release the E-stop, then reset'
    ),
    (Condition.ESTOP_LATCHED, Event.MOTORS_ON): (
        'the E-stop is released but not reset: reset, then motors on'
    ),
}

ESTOP_CONDITIONS = frozenset({Condition.ESTOP_PRESSED, Condition.ESTOP_LATCHED})
POWERED_CONDITIONS = frozenset({Condition.MOTORS_ON, Condition.STOPPING})


def after(condition: Condition, event: Event) -> Condition:
    """Return the condition that `event` leads to. Raises RefusedError if it is not allowed."""
    following = TRANSITIONS.get((condition, event))
    if following is None:
        raise RefusedError(REFUSALS[condition, event])
    return following
