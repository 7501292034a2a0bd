# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Stops through the asynchronous and the synchronous API.

After each disturbance, the motion reports the cause, the arm comes to rest and stays disabled
until it is enabled, and the next motion succeeds.
"""

import asyncio
import threading

import numpy as np
import pytest
from support import sim_process
from support.api_harness import FAR, program, robot_cell
from support.api_patience import be_patient
from support.controller_harness import do
from support.driver_harness import simulated
from support.event_loop import run, until
from support.examples import one_in
from support.sim_process import wait_for

from epson_driver import Robot, RobotError, aio
from epson_driver.aio import MotionError
from epson_driver.api import motions
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse

HOME = [0.0] * 6
SLOW = 0.02
PATIENCE = 120.0


# --- asyncio, in virtual time -----------------------------------------------------------------

TROUBLE = {
    'E-stop': (lambda c: c.apply(Event.ESTOP_PRESS), 'E-stop is pressed'),
    'motors off': (lambda c: c.apply(Event.MOTORS_OFF), 'motors are off|refused'),
    'servo error': (lambda c: c.servo_error(0), 'error'),
    'motion link cut': (
        lambda c: c.faults.start(parse('cut port=motion for=0.5')),
        'motion link was lost',
    ),
    'state link cut': (
        lambda c: c.faults.start(parse('cut port=state for=0.5')),
        'state link was lost',
    ),
    'silence': (
        lambda c: c.faults.start(parse('half_open port=state for=3')),
        'no joint state for 1 s|no STATUS for 1 s|silent for 1 s',
    ),
}
"""Disturbances during a move, and a pattern of the motion's error."""


async def recover(robot, controller):
    """Clear the disturbance, reset if needed, and enable."""
    controller.faults.clear()
    if controller.condition.estopped:
        controller.apply(Event.ESTOP_RELEASE)
    await until(lambda: robot.status.connected and robot.status.motors_on is not None)
    await robot.catch_up()
    await until(lambda: not robot.status.moving)
    if robot.status.error is not None or robot.status.e_stopped:
        await robot.reset()
    await robot.enable()


@pytest.mark.parametrize('trouble', one_in(2, TROUBLE))
@pytest.mark.invariant(3, 4, 5)
async def test_disturbed_arm_comes_to_rest_and_moves_only_after_enable(trouble):
    disturb, expected = TROUBLE[trouble]

    async with robot_cell() as (robot, controller):
        motion = await robot.move_joints(FAR, speed=SLOW, wait=False)
        await until(lambda: robot.joints[0] > 0.01)
        disturb(controller)
        with pytest.raises(MotionError, match=expected):
            await motion.wait()
        assert motion.done
        assert not robot.status.enabled
        await asyncio.sleep(1.5)
        there = controller.arm.commanded
        assert there[0] < 1.0
        with pytest.raises(RobotError):
            await robot.move_joints(HOME)
        await asyncio.sleep(1.0)
        assert np.array_equal(there, controller.arm.commanded)
        await recover(robot, controller)
        await robot.move_joints(HOME)


@pytest.mark.invariant(3, 4, 5)
async def test_disable_during_a_move_stops_it_and_switches_the_motors_off():
    async with robot_cell() as (robot, controller):
        motion = await robot.move_joints(FAR, speed=SLOW, wait=False)
        await until(lambda: robot.joints[0] > 0.01)
        assert 'the arm is disabled and the motors are off' in await robot.disable()
        with pytest.raises(MotionError, match='disabled on request'):
            await motion.wait()
        assert not controller.condition.powered


@pytest.mark.invariant(3, 5)
async def test_stop_during_a_move_leaves_the_arm_at_rest_and_enabled():
    async with robot_cell() as (robot, controller):
        motion = await robot.move_joints(FAR, speed=SLOW, wait=False)
        await until(lambda: robot.joints[0] > 0.01)
        assert 'the running motion ended' in await robot.stop()
        there = controller.arm.commanded
        assert there[0] < 1.0
        with pytest.raises(MotionError, match=r'stopped on request'):
            await motion.wait()
        await asyncio.sleep(1.0)
        assert np.array_equal(there, controller.arm.commanded)
        await robot.move_joints(HOME)


@pytest.mark.invariant(3)
async def test_task_cancelled_at_any_time_leaves_the_arm_at_rest():
    """Ctrl-C in asyncio.run() cancels the task in this manner."""

    async def moves(robot):
        while True:
            await robot.move_joints([0.2, 0, 0, 0, 0, 0], speed=0.3)
            await robot.move_joints(HOME, speed=0.3)

    async with simulated() as (controller, ports):
        for seconds in (0.01, 0.3, 0.7, 1.1, 2.3):
            robot = aio.Robot(
                motion_port=ports.motion, state_port=ports.state, remote_port=ports.remote
            )

            async def session(robot=robot, seconds=seconds):
                async with robot:
                    await robot.enable()
                    async with asyncio.timeout(seconds):
                        await moves(robot)

            with pytest.raises(TimeoutError):
                await session()
            there = controller.arm.commanded
            await asyncio.sleep(1.0)
            assert np.array_equal(there, controller.arm.commanded)


# --- while a motion is planned ----------------------------------------------------------------


async def press_and_enable(robot, controller):
    controller.apply(Event.ESTOP_PRESS)
    await until(lambda: not robot.status.enabled)
    controller.apply(Event.ESTOP_RELEASE)
    await robot.reset()
    await robot.enable()


WHILE_PLANNED = {
    'stop': (lambda robot, _: robot.stop(), r'stopped on request before it could start'),
    'disable, enable': (
        lambda robot, _: robot.disable(),
        r'disabled on request, while the motion was planned',
    ),
    'E-stop, enable': (press_and_enable, 'E-stop was pressed.* while the motion was planned'),
    'another motion': (
        lambda robot, _: robot.move_joints([0.02, 0, 0, 0]),
        'replaced by a newer goal before it could start',
    ),
}


@pytest.mark.parametrize('case', one_in(2, WHILE_PLANNED))
@pytest.mark.invariant(4, 5)
def test_motion_ended_during_planning_never_starts(case, monkeypatch):
    """The error comes immediately, although the planning thread still runs."""
    disturb, expected = WHILE_PLANNED[case]
    planning, release = threading.Event(), threading.Event()
    planned = motions.trajectory_along_runs

    def plan_slowly(*args, frame):
        planning.set()
        release.wait(PATIENCE)
        return planned(*args[:4])  # without the cancellation check

    monkeypatch.setattr(motions, 'trajectory_along_runs', plan_slowly)

    async def scenario():
        async with robot_cell(model='gx4_c251s') as (robot, controller):
            await robot.move_joints([0.3, 1.2, -0.05, 0.0])
            await robot.move_joints([0.0, 1.2, -0.05, 0.0])
            pose = robot.pose
            pose[2, 3] += 0.02
            task = asyncio.create_task(robot.move_line(pose))
            await until(planning.is_set)
            await disturb(robot, controller)
            with pytest.raises(MotionError, match=expected):
                await task
            if not robot.status.enabled:
                await robot.enable()
            there = controller.arm.commanded
            release.set()
            await asyncio.sleep(1.0)
            assert np.array_equal(there, controller.arm.commanded)
            await robot.move_joints([0.0, 1.0, -0.05, 0.0])

    run(scenario(), patience=600.0)


# --- without asyncio: real time, threads, processes -------------------------------------------


@pytest.fixture(autouse=True)
def _timeout(request, monkeypatch):
    """Extend time-outs for a busy machine."""
    if 'ports' in request.fixturenames:
        be_patient(monkeypatch.setattr)


def robot_at(ports):
    return Robot(**{f'{name}_port': ports[name] for name in ports})


COMMANDS = {
    'motors off': (('motors', 'off'), 'motors are off|refused'),
    'state link cut': (('fault', 'cut', 'port=state', 'for=0.5'), 'state link was lost'),
}


@pytest.mark.parametrize(
    'trouble',
    [
        command if command == 'motors off' else pytest.param(command, marks=pytest.mark.slow)
        for command in COMMANDS
    ],
)
@pytest.mark.invariant(3, 4, 5)
def test_synchronous_api_reports_the_stop_and_works_after_enable(ports, trouble):
    words, expected = COMMANDS[trouble]
    with robot_at(ports) as robot:
        robot.enable()
        motion = robot.move_joints(FAR, speed=SLOW, wait=False)
        wait_for(lambda: robot.joints[0] > 0.01)
        do(ports['remote'], *words)
        with pytest.raises(MotionError, match=expected):
            motion.wait(PATIENCE)
        with pytest.raises(RobotError):
            robot.move_joints(HOME)
        wait_for(lambda: robot.status.connected and robot.status.moving is False)
        if robot.status.error is not None:
            robot.reset()
        wait_for(lambda: enabled(robot))
        robot.move_joints(HOME)


def enabled(robot):
    """Return whether the robot could be enabled: the link may be cut twice."""
    try:
        robot.enable()
    except RobotError:
        return False
    return True


KILLED = """
import sys, time
from epson_driver import Robot

motion, state, io, remote = map(int, sys.argv[1:5])
robot = Robot(motion_port=motion, state_port=state, io_port=io, remote_port=remote).connect()
robot.enable()
robot.move_joints([1.5, 0.2, -0.2, 0.0, 0.5, 0.0], speed=0.02, wait=False)
while robot.joints[0] < 0.01:
    time.sleep(0.01)
print('moving', flush=True)
time.sleep(1000)
"""


@pytest.mark.slow
@pytest.mark.invariant(3)
def test_killed_program_leaves_the_arm_at_rest(ports):
    """The controller stops the arm because the connection closes."""
    process = program(KILLED, *(ports[name] for name in sim_process.PORTS))
    assert process.stdout.readline() == 'moving\n'
    process.kill()
    process.communicate(timeout=PATIENCE)
    with robot_at(ports) as robot:
        wait_for(lambda: robot.status.moving is False)
        there = robot.joints
        assert 0.0 < there[0] < 1.0
        assert not robot.status.enabled


@pytest.mark.slow
@pytest.mark.invariant(5)
def test_one_of_two_moving_threads_is_rejected(ports):
    results = []

    def move(robot, target):
        try:
            results.append(robot.move_joints([target, 0, 0, 0, 0, 0], speed=0.2).text)
        except MotionError as error:
            results.append(str(error))

    with robot_at(ports) as robot:
        robot.enable()
        threads = [threading.Thread(target=move, args=(robot, item)) for item in (0.2, -0.2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        assert len(results) == 2
        assert sum('at the goal' in result for result in results) == 1
        assert sum('another motion runs' in result for result in results) == 1
