# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every bit of the status words and every flag, set and not set."""

from types import SimpleNamespace

import pytest
from support.controller_harness import Harness, point

from epson_driver.sim_controller.condition.states import (
    Condition,
    Door,
    EStop,
    Fault,
    Mode,
    Motors,
    Power,
    Tasks,
)
from epson_driver.sim_controller.remote import status_words


def controller(moving=False, in_motion=None, error=0, spel=False, **regions):
    condition = Condition(**regions)
    return SimpleNamespace(
        condition=condition,
        task_state=lambda task: task.state(condition),
        moving=moving,
        in_motion=moving if in_motion is None else in_motion,
        error_number=error,
        program=SimpleNamespace(runs=spel),
    )


IDLE = controller()
MOVING = controller(moving=True, motors=Motors.ON, power=Power.HIGH)
PAUSED = controller(moving=True, in_motion=False, motors=Motors.ON, tasks=Tasks.PAUSED)
PAUSING = controller(moving=True, motors=Motors.ON, tasks=Tasks.PAUSED)
DOOR_OPEN = controller(door=Door.OPEN, tasks=Tasks.INTERRUPTED)
WAIT_RECOVER = controller(tasks=Tasks.WAIT_RECOVER)
RECOVERING = controller(tasks=Tasks.RECOVERING, motors=Motors.ON)
PRESSED = controller(error=2261, estop=EStop.PRESSED, tasks=Tasks.ABORTED)
LATCHED = controller(error=2261, estop=EStop.LATCHED, tasks=Tasks.ABORTED)
REFUSED = controller(error=4031)
ERROR = controller(error=5042, fault=Fault.ERROR, tasks=Tasks.ABORTED)
CRITICAL = controller(error=5042, fault=Fault.CRITICAL, tasks=Tasks.ABORTED)
MANUAL = controller(mode=Mode.MANUAL)
STOPPED = controller(tasks=Tasks.STOPPED)
HIGH = controller(power=Power.HIGH)
HELD_LOW = controller(power=Power.HELD_LOW)
SPEL_RUNS = controller(spel=True)
SPEL_SERVER_RUNS = controller(spel=True, tasks=Tasks.ABORTED)
SPEL_PAUSED = controller(spel=True, tasks=Tasks.PAUSED)
SPEL_LAST_MOVE = controller(moving=True, motors=Motors.ON, tasks=Tasks.STOPPED)
BRAKING = controller(moving=True, motors=Motors.BRAKING)

NEVER = ()
ALL = (IDLE, MOVING, PAUSED, DOOR_OPEN, RECOVERING, PRESSED, ERROR, CRITICAL, MANUAL, STOPPED)

FLAGS = {
    'Test': (NEVER, ALL),
    'Teach': ((MANUAL,), (IDLE, PRESSED)),
    'Auto': ((IDLE, PRESSED), (MANUAL,)),
    'Warning': (NEVER, ALL),
    'SError': ((CRITICAL,), (ERROR, PRESSED, IDLE)),
    'Safeguard': ((DOOR_OPEN,), (WAIT_RECOVER, IDLE)),
    'EStop': ((PRESSED, LATCHED), (IDLE, ERROR)),
    'Error': ((PRESSED, LATCHED, REFUSED, ERROR, CRITICAL), (IDLE, MOVING, DOOR_OPEN)),
    'Paused': ((PAUSED, PAUSING, DOOR_OPEN, WAIT_RECOVER), (IDLE, MOVING, RECOVERING, STOPPED)),
    'Running': (
        (MOVING, RECOVERING, BRAKING, SPEL_RUNS, SPEL_SERVER_RUNS, SPEL_LAST_MOVE),
        (IDLE, PAUSED, PAUSING, DOOR_OPEN, PRESSED, SPEL_PAUSED),
    ),
    'Ready': (
        (IDLE, PRESSED, ERROR, MANUAL, STOPPED),
        (MOVING, PAUSED, DOOR_OPEN, RECOVERING, SPEL_RUNS, SPEL_SERVER_RUNS, SPEL_PAUSED),
    ),
}

CTRL_INFO_1 = {
    0x1: FLAGS['Ready'],
    0x2: FLAGS['Running'],
    0x4: FLAGS['Paused'],
    0x100: FLAGS['EStop'],
    0x200: FLAGS['Safeguard'],
    0x400: FLAGS['Error'],
    0x800: FLAGS['SError'],
    0x1000: (NEVER, ALL),
    0x2000: ((WAIT_RECOVER,), (DOOR_OPEN, RECOVERING, IDLE)),
    0x4000: ((RECOVERING,), (WAIT_RECOVER, IDLE)),
}

CTRL_INFO_7 = {0x1: ((IDLE,), (MANUAL,))}

ROBOT_INFO_0 = {
    0x2: ((REFUSED, ERROR, PRESSED), (CRITICAL, IDLE)),
    0x4: ((CRITICAL,), (ERROR, IDLE)),
    0x8: ((MOVING, PAUSED, BRAKING), (IDLE, PRESSED)),
    0x10: ((HIGH,), (IDLE, HELD_LOW)),
    0x100: ((IDLE, DOOR_OPEN), (MOVING, PAUSED)),
    0x200: ((MOVING, PAUSED, BRAKING), (IDLE,)),
    0x400: ((PAUSED, DOOR_OPEN, WAIT_RECOVER), (PAUSING, MOVING, IDLE)),
    0x4000: (NEVER, ALL),
}

NORMAL = ((IDLE, PAUSED, DOOR_OPEN), (STOPPED, PRESSED, ERROR))
STAT_0 = {
    0x1: NORMAL,  # motion server
    0x2: (ALL, NEVER),  # state server
    0x4: NORMAL,  # I/O server
    **{1 << bit: (NEVER, ALL) for bit in range(3, 16)},
    0x10000: FLAGS['Running'],
    0x20000: FLAGS['Paused'],
    0x40000: FLAGS['Error'],
    0x80000: FLAGS['Teach'],
    0x100000: FLAGS['EStop'],
    0x200000: ((IDLE, HELD_LOW), (HIGH,)),
    0x400000: ((IDLE, WAIT_RECOVER), (DOOR_OPEN,)),
    0x800000: (NEVER, ALL),
}

STAT_1 = {0x10: ((MOVING, PAUSED, BRAKING), (IDLE, PRESSED))}

WORDS = {
    'CtrlInfo(1)': (status_words.CTRL_INFO_1, CTRL_INFO_1),
    'CtrlInfo(7)': (status_words.CTRL_INFO_7, CTRL_INFO_7),
    'RobotInfo(0)': (status_words.ROBOT_INFO_0, ROBOT_INFO_0),
    'Stat(0)': (status_words.STAT_0, STAT_0),
    'Stat(1)': (status_words.STAT_1, STAT_1),
    'GetStatus': (status_words.FLAGS, FLAGS),
}


def test_flags_are_in_the_order_of_the_manual():
    assert ' '.join(status_words.FLAGS) == (
        'Test Teach Auto Warning SError Safeguard EStop Error Paused Running Ready'
    )


@pytest.mark.parametrize('name', WORDS)
def test_every_status_bit_has_a_test(name):
    table, expected = WORDS[name]
    assert list(table) == list(expected)


@pytest.mark.parametrize(
    ('name', 'bit'), [(name, bit) for name, (_, expected) in WORDS.items() for bit in expected]
)
def test_bit_is_set_in_the_expected_conditions_only(name, bit):
    table, expected = WORDS[name]
    yes, no = expected[bit]
    assert [table[bit](item) for item in yes] == [True] * len(yes)
    assert [table[bit](item) for item in no] == [False] * len(no)


def test_word_is_the_sum_of_its_bits():
    assert status_words.word(status_words.CTRL_INFO_1, IDLE) == 0x1
    assert status_words.word(status_words.CTRL_INFO_1, PRESSED) == 0x1 | 0x100 | 0x400
    assert status_words.word(status_words.CTRL_INFO_1, DOOR_OPEN) == 0x4 | 0x200
    assert status_words.word(status_words.ROBOT_INFO_0, MOVING) == 0x8 | 0x10 | 0x200
    assert status_words.word(status_words.STAT_0, IDLE) == 0x7 | 0x200000 | 0x400000
    assert status_words.flags(IDLE) == '00100000001'
    assert status_words.flags(MANUAL) == '01000000001'


def test_status_words_follow_motion_pause_door_and_estop():
    harness = Harness()

    def words():
        answers = harness.remote('Sim,print,CtrlInfo(1),RobotInfo(0),Stat(1)', 'GetStatus')
        word, status = (answer.partition(',')[2] for answer in answers)
        return tuple(hex(int(value)) for value in word.split()), status

    assert words() == (('0x1', '0x108', '0x10'), '00100000001,0000')
    harness.send(point(0, (1.0,), 0.1))
    harness.step(0.2)
    assert words() == (('0x2', '0x218', '0x10'), '00100000010,0000')
    harness.do('pause')
    harness.rest()
    assert words() == (('0x4', '0x618', '0x10'), '00100000100,0000')
    harness.do('continue')
    harness.step(0.2)
    harness.do('door open')
    harness.rest()
    assert words() == (('0x204', '0x600', '0x0'), '00100100100,0000')
    harness.do('door close')
    assert words() == (('0x2004', '0x600', '0x0'), '00100000100,0000')
    harness.do('continue')
    assert words()[0][0] in ('0x4002', '0x2')  # it may have arrived already
    harness.do('E-stop press')
    harness.rest()
    assert words() == (('0x501', '0x102', '0x0'), '00100011001,2261')
