# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motors and errors by the controller's commands, mostly with a Motoman."""

import asyncio
import contextlib

import pytest
from support.driver_harness import Harness, ScriptedController, cell, frame, options_of, pose
from support.event_loop import until

from epson_driver.driver import arm_commands
from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.channel import make_motors
from epson_driver.driver.outcome import End
from epson_driver.driver.stopping.motors import (
    Action,
    MotomanMotors,
    MotorsByHand,
    MotorsError,
    RemoteEthernetMotors,
    RestartingMotors,
    SerializedMotors,
)
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.network.servers import Ports
from epson_driver.simple_message import MessageType, MotionCtrl, decode
from epson_driver.simple_message.motoman import Command, Result

MOTOMAN = options_of('motoman') | {'remote_port': 0}


def commands_in(controller):
    """Return a list that collects the commands received by the motion program."""
    commands = []
    take = controller.program.receive

    def receive(frame, *rest):
        message = decode(frame).message
        if isinstance(message, MotionCtrl):
            commands.append(Command(message.command))
        return take(frame, *rest)

    controller.program.receive = receive
    return commands


def others(commands):
    """Return the commands except STOP_MOTION, which ~/enable may repeat."""
    return [command for command in commands if command != Command.STOP_MOTION]


async def rejection(coroutine):
    with pytest.raises(CommandError) as caught:
        await coroutine
    return str(caught.value)


def reports(harness, **fields):
    status = harness.driver.robot.status
    return status is not None and all(getattr(status, k) == v for k, v in fields.items())


@pytest.mark.parametrize(
    ('kind', 'port', 'expected'),
    [
        ('remote_ethernet', 5000, RemoteEthernetMotors),
        ('remote_ethernet', 0, MotorsByHand),
        ('restart', 5000, RestartingMotors),
        ('restart', 0, MotorsByHand),
        ('motoman', 0, MotomanMotors),
        ('motoman', 5000, MotomanMotors),
        ('none', 5000, MotorsByHand),
    ],
)
def test_profile_and_remote_port_select_the_motors(kind, port, expected):
    motors = make_motors(kind, '127.0.0.1', port, None)
    assert type(motors) is expected
    assert bool(motors.missing) == (expected is MotorsByHand)


async def test_enable_and_disable_switch_motoman_servos():
    async with cell(profile='motoman', enabled=False, **MOTOMAN) as (harness, controller):
        commands = commands_in(controller)
        assert controller.status().drives_powered == 0
        assert await harness.commands.enable() == 'the arm is enabled'
        assert controller.status().drives_powered == 1
        assert others(commands) == [Command.START_SERVOS]
        outcome = await harness.submit(harness.at, harness.at + pose(0.1)).end()
        assert outcome.end is End.SUCCEEDED, outcome
        assert others(commands) == [Command.START_SERVOS, Command.START_TRAJ_MODE]
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        assert await harness.commands.disable() == 'the arm is disabled and the motors are off'
        assert 'disabled on request, the arm is at rest' in goal.outcome.text
        assert commands[-2:] == [Command.STOP_MOTION, Command.STOP_SERVOS]
        await until(lambda: reports(harness, drives_powered=0))
        assert harness.gate == 'disabled on request'
        await harness.commands.enable()
        outcome = await harness.submit(harness.at, harness.at + pose(0.1)).end()
        assert outcome.end is End.SUCCEEDED, outcome


async def test_reset_error_resets_the_alarm_of_a_motoman():
    async with cell(profile='motoman', enabled=False, **MOTOMAN) as (harness, controller):
        commands = commands_in(controller)
        await harness.commands.enable()
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: reports(harness, e_stopped=1))
        text = await rejection(harness.commands.reset_error())
        reason = 'RESET_ALARM: FAILURE: reset the error at the controller'
        assert text == f'the E-stop is not reset ({reason})'
        controller.apply(Event.ESTOP_RELEASE)
        await harness.commands.reset_error()
        assert others(commands) == [Command.START_SERVOS] + [Command.RESET_ALARM] * 2
        await until(lambda: reports(harness, e_stopped=0, in_error=0))
        assert 'E-stop' in harness.gate
        assert controller.status().drives_powered == 0
        await harness.commands.enable()
        assert harness.gate is None
        text = await rejection(Harness(Ports(1, 1, 0, 0), **MOTOMAN).commands.reset_error())
        assert 'RESET_ALARM: motion link is disconnected: reset the error at' in text


class ScriptedMotoman(ScriptedController):
    """Answers every command except STOP_MOTION with one result or not at all."""

    STATUS = (0, 0, 0, 0, 0, 2, 0)

    def __init__(self, result):
        super().__init__(lambda _: b'')
        self._result = result

    async def _motion(self, reader, writer):
        while True:
            length = int.from_bytes(await reader.readexactly(4), 'little')
            body = await reader.readexactly(length)
            command = int.from_bytes(body[20:24], 'little')
            self.received.append(command)
            result = Result.SUCCESS if command == Command.STOP_MOTION else self._result
            if result is not None:
                words = (0, 0, command, result, 0)
                reply = b''.join(word.to_bytes(4, 'little') for word in words) + bytes(40)
                writer.write(frame(MessageType.MOTION_REPLY, 3, 1, reply))


@pytest.mark.parametrize(
    ('result', 'words'),
    [(None, 'no reply within 0.1 s'), (Result.ALARM, 'ALARM: the controller has an alarm')],
)
async def test_gate_stays_closed_if_motoman_servos_stay_off(monkeypatch, result, words):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.1)

    async with (
        ScriptedMotoman(result) as scripted,
        Harness(scripted.ports, **MOTOMAN) as harness,
    ):
        await harness.ready()
        text = await rejection(harness.commands.enable())
        assert text == f'START_SERVOS: {words}: switch the motors on at the controller'
        assert scripted.received[0] == Command.STOP_MOTION
        assert others(scripted.received) == [Command.START_SERVOS]
        assert harness.gate is not None


async def test_controller_without_motor_commands_needs_manual_operation():
    async with cell(enabled=False, motors='none') as (harness, controller):
        text = await rejection(harness.commands.enable())
        assert 'does not support this command' in text
        assert Action.MOTORS_ON.value.by_hand in text
        assert harness.driver.motors._active is None  # its exception refers to the caller
        controller.apply(Event.MOTORS_ON)
        await until(lambda: reports(harness, drives_powered=1))
        await harness.commands.enable()
        text = await harness.commands.disable()
        assert text.endswith(
            'the motors are unchanged: the controller does not support this command'
        )


class Slow:
    """A controller that needs `timeout` for each command."""

    missing, restarts = '', False

    def __init__(self):
        self.started, self.ended = [], []

    async def act(self, action, timeout):
        self.started.append(action)
        try:
            await asyncio.sleep(timeout)
        except asyncio.CancelledError:
            self.ended.append('cancelled')
            raise
        self.ended.append(action)


@pytest.mark.invariant(4)
async def test_inv4_cancelled_command_is_completed_only_if_already_sent():
    slow = Slow()
    motors = SerializedMotors(slow)
    off = asyncio.create_task(motors.act(Action.MOTORS_OFF, 1.0))
    on = asyncio.create_task(motors.act(Action.MOTORS_ON, 1.0))
    await asyncio.sleep(0.1)
    for task in (off, on):
        task.cancel()
    await asyncio.sleep(5.0)
    assert slow.started == slow.ended == [Action.MOTORS_OFF]
    assert not motors.busy


@pytest.mark.invariant(4)
async def test_inv4_closing_cancels_sent_and_waiting_commands():
    slow = Slow()
    motors = SerializedMotors(slow)
    both = [
        asyncio.create_task(motors.act(action, 1.0))
        for action in (Action.MOTORS_OFF, Action.MOTORS_ON)
    ]
    await asyncio.sleep(0.1)
    await motors.close()
    assert slow.started == [Action.MOTORS_OFF]
    assert slow.ended == ['cancelled']
    assert not motors.busy
    for error in await asyncio.gather(*both, return_exceptions=True):
        assert isinstance(error, MotorsError)
        assert 'the driver has ended' in str(error)


@pytest.mark.invariant(3)
async def test_inv3_status_query_at_the_remote_port_is_preempted_by_motors_off():
    """The query could delay the command by 2 s."""
    queried, sent = asyncio.Event(), []

    @contextlib.asynccontextmanager
    async def login(_timeout):
        async def ask(command):
            if command == 'GetStatus':
                queried.set()
                await asyncio.Event().wait()  # a controller that does not answer
            sent.append(command)
            return ''

        yield ask

    motors = SerializedMotors(RemoteEthernetMotors('127.0.0.1', 5000, login=login))
    query = asyncio.create_task(motors.status(60.0))
    await queried.wait()
    await motors.act(Action.MOTORS_OFF, 2.0)
    assert sent == [Action.MOTORS_OFF.value.remote_ethernet]
    assert await query is None
