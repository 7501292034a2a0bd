# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every fault in the middle of a motion, on the controller of every profile.

Each cell of the matrix is one test, `fault-profile`. In each one the real driver moves the arm of
the simulated controller over TCP when the fault comes, and

* the goal ends once, as aborted, with its code and a sentence that names the cause;
* the arm gate closes, and a new goal is refused with the reason;
* when the fault is over, both links are there again, and the gate is closed still;
* nothing but STOP is sent, and the arm that has come to rest stays where it is, until `~/enable`;
* after what a person must do at the controller, and `~/enable`, a new goal succeeds.

What differs between faults is a row of FAULTS; what differs on a controller, of EXCEPTIONS.
"""

import asyncio
import contextlib
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.driver_harness import LIMITS, Harness, pose, simulated
from support.event_loop import run, until

from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal_settings import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.node.parameters import profile_defaults
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.faults.faults import parse
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, SpecialSequence, decode

PROFILES = ('rc620', 'rc700a', 'thesis', 'generic', 'fanuc', 'abb', 'motoman')
STATE_TIMEOUT = 0.4
REPLY_TIMEOUT = 0.4
LONG_CAUSE_TIME = 1.0
"""How long a goal waits for the STATUS that says why, s: as long as a busy machine may need."""

LONGEST = 7.0
"""How long one cell may take before it fails, s."""

QUIET = 0.25
"""How long the arm is watched before it is enabled, s."""

JOINT_1_END = 3.5
"""Where joint 1 cannot go, rad: the controller knows that, the driver is told otherwise."""

WIDER = replace(LIMITS, position_max=LIMITS.position_max + 1.0)

WAY = tuple(pose(0.15 * count, 0.05 * (count % 2)) for count in range(1, 9))
"""Points that take the arm a few seconds."""

ABORTED = ErrorCode.PATH_TOLERANCE_VIOLATED
"""The code of a goal that something forbids to go on."""


@dataclass(frozen=True)
class Row:
    """A fault: what happens, what is expected, and what a person does about it.

    events: what happens at the controller; fault: what its connections do, in the words of the
    pendant; clears: it is ended by the person. points: the goal's way; canceled: the goal is
    canceled in the same moment. text: a pattern for the outcome, gate: for the gate's reason.
    repair: what a person does at the controller, in this order, boots: before switching it off and
    on, because without that the links do not return; reset: then the error is reset.
    """

    events: tuple[Event, ...] = ()
    fault: str = ''
    points: tuple[np.ndarray, ...] = WAY
    canceled: bool = False
    code: ErrorCode = ABORTED
    text: str = ''
    gate: str = ''
    repair: tuple[Event, ...] = ()
    reset: bool = False
    boots: bool = False


LOST = 'the (state|motion) link was lost: .*(closed by the controller|reset)'

FAULTS = {
    'e_stop': Row(
        events=(Event.ESTOP_PRESS,),
        text='the E-stop is pressed or not reset',
        gate='the E-stop is pressed or not reset',
        repair=(Event.ESTOP_RELEASE,),
        reset=True,
    ),
    'motors_off': Row(
        events=(Event.MOTORS_OFF,),
        text='the motors are off|motors off',
        gate='the motors are off|the controller is in error',
        reset=True,
    ),
    'door': Row(
        events=(Event.DOOR_OPEN,),
        text='the motors are off',
        gate='the motors are off',
        repair=(Event.DOOR_CLOSE, Event.STOP, Event.START),
    ),
    'failure_reply': Row(  # a point of the goal is refused
        points=(*WAY[:2], pose(JOINT_1_END)),
        text=r'the controller refused point 3 of 4 \(FAILURE reply\): .*4001',
        gate='the controller is in error 4001',
        reset=True,
    ),
    'lost_reply': Row(
        fault='lost_reply count=1',
        text=r'no reply to point \d of 9: the arm has not moved for',
        gate='no reply to point',
    ),
    'silence': Row(
        fault=f'half_open for={STATE_TIMEOUT + 0.2}',
        text=f'the state link was lost: .*silent for {STATE_TIMEOUT} s',
        gate='the state link was lost',
    ),
    'cut': Row(fault='cut for=0.3', text=LOST, gate='link was lost'),
    'reboot': Row(fault='reboot for=0.3', text=LOST, gate='link was lost'),
    'wrong_byte_order': Row(
        fault='wrong_byte_order for=0.3',
        text='the (state|motion) link was lost: .*length',
        gate='link was lost',
    ),
}

IN_ERROR_4001 = 'the controller is in error 4001'
STOP_UNANSWERED = {
    'canceled': True,
    'text': 'the controller did not confirm the standstill within',
    'gate': 'the controller did not confirm the standstill within',
}

EXCEPTIONS = {
    # Its points are answered before the arm moves, or never: what can be lost is STOP's reply.
    ('lost_reply', 'abb'): STOP_UNANSWERED,
    ('lost_reply', 'motoman'): STOP_UNANSWERED,
    # A topic has no reply: STATUS alone tells.
    ('failure_reply', 'abb'): {'text': IN_ERROR_4001},
    # Its reply says why; STATUS shows no error.
    ('failure_reply', 'motoman'): {
        'text': r'refused point 3 of 4 \(INVALID: the message is wrong, 3012: a position\)',
        'gate': 'refused point 3 of 4',
    },
    # It says yes first, no when the point's turn comes, and closes the connection.
    ('failure_reply', 'fanuc'): {
        'text': '(refused|withdrew an acknowledgement before) point 3 of 4'
        '.*(4001|the motion link was lost)|the motion link was lost: .*closed by the controller',
        'gate': 'the controller is in error 4001|the motion link was lost',
    },
    # Its servers are dead when their client is gone or the tasks were aborted.
    **{
        (fault, 'thesis'): {'boots': True}
        for fault in (
            'e_stop',
            'motors_off',
            'door',
            'lost_reply',
            'silence',
            'cut',
            'wrong_byte_order',
        )
    },
    ('door', 'thesis'): {'repair': (Event.DOOR_CLOSE,), 'boots': True},
    # the last STOP leaves in the byte order of the fault, and comes when that is over
    ('wrong_byte_order', 'fanuc'): {'reset': True},
}

NOT_THERE = {('failure_reply', 'thesis'): 'its replies are always SUCCESS'}
"""Cells that cannot be, and why."""


def cells():
    """Return every fault with every profile, as pytest takes them."""
    for fault, row in FAULTS.items():
        for name in PROFILES:
            if (fault, name) in NOT_THERE:
                continue
            expected = replace(row, **EXCEPTIONS.get((fault, name), {}))
            yield pytest.param(fault, name, expected, id=f'{fault}-{name}')


@contextlib.asynccontextmanager
async def cell_of(profile):
    """Run a driver as the profile says, with its controller; yield both, and what is sent."""
    defaults = profile_defaults(profile)
    rules = delivery_rules(profile, defaults['interface'], defaults['point_message'])
    settings = GoalSettings(reply_timeout=REPLY_TIMEOUT, cause_timeout=LONG_CAUSE_TIME)
    async with simulated(profile=profile) as (controller, ports):
        options = {
            'delivery': rules,
            'usual_byte_order': profile.byte_order,
            'state_timeout': STATE_TIMEOUT,
            'settings': settings,
            'limits': WIDER,
        }
        if not profile.ports.remote:
            options['remote_port'] = 0
        async with Harness(ports, **options) as harness:
            sent = watch(controller)
            await harness.ready()
            yield harness, controller, sent


def watch(controller):
    """Return a list that fills with the points which the controller takes, STOP left out."""
    points = []
    take = controller.program.receive

    def receive(frame, *rest):
        message = decode(frame).message
        stop = getattr(message, 'sequence', None) == SpecialSequence.STOP_TRAJECTORY
        if isinstance(message, JointTrajPt | JointTrajPtFull) and not stop:
            points.append(message)
        return take(frame, *rest)

    controller.program.receive = receive
    return points


def where(controller):
    """Return where the arm is, rad: what its encoders would say without a fault."""
    return controller.servo.actual.copy()


async def person(controller, event):
    """Let a person do something at the controller, again and again until it is allowed."""
    async with asyncio.timeout(LONGEST / 2):
        while True:
            try:
                controller.apply(event)
            except RejectedError:
                await asyncio.sleep(0.02)
            else:
                return


async def make_ready(harness, controller, *, reset=False):
    """Reset and switch the motors on, by the driver's services where it has a remote port."""
    remote = harness.driver.configuration.remote_port
    if reset:
        await until(lambda: not controller.in_motion)
        if remote:
            await harness.commands.reset_error()
        else:
            await person(controller, Event.RESET)
    if not remote:
        await person(controller, Event.MOTORS_ON)
    await until(lambda: not remote or not controller.in_motion)
    if not remote or reset:
        await until(
            lambda: (
                (status := harness.driver.robot.status) is not None
                and status.in_error == 0
                and (remote or status.drives_powered == 1)
            )
        )


def linked(harness):
    """Return whether both links are there, with joints and a status."""
    driver = harness.driver
    return (
        driver.state_link.connected
        and driver.motion_link.connected
        and driver.robot.sample is not None
        and driver.robot.status is not None
    )


async def standing(controller):
    """Wait until the arm has come to rest, and so have its servos."""
    await until(lambda: not controller.in_motion)
    before = None
    while before is None or np.abs(before - where(controller)).max() > 1e-9:
        before = where(controller)
        await asyncio.sleep(0.05)


async def within(seconds, scenario):
    """Run a scenario; the line where it waits for ever is in the failure's traceback."""
    async with asyncio.timeout(seconds):
        await scenario


@pytest.mark.parametrize(('fault', 'name', 'row'), list(cells()))
def test_a_fault_in_the_middle_of_a_motion(record_property, fault, name, row):
    record_property('fault and profile', (fault, name))

    async def scenario():
        async with cell_of(load_controller_profile(name)) as (harness, controller, sent):
            await make_ready(harness, controller)
            await harness.commands.enable()

            goal = harness.submit(*row.points, step=0.4)
            begin = where(controller)
            await until(lambda: goal.outcomes or np.abs(where(controller) - begin).max() > 0.02)
            for event in row.events:
                controller.apply(event)
            if row.fault:
                controller.faults.start(parse(row.fault))
            if row.canceled:
                harness.driver.goal_queue.cancel(goal.handle)

            outcome = await goal.end()
            assert (outcome.end, outcome.code) == (End.ABORTED, row.code), outcome
            assert re.search(row.text, outcome.text), outcome.text
            points = len(sent)

            await until(lambda: harness.gate is not None)
            assert re.search(row.gate, harness.gate), harness.gate
            if harness.driver.robot.sample is not None:
                refused = harness.submit(harness.at).outcome
                assert refused.code is ErrorCode.INVALID_GOAL
                assert harness.gate in refused.text

            await until(lambda: not controller.faults.active())
            if not row.boots:
                await until(lambda: linked(harness))
            await standing(controller)
            stands = where(controller)
            for event in row.repair:
                await person(controller, event)
            if row.boots:
                controller.faults.start(parse('reboot for=0.2'))
                await until(lambda: not controller.faults.active() and linked(harness))
            await make_ready(harness, controller, reset=row.reset)
            await until(lambda: linked(harness))
            await asyncio.sleep(QUIET)
            assert harness.gate is not None
            assert np.abs(where(controller) - stands).max() < 1e-6
            assert len(sent) == points

            await harness.commands.enable()
            assert harness.gate is None
            again = harness.submit(harness.at + pose(0.0, 0.0, 0.1), step=0.3)
            assert (await again.end()).end is End.SUCCEEDED, again.outcome
            assert len(goal.outcomes) == 1

    run(within(LONGEST, scenario()))
