# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motors, reset and start with a running SPEL+ program: Stop, Ready, the command, Start."""

import asyncio
import contextlib
from functools import partial

import numpy as np
import pytest
from support.driver_harness import Harness, plan_in_real_time, pose, simulated
from support.event_loop import run as run_in
from support.event_loop import until

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.outcome import End
from epson_driver.driver.smoothing import Smoothing
from epson_driver.driver.stopping.motors import Action, MotorsError, RestartingMotors
from epson_driver.profiles import load_controller_profile
from epson_driver.remote_ethernet.client import execute
from epson_driver.sim_controller.condition.states import Event

PROFILE = load_controller_profile('spel')
PATIENCE = 60.0

# virtual time, because it jumps while the smoother's process starts and ends
run = partial(run_in, patience=3600.0)


@pytest.fixture(autouse=True)
def plans(monkeypatch):
    plan_in_real_time(monkeypatch)


@contextlib.asynccontextmanager
async def spel_cell(motors=PROFILE.program.motors, **options):
    """Run the project's SPEL+ program on a simulated controller with a driver for its profile."""
    smoothing = Smoothing(PROFILE.program.resample_period, thin=True)
    async with (
        simulated(profile=PROFILE) as (controller, ports),
        Harness(ports, motors=motors, smoothing=smoothing, **options) as harness,
    ):
        await harness.ready()
        yield harness, controller, ports


async def assert_moves(harness):
    outcome = await harness.submit(harness.at + pose(0.1)).end()
    assert outcome.end is End.SUCCEEDED, outcome


def status(harness, **fields):
    seen = harness.driver.robot.status
    return seen is not None and all(getattr(seen, name) == value for name, value in fields.items())


async def do(ports, *commands):
    return await execute('127.0.0.1', ports.remote, commands, PATIENCE)


async def test_enable_switches_the_motors_on_and_starts_the_program():
    async with spel_cell() as (harness, controller, _):
        assert not controller.condition.powered
        assert await harness.commands.enable() == 'the arm is enabled'
        assert controller.condition.powered
        await assert_moves(harness)


@pytest.mark.invariant(4)
async def test_inv4_after_an_estop_only_enable_starts_the_program_without_old_points():
    async with spel_cell() as (harness, controller, _):
        await harness.commands.enable()
        goal = harness.submit(pose(1.5), step=6.0)
        await harness.until_moving()
        controller.apply(Event.ESTOP_PRESS)
        assert (await goal.end()).end is not End.SUCCEEDED
        await until(lambda: status(harness, e_stopped=1))
        with pytest.raises(CommandError, match='E-stop is pressed'):
            await harness.commands.enable()
        controller.apply(Event.ESTOP_RELEASE)
        await harness.commands.reset_error()
        await until(lambda: status(harness, e_stopped=0, in_error=0))
        rest = controller.arm.commanded.copy()
        assert [row for row in controller.tasks() if row.number == 1] == []
        assert harness.gate is not None
        await harness.commands.enable()
        assert await harness.rests()
        assert np.array_equal(controller.arm.commanded, rest)
        await assert_moves(harness)


@pytest.mark.slow
async def test_enable_starts_a_program_that_a_user_stopped():
    async with spel_cell() as (harness, controller, ports):
        await harness.commands.enable()
        await do(ports, 'Stop')
        await until(lambda: status(harness, motion_possible=0, drives_powered=1))
        outcome = await harness.submit(harness.at + pose(0.1)).end()
        assert outcome.end is not End.SUCCEEDED
        harness.driver.disable('a test')
        await harness.commands.enable()
        assert [row.state[:5] for row in controller.tasks() if row.number == 1] == ['waits']
        await assert_moves(harness)


@pytest.mark.slow
async def test_reset_stops_the_program_and_disables_the_arm():
    async with spel_cell() as (harness, controller, _):
        await harness.commands.enable()
        goal = harness.submit(pose(1.5), step=6.0)
        await harness.until_moving()
        await harness.commands.reset_error()
        assert (await goal.end()).end is not End.SUCCEEDED
        assert 'disabled by the reset' in harness.gate
        assert controller.condition.powered
        await harness.commands.enable()
        await assert_moves(harness)


@pytest.mark.slow
async def test_disable_stops_the_program_and_switches_the_motors_off():
    async with spel_cell() as (harness, controller, _):
        await harness.commands.enable()
        goal = harness.submit(pose(1.5), step=6.0)
        await harness.until_moving()
        assert await harness.commands.disable() == 'the arm is disabled and the motors are off'
        assert (await goal.end()).end is not End.SUCCEEDED
        assert not controller.condition.powered
        assert await harness.rests()


@pytest.mark.slow
@pytest.mark.invariant(4)
async def test_inv4_enable_of_an_enabled_arm_does_not_resume_a_paused_program():
    """A pause by a user ends by the user, and its goal is kept."""
    async with spel_cell() as (harness, controller, ports):
        await harness.commands.enable()
        goal = harness.submit(harness.at + pose(0.5), step=3.0)
        await harness.until_moving()
        await do(ports, 'Pause')
        await until(lambda: status(harness, motion_possible=0))
        text = await harness.commands.enable()
        assert 'the arm is enabled, but the controller is paused' in text
        assert controller.condition.paused
        await do(ports, 'Continue')
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome


async def test_enable_without_stop_fails_while_a_program_runs():
    """The controller is Running and therefore not Ready, like a real one."""
    async with spel_cell(motors='remote_ethernet') as (harness, _, ports):
        flags, _ = (await do(ports, 'GetStatus'))[0].split(',')
        assert flags[-2:] == '10'  # Running, not Ready
        with pytest.raises(CommandError, match='error 20'):
            await harness.commands.enable()
        await do(ports, 'Stop', 'SetMotorsOn,1', 'Start,0')
        assert await harness.commands.enable() == 'the arm is enabled'


class NeverReady:
    """A controller with a task that Stop does not end."""

    def __init__(self):
        self.received = []
        self._over = asyncio.Event()

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._serve, '127.0.0.1', 0)
        return self, self._server.sockets[0].getsockname()[1]

    async def __aexit__(self, *_):
        self._server.close()
        await self._over.wait()

    async def _serve(self, reader, writer):
        while line := await reader.readline():
            name = line.decode().strip()[1:]
            self.received.append(name)
            word = name.partition(',')[0]
            value = '00100000010,0000' if word == 'GetStatus' else '0'
            writer.write(f'#{word},{value}\r\n'.encode())
        writer.close()
        self._over.set()


async def test_command_is_not_sent_if_the_controller_does_not_become_ready():
    async with NeverReady() as (controller, port):
        motors = RestartingMotors('127.0.0.1', port)
        with pytest.raises(MotorsError, match='not Ready: the arm is still moving, or a task'):
            await motors.act(Action.MOTORS_ON, 1.0)
        assert controller.received[:3] == ['Login,', 'Stop', 'GetStatus']
        assert set(controller.received[3:]) <= {'GetStatus', 'Logout'}
