# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's condition as tables: motors, E-stop, door, tasks, errors, mode, power.

Each of these regions has a separate table. `after` applies an event to all regions together, or to
none. The rules (SPEL+ language reference; thesis chapter 3):

* The controller boots with the motors off, at low power. The motors are switched on only by the
  event "motors on", and by "continue" after the door has interrupted a motion. An operator or a
  client of the remote port requests both.
* After motors off, the loss of the motion client, or the key switch to MANUAL, the arm brakes
  along its path, and the motors switch off at standstill.
* The E-stop works in every condition. It cuts the motor power and aborts the Normal tasks.
  Recovery takes three steps in this order: release the button, reset, motors on.
* If the safeguard door is opened, the arm brakes, the motors switch off, and the Normal tasks
  pause. To recover, close the door and continue. The arm returns slowly to the position at which
  it was interrupted, then resumes.
* Pause brakes the arm on its path and pauses the Normal tasks. Continue resumes them.
* Stop ends the Normal tasks and their motion. Start runs them again.
* An error cuts the motor power and aborts the Normal tasks. It lasts until a reset, or if it is
  critical, until the controller is rebooted.
* Power is low after boot, motors on, reset and stop, while the motors are off and while the door
  is open. If the profile specifies it, the motion program selects high power for its trajectories,
  unless an operator has selected low power.
* An event that requests the current state is accepted and has no effect.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any


class Motors(Enum):
    """The servo power. The values are shown to users."""

    OFF = 'off'
    ON = 'on'
    BRAKING = 'braking, then off'
    HOLDING = 'braking for the door'
    HELD = 'off until continue'


class EStop(Enum):
    CLEAR = 'not active'
    PRESSED = 'pressed'
    LATCHED = 'released, not reset'


class Door(Enum):
    CLOSED = 'closed'
    OPEN = 'open'


class Tasks(Enum):
    """The Normal tasks: the motion server and the I/O server."""

    RUNNING = 'running'
    PAUSED = 'paused'
    INTERRUPTED = 'paused by the door'
    WAIT_RECOVER = 'waiting to continue after the door'
    RECOVERING = 'going back to where the door interrupted'
    STOPPED = 'stopped'
    ABORTED = 'aborted'


class Fault(Enum):
    """Errors of the controller itself. Rejected points do not count."""

    NONE = 'none'
    ERROR = 'error'
    CRITICAL = 'critical error'


class Mode(Enum):
    """The key switch."""

    AUTO = 'AUTO'
    MANUAL = 'MANUAL'


class Power(Enum):
    LOW = 'low'
    HIGH = 'high'
    HELD_LOW = 'low by choice'


class Event(Enum):
    """The events of the controller. The values are shown to users."""

    MOTORS_ON = 'motors on'
    MOTORS_OFF = 'motors off'
    CLIENT_LOST = 'motion client lost'
    STANDSTILL = 'standstill'
    ESTOP_PRESS = 'E-stop press'
    ESTOP_RELEASE = 'E-stop release'
    DOOR_OPEN = 'door open'
    DOOR_CLOSE = 'door close'
    PAUSE = 'pause'
    CONTINUE = 'continue'
    RECOVERED = 'recovered'
    STOP = 'stop'
    START = 'start'
    RESET = 'reset'
    ERROR = 'error'
    CRITICAL_ERROR = 'critical error'
    MODE_AUTO = 'mode auto'
    MODE_MANUAL = 'mode manual'
    POWER_HIGH = 'power high'
    POWER_LOW = 'power low'
    PROGRAM_POWER_HIGH = 'a trajectory begins'
    PROGRAM_POWER_LOW = 'the program sets the power low'
    TASKS_FINISHED = 'the tasks are over'
    BOOT = 'boot'


@dataclass(frozen=True, slots=True)
class Condition:
    motors: Motors = Motors.OFF
    estop: EStop = EStop.CLEAR
    door: Door = Door.CLOSED
    tasks: Tasks = Tasks.RUNNING
    fault: Fault = Fault.NONE
    mode: Mode = Mode.AUTO
    power: Power = Power.LOW

    @property
    def powered(self) -> bool:
        return self.motors in (Motors.ON, Motors.BRAKING, Motors.HOLDING)

    @property
    def estopped(self) -> bool:
        """Whether the E-stop is pressed, or has not been reset yet."""
        return self.estop is not EStop.CLEAR

    @property
    def paused(self) -> bool:
        """Whether the Normal tasks are paused until the event CONTINUE."""
        return self.tasks in (Tasks.PAUSED, Tasks.INTERRUPTED, Tasks.WAIT_RECOVER)


class RejectedError(Exception):
    """An event is not allowed in the current condition.

    The message gives the reason and the remedy.
    """


_E = Event

MOTORS: dict[tuple[Motors, Event], Motors] = {
    (Motors.OFF, _E.MOTORS_ON): Motors.ON,
    (Motors.ON, _E.DOOR_OPEN): Motors.HOLDING,
    (Motors.BRAKING, _E.STANDSTILL): Motors.OFF,
    (Motors.HOLDING, _E.STANDSTILL): Motors.HELD,
    (Motors.HELD, _E.CONTINUE): Motors.ON,
    **{
        (motors, event): outcome
        for motors, outcome in (
            (Motors.ON, Motors.BRAKING),
            (Motors.HOLDING, Motors.BRAKING),
            (Motors.HELD, Motors.OFF),
        )
        for event in (_E.MOTORS_OFF, _E.CLIENT_LOST, _E.MODE_MANUAL)
    },
    (Motors.HOLDING, _E.STOP): Motors.BRAKING,
    (Motors.HOLDING, _E.START): Motors.BRAKING,
    (Motors.HELD, _E.STOP): Motors.OFF,
    (Motors.HELD, _E.START): Motors.OFF,
    **{
        (motors, event): Motors.OFF
        for motors in (Motors.ON, Motors.BRAKING, Motors.HOLDING, Motors.HELD)
        for event in (_E.ESTOP_PRESS, _E.ERROR, _E.CRITICAL_ERROR, _E.BOOT)
    },
}

ESTOP: dict[tuple[EStop, Event], EStop] = {
    (EStop.CLEAR, _E.ESTOP_PRESS): EStop.PRESSED,
    (EStop.PRESSED, _E.ESTOP_RELEASE): EStop.LATCHED,
    (EStop.LATCHED, _E.ESTOP_PRESS): EStop.PRESSED,
    (EStop.LATCHED, _E.RESET): EStop.CLEAR,
    (EStop.LATCHED, _E.BOOT): EStop.CLEAR,
}

DOOR: dict[tuple[Door, Event], Door] = {
    (Door.CLOSED, _E.DOOR_OPEN): Door.OPEN,
    (Door.OPEN, _E.DOOR_CLOSE): Door.CLOSED,
}

ENDED = (Tasks.STOPPED, Tasks.ABORTED)
"""States in which the Normal tasks have ended. Further events that end tasks have no effect."""

TASKS: dict[tuple[Tasks, Event], Tasks] = {
    (Tasks.RUNNING, _E.PAUSE): Tasks.PAUSED,
    (Tasks.RUNNING, _E.DOOR_OPEN): Tasks.INTERRUPTED,
    (Tasks.PAUSED, _E.CONTINUE): Tasks.RUNNING,
    (Tasks.PAUSED, _E.DOOR_OPEN): Tasks.INTERRUPTED,
    (Tasks.INTERRUPTED, _E.DOOR_CLOSE): Tasks.WAIT_RECOVER,
    (Tasks.WAIT_RECOVER, _E.DOOR_OPEN): Tasks.INTERRUPTED,
    (Tasks.WAIT_RECOVER, _E.CONTINUE): Tasks.RECOVERING,
    (Tasks.RECOVERING, _E.RECOVERED): Tasks.RUNNING,
    (Tasks.RECOVERING, _E.PAUSE): Tasks.WAIT_RECOVER,
    (Tasks.RECOVERING, _E.DOOR_OPEN): Tasks.INTERRUPTED,
    (Tasks.STOPPED, _E.START): Tasks.RUNNING,
    (Tasks.RUNNING, _E.TASKS_FINISHED): Tasks.STOPPED,
    (Tasks.ABORTED, _E.RESET): Tasks.RUNNING,
    **{
        (tasks, event): outcome
        for event, outcome in (
            (_E.STOP, Tasks.STOPPED),
            (_E.ESTOP_PRESS, Tasks.ABORTED),
            (_E.ERROR, Tasks.ABORTED),
            (_E.CRITICAL_ERROR, Tasks.ABORTED),
            (_E.BOOT, Tasks.RUNNING),
        )
        for tasks in Tasks
        if tasks is not outcome and (tasks not in ENDED or event is _E.BOOT)
    },
}

FAULT: dict[tuple[Fault, Event], Fault] = {
    (Fault.NONE, _E.ERROR): Fault.ERROR,
    (Fault.NONE, _E.CRITICAL_ERROR): Fault.CRITICAL,
    (Fault.ERROR, _E.CRITICAL_ERROR): Fault.CRITICAL,
    (Fault.ERROR, _E.RESET): Fault.NONE,
    (Fault.ERROR, _E.BOOT): Fault.NONE,
    (Fault.CRITICAL, _E.BOOT): Fault.NONE,
}

MODE: dict[tuple[Mode, Event], Mode] = {
    (Mode.AUTO, _E.MODE_MANUAL): Mode.MANUAL,
    (Mode.MANUAL, _E.MODE_AUTO): Mode.AUTO,
}

POWER: dict[tuple[Power, Event], Power] = {
    (Power.LOW, _E.POWER_HIGH): Power.HIGH,
    (Power.LOW, _E.PROGRAM_POWER_HIGH): Power.HIGH,
    (Power.LOW, _E.POWER_LOW): Power.HELD_LOW,
    (Power.HIGH, _E.POWER_LOW): Power.HELD_LOW,
    (Power.HIGH, _E.MOTORS_ON): Power.LOW,
    (Power.HIGH, _E.MOTORS_OFF): Power.LOW,
    (Power.HIGH, _E.DOOR_OPEN): Power.LOW,
    (Power.HIGH, _E.CLIENT_LOST): Power.LOW,
    (Power.HIGH, _E.ESTOP_PRESS): Power.LOW,
    (Power.HIGH, _E.ERROR): Power.LOW,
    (Power.HIGH, _E.CRITICAL_ERROR): Power.LOW,
    (Power.HIGH, _E.RESET): Power.LOW,
    (Power.HIGH, _E.STOP): Power.LOW,
    (Power.HIGH, _E.MODE_MANUAL): Power.LOW,
    (Power.HIGH, _E.BOOT): Power.LOW,
    (Power.HIGH, _E.PROGRAM_POWER_LOW): Power.LOW,
    (Power.HELD_LOW, _E.POWER_HIGH): Power.HIGH,
    (Power.HELD_LOW, _E.BOOT): Power.LOW,
}

Tables = Mapping[str, Mapping[tuple[Any, Event], Any]]

REGIONS: Tables = {
    'motors': MOTORS,
    'estop': ESTOP,
    'door': DOOR,
    'tasks': TASKS,
    'fault': FAULT,
    'mode': MODE,
    'power': POWER,
}
"""Region (field of `Condition`) → its table: (state, event) → next state."""

STARTED_BY_A_PERSON: Tables = {
    **REGIONS,
    'tasks': {**TASKS, (Tasks.ABORTED, _E.RESET): Tasks.STOPPED},
}
"""The tables for a SPEL+ program. Unlike the built-in program, a reset does not start it."""

NOTHING_LOADED: Tables = {
    **REGIONS,
    'motors': {**MOTORS, (Motors.ON, _E.DOOR_OPEN): Motors.BRAKING},
    'tasks': {},
}
"""The tables for a controller without a program, which has no tasks to pause or resume."""

REJECTIONS: dict[tuple[Event, Enum], str] = {
    (_E.MOTORS_ON, EStop.PRESSED): (
        'the E-stop is pressed: release the E-stop, then reset, then motors on'
    ),
    (_E.MOTORS_ON, EStop.LATCHED): ('the E-stop is released but not reset: reset, then motors on'),
    (_E.MOTORS_ON, Fault.ERROR): 'there is an error: reset, then motors on',
    (_E.MOTORS_ON, Fault.CRITICAL): 'there is a critical error: boot the controller again',
    (_E.MOTORS_ON, Door.OPEN): 'the safeguard door is open: close it first',
    (_E.MOTORS_ON, Mode.MANUAL): 'the key switch is at MANUAL: turn it to AUTO first',
    (_E.MOTORS_ON, Motors.BRAKING): (
        'the arm is still braking and the motors are going off: try again when it has stopped'
    ),
    (_E.MOTORS_ON, Motors.HELD): 'the door interrupted a motion: continue, or stop and start',
    (_E.RESET, EStop.PRESSED): 'the E-stop is pressed: release the E-stop, then reset',
    (_E.RESET, Fault.CRITICAL): 'there is a critical error: boot the controller again',
    (_E.RESET, Tasks.RECOVERING): 'the arm is returning: try again when it has arrived',
    (_E.RESET, Tasks.PAUSED): 'the tasks are paused: continue, or stop, first',
    (_E.RESET, Tasks.INTERRUPTED): 'the tasks are paused: close the door and continue, or stop',
    (_E.RESET, Tasks.WAIT_RECOVER): 'the tasks are paused: continue, or stop, first',
    (_E.PAUSE, Tasks.STOPPED): 'the tasks are stopped: nothing to pause',
    (_E.PAUSE, Tasks.ABORTED): 'the tasks are aborted: nothing to pause',
    (_E.CONTINUE, Tasks.RUNNING): 'nothing is paused',
    (_E.CONTINUE, Tasks.INTERRUPTED): 'the safeguard door is open: close it, then continue',
    (_E.CONTINUE, Tasks.RECOVERING): 'the arm is already returning',
    (_E.CONTINUE, Tasks.STOPPED): 'the tasks are stopped: start them',
    (_E.CONTINUE, Tasks.ABORTED): 'the tasks are aborted: reset',
    (_E.CONTINUE, Motors.HOLDING): 'the arm is still braking: try again when it has stopped',
    (_E.CONTINUE, Mode.MANUAL): 'the key switch is at MANUAL: turn it to AUTO first',
    (_E.START, Tasks.PAUSED): 'the tasks are paused: continue, or stop, first',
    (_E.START, Tasks.INTERRUPTED): 'the tasks are paused: close the door and continue, or stop',
    (_E.START, Tasks.WAIT_RECOVER): 'the tasks are paused: continue, or stop, first',
    (_E.START, Tasks.ABORTED): 'the tasks are aborted: reset, which starts them again',
    (_E.START, Door.OPEN): 'the safeguard door is open: close it first',
    (_E.START, Mode.MANUAL): 'the key switch is at MANUAL: turn it to AUTO first',
    (_E.POWER_HIGH, Door.OPEN): 'the safeguard door is open: power stays low',
    (_E.POWER_HIGH, Motors.HELD): 'the door interrupted a motion: power is low until continue',
    (_E.POWER_HIGH, Motors.OFF): 'the motors are off: power is low until they are on',
    (_E.POWER_HIGH, Mode.MANUAL): 'the key switch is at MANUAL: power stays low',
    (_E.PROGRAM_POWER_HIGH, Mode.MANUAL): 'the key switch is at MANUAL: power stays low',
}
"""(event, state that forbids the event) → message. The first match is reported."""


def after(condition: Condition, event: Event, tables: Tables = REGIONS) -> Condition:
    """Return the condition after `event`. Raises RejectedError if the event is not allowed."""
    states = {getattr(condition, region) for region in REGIONS}
    for (refused, state), sentence in REJECTIONS.items():
        if refused is event and state in states:
            raise RejectedError(sentence)
    changes = {}
    for region, table in tables.items():
        state = getattr(condition, region)
        following = table.get((state, event), state)
        if following is not state:
            changes[region] = following
    return replace(condition, **changes) if changes else condition


if {field.name for field in fields(Condition)} != set(REGIONS):
    raise TypeError('every field of Condition must have a table in REGIONS')
