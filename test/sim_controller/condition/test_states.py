# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tables of the controller's condition, tested by sequences of events.

A step of a story is `event: changes`. All other values must stay unchanged. `event! words` is
refused with a sentence that contains the words.
"""

from functools import cache

import pytest

from epson_driver.sim_controller.condition import states
from epson_driver.sim_controller.condition.states import (
    REGIONS,
    Condition,
    Event,
    RejectedError,
    after,
)
from epson_driver.sim_controller.condition.tasks import (
    IO_SERVER,
    MOTION_SERVER,
    PROGRAM,
    STATE_SERVER,
)
from epson_driver.spel import TaskState, TaskType

STORIES = {
    'motors': """
        motors off:
        motors on: motors=ON
        standstill:
        motors off: motors=BRAKING
        motors on! still braking
        motors off:""",
    'E-stop with the motors on': """
        E-stop press: motors=OFF estop=PRESSED tasks=ABORTED
        motors on! release the E-stop, then reset
        reset! release the E-stop
        standstill:
        motion client lost:
        E-stop release: estop=LATCHED
        motors on! reset, then motors on
        E-stop press: estop=PRESSED
        E-stop release: estop=LATCHED
        E-stop release:""",
    'door': """
        door close:
        motors on: motors=ON
        power high: power=HIGH
        door open: motors=HOLDING door=OPEN tasks=INTERRUPTED power=LOW
        power high! door is open
        continue! close it, then continue
        motors on! door is open
        standstill: motors=HELD
        pause:
        reset! close the door and continue
        start! close the door and continue
        door close: door=CLOSED tasks=WAIT_RECOVER
        power high! low until continue
        motors on! continue, or stop
        reset! continue, or stop
        start! continue, or stop
        door open: door=OPEN tasks=INTERRUPTED
        door close: door=CLOSED tasks=WAIT_RECOVER
        continue: motors=ON tasks=RECOVERING
        continue! already returning
        reset! try again when it has arrived
        recovered: tasks=RUNNING
        continue! nothing is paused""",
    'door opened again during the return': """
        motors on: motors=ON
        door open: motors=HOLDING door=OPEN tasks=INTERRUPTED
        door close: door=CLOSED tasks=WAIT_RECOVER
        continue! still braking
        standstill: motors=HELD
        continue: motors=ON tasks=RECOVERING
        door open: motors=HOLDING door=OPEN tasks=INTERRUPTED""",
    'pause during the return': """
        motors on: motors=ON
        door open: motors=HOLDING door=OPEN tasks=INTERRUPTED
        standstill: motors=HELD
        door close: door=CLOSED tasks=WAIT_RECOVER
        continue: motors=ON tasks=RECOVERING
        pause: tasks=WAIT_RECOVER""",
    'door with the motors off': """
        door open: door=OPEN tasks=INTERRUPTED
        door close: door=CLOSED tasks=WAIT_RECOVER
        continue: tasks=RECOVERING
        recovered: tasks=RUNNING""",
    'pause': """
        motors on: motors=ON
        pause: tasks=PAUSED
        pause:
        reset! continue, or stop
        start! continue, or stop
        continue: tasks=RUNNING
        pause: tasks=PAUSED
        door open: motors=HOLDING door=OPEN tasks=INTERRUPTED""",
    'stop and start': """
        motors on: motors=ON
        power high: power=HIGH
        stop: tasks=STOPPED power=LOW
        stop:
        pause! nothing to pause
        continue! start them
        E-stop press: motors=OFF estop=PRESSED
        E-stop release: estop=LATCHED
        reset: estop=CLEAR
        start: tasks=RUNNING
        start:""",
    'start requires a closed door': """
        stop: tasks=STOPPED
        door open: door=OPEN
        start! door is open""",
    'start releases motors held by the door': """
        motors on: motors=ON
        stop: tasks=STOPPED
        door open: motors=HOLDING door=OPEN
        door close: door=CLOSED
        start: motors=BRAKING tasks=RUNNING
        standstill: motors=OFF
        motors on: motors=ON
        stop: tasks=STOPPED
        door open: motors=HOLDING door=OPEN
        standstill: motors=HELD
        door close: door=CLOSED
        start: motors=OFF tasks=RUNNING""",
    'error': """
        motors on: motors=ON
        error: motors=OFF tasks=ABORTED fault=ERROR
        motors on! reset, then motors on
        pause! nothing to pause
        continue! aborted: reset
        start! aborted: reset
        stop:
        reset: tasks=RUNNING fault=NONE
        critical error: tasks=ABORTED fault=CRITICAL
        motors on! boot the controller
        reset! boot the controller
        error:""",
    'mode': """
        mode auto:
        motors on: motors=ON
        power high: power=HIGH
        mode manual: mode=MANUAL motors=BRAKING power=LOW
        motors on! AUTO first
        power high! power stays low
        a trajectory begins! power stays low
        mode manual:
        standstill: motors=OFF
        pause: tasks=PAUSED
        continue! AUTO first
        stop: tasks=STOPPED
        start! AUTO first
        mode auto: mode=AUTO""",
    'a SPEL+ program that ends': """
        motors on: motors=ON
        the tasks are over: tasks=STOPPED
        the tasks are over:
        start: tasks=RUNNING
        E-stop press: estop=PRESSED motors=OFF tasks=ABORTED
        the tasks are over:""",
    'a SPEL+ program that sets the power low': """
        motors on: motors=ON
        a trajectory begins: power=HIGH
        the program sets the power low: power=LOW
        power low: power=HELD_LOW
        the program sets the power low:""",
    'power': """
        power high! until they are on
        power low: power=HELD_LOW
        power low:
        a trajectory begins:
        motors on: motors=ON
        reset:
        power high: power=HIGH
        power high:
        a trajectory begins:
        reset: power=LOW
        a trajectory begins: power=HIGH
        motors on: power=LOW
        power high: power=HIGH
        power low: power=HELD_LOW
        boot: power=LOW motors=OFF""",
}


def play(story):
    """Apply the events of a story after a boot and assert each step."""
    condition = Condition()
    for step in filter(None, map(str.strip, story.splitlines())):
        name, refused, words = step.partition('!')
        if refused:
            assert words.strip() in rejection(condition, Event(name)), step
            continue
        name, _, changes = step.partition(':')
        expected = {field: getattr(condition, field).name for field in REGIONS}
        expected |= dict(change.split('=') for change in changes.split())
        try:
            condition = after(condition, Event(name))
        except RejectedError as error:
            raise AssertionError(f'{step}: {error}') from error
        assert {field: getattr(condition, field).name for field in REGIONS} == expected, step


def rejection(condition, event):
    """Return the text of the rejection of an event, or an empty string."""
    try:
        after(condition, event)
    except RejectedError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('story', STORIES)
def test_sequence_of_events_has_its_documented_result(story):
    play(STORIES[story])


@cache
def reachable():
    """Return every condition that events can reach."""
    result, new = set(), {Condition()}
    while new:
        result |= new
        following = set()
        for condition in new:
            for event in Event:
                try:
                    following.add(after(condition, event))
                except RejectedError:
                    continue
        new = following - result
    return result


FAULTS = (Event.ESTOP_PRESS, Event.ERROR, Event.CRITICAL_ERROR)
SWITCHED_OFF = (Event.MOTORS_OFF, Event.CLIENT_LOST, Event.MODE_MANUAL)
BRAKES = {states.Motors.HOLDING: states.Motors.BRAKING, states.Motors.HELD: states.Motors.OFF}
"""Result of a fault for motors that the open door holds."""


@pytest.mark.parametrize('event', [*FAULTS, *SWITCHED_OFF, Event.STOP, Event.BOOT])
@pytest.mark.invariant(3, 4)
def test_event_that_ends_a_motion_ends_it_in_every_condition(event):
    for before in reachable():
        then = after(before, event)
        running = before.tasks not in (states.Tasks.STOPPED, states.Tasks.ABORTED)
        tasks, motors = before.tasks, BRAKES.get(before.motors, before.motors)
        if event is Event.BOOT:
            tasks, motors = states.Tasks.RUNNING, states.Motors.OFF
            assert then.fault is states.Fault.NONE
            assert (then.estop is states.EStop.CLEAR) == (before.estop is not states.EStop.PRESSED)
        elif event in FAULTS:
            tasks, motors = states.Tasks.ABORTED if running else tasks, states.Motors.OFF
        elif event is Event.STOP:
            tasks = states.Tasks.STOPPED if running else tasks
        elif before.motors is states.Motors.ON:
            motors = states.Motors.BRAKING
        assert (then.tasks, then.motors) == (tasks, motors)
        assert then.power is not states.Power.HIGH
    if event in FAULTS[1:]:
        wanted = 'ERROR' if event is Event.ERROR else 'CRITICAL'
        assert after(Condition(), event).fault.name == wanted


@pytest.mark.invariant(4)
def test_inv4_no_event_but_motors_on_and_continue_powers_the_motors():
    conditions = reachable()
    assert len(conditions) > 100
    for condition in conditions:
        for event in Event:
            try:
                then = after(condition, event)
            except RejectedError:
                continue
            if then.motors is states.Motors.ON and condition.motors is not states.Motors.ON:
                assert event in (Event.MOTORS_ON, Event.CONTINUE)
                if event is Event.CONTINUE:
                    assert condition.motors is states.Motors.HELD
                    assert condition.tasks is states.Tasks.WAIT_RECOVER


def test_motors_are_off_with_estop_open_door_error_or_manual_and_power_is_low_in_manual():
    for condition in reachable():
        assert condition.mode is states.Mode.AUTO or condition.power is not states.Power.HIGH
        if condition.motors is states.Motors.ON:
            assert condition.estop is states.EStop.CLEAR
            assert condition.door is states.Door.CLOSED
            assert condition.fault is states.Fault.NONE
            assert condition.mode is states.Mode.AUTO


def test_the_state_server_runs_in_every_condition():
    assert [task.type for task in PROGRAM] == [
        TaskType.NORMAL,
        TaskType.NO_EMG_ABORT,
        TaskType.NORMAL,
    ]
    for condition in reachable():
        assert STATE_SERVER.state(condition) is TaskState.RUNNING
        ended = condition.tasks in (states.Tasks.STOPPED, states.Tasks.ABORTED)
        halted = condition.paused or condition.tasks is states.Tasks.RECOVERING
        for task in (MOTION_SERVER, IO_SERVER):
            assert (task.state(condition) is TaskState.HALTED) is halted
            assert (task.state(condition) in (TaskState.NOT_RUNNING, TaskState.ABORTED)) is ended
