# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A Robot object that is dropped, replaced, copied or forked gives up the arm."""

import asyncio
import copy
import gc
import logging
import os
import pickle
import threading

import pytest
from support.api_harness import FAR, output, ports_of, program
from support.api_patience import be_patient
from support.driver_harness import simulated
from support.sim_process import wait_for

from epson_driver import Robot, RobotError, aio
from epson_driver.api import threads

PATIENCE = 120.0


@pytest.fixture(autouse=True)
def _timeout(monkeypatch):
    be_patient(monkeypatch.setattr)


def moving(ports):
    """Return a robot whose arm moves."""
    robot = Robot(**{f'{name}_port': ports[name] for name in ports}).connect()
    robot.on_error(lambda _error: None)
    robot.enable()
    robot.move_joints(FAR, speed=0.02, wait=False)
    wait_for(lambda: robot.joints[0] > 0.01)
    return robot


@pytest.mark.invariant(3, 4, 9)
def test_dropped_robot_stops_the_arm_and_ends_its_threads(ports, caplog):
    before = threading.active_count()
    robot = moving(ports)
    with pytest.raises(ValueError, match='joint_1'):
        robot.move_joints([9.0] * 6)  # a caught error holds no reference
    assert threading.active_count() > before
    del robot
    gc.collect()  # pytest's record of the error above
    wait_for(lambda: threading.active_count() == before)
    assert 'a connected Robot was deleted: stopping the arm' in caplog.text
    gc.collect()  # the motion, which logs its unread outcome
    assert 'stopped on request, the arm is at rest' in caplog.text


@pytest.mark.slow
@pytest.mark.invariant(3, 4, 9)
def test_dropping_a_robot_with_a_blocked_callback_does_not_block(ports, monkeypatch, caplog):
    monkeypatch.setattr(threads, 'MAX_WAITING_CALLBACKS', 3)
    before, release = threading.active_count(), threading.Event()
    robots = [moving(ports)]
    robots[0].on_joints(lambda _sample: release.wait())
    wait_for(lambda: 'Full' in caplog.text)
    losing = threading.Thread(target=robots.clear, daemon=True)
    losing.start()
    wait_for(lambda: not losing.is_alive())
    gc.collect()
    wait_for(lambda: 'a connected Robot was deleted: stopping the arm' in caplog.text)
    release.set()
    wait_for(lambda: threading.active_count() == before)


@pytest.mark.invariant(3, 4)
def test_second_robot_of_a_process_closes_the_first(ports):
    first = moving(ports)
    motion = first.move_joints
    robot = Robot(**{f'{name}_port': ports[name] for name in ports}).connect()
    assert not robot.status.moving
    assert not robot.status.enabled
    with pytest.raises(RobotError, match=r'connection was closed.*: call connect\(\)'):
        motion(FAR)
    robot.enable()
    robot.close()
    first.close()


@pytest.mark.slow
@pytest.mark.invariant(3, 9)
def test_program_that_exits_without_close_stops_the_arm(ports):
    code = f"""
import logging, sys
from epson_driver import Robot
logging.basicConfig(stream=sys.stdout, level=logging.INFO)
robot = Robot(**{ {f'{name}_port': ports[name] for name in ports} })
robot.connect().enable()
robot.move_joints({FAR}, speed=0.02, wait=False)
while robot.joints[0] < 0.01:
    pass
"""
    assert 'closing: the running motion ended: stopped on request, the arm is at rest' in output(
        program(code)
    )


async def test_connect_reports_that_another_client_is_connected():
    async with simulated() as (_, ports):
        _, writer = await asyncio.open_connection('127.0.0.1', ports.motion)
        with pytest.raises(
            RobotError, match=r'motion link .* immediately: another client is connected'
        ):
            await aio.Robot(**ports_of(ports)).connect(5.0)
        writer.close()
        robot = await aio.Robot(**ports_of(ports)).connect(5.0)
        assert robot.status.connected
        await robot.close()


@pytest.mark.invariant(3, 4)
async def test_second_or_deleted_asyncio_robot_also_stops_the_arm(caplog):
    async with simulated() as (_, ports):
        first = await aio.Robot(**ports_of(ports)).connect()
        await first.enable()
        motion = await first.move_joints(FAR, speed=0.02, wait=False)
        second = await aio.Robot(**ports_of(ports)).connect()
        assert motion.text == 'stopped on request, the arm is at rest'
        with pytest.raises(RobotError, match='the connection was closed'):
            await first.enable()
        await second.enable()
        motion = await second.move_joints(FAR, speed=0.02, wait=False)
        with caplog.at_level(logging.WARNING):
            del second
            gc.collect()
            while not motion.done:  # noqa: ASYNC110 - the robot to await is gone
                await asyncio.sleep(0.1)
        assert 'a connected Robot was deleted' in caplog.text


@pytest.mark.skipif(not hasattr(os, 'fork'), reason='no fork here')
@pytest.mark.invariant(9)
@pytest.mark.slow
def test_forked_child_cannot_use_the_robot(ports):
    robot = moving(ports)
    motion = robot.move_joints
    calls = (lambda: robot.joints, lambda: robot.status, robot.enable, robot.connect)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        checks = []
        for call in (*calls, lambda: motion(FAR)):
            try:
                call()
            except RobotError as error:
                checks.append('after the fork' in str(error))
        link = robot._awaited._connection.driver.motion_link
        number = link.transport.get_extra_info('socket').fileno()
        checks.append(os.path.sameopenfile(number, os.open(os.devnull, os.O_RDWR)))
        robot.close()
        os.write(writing, repr(checks).encode())
        os._exit(0)
    os.close(writing)
    os.waitpid(child, 0)
    with os.fdopen(reading) as end:
        assert end.read() == repr([True] * 6)
    here = robot.joints[0]
    wait_for(lambda: robot.joints[0] > here)  # the parent's motion continues
    robot.close()


@pytest.mark.parametrize('copied', [copy.copy, copy.deepcopy, pickle.dumps])
@pytest.mark.parametrize('kind', [Robot, aio.Robot])
def test_robot_cannot_be_copied_or_pickled(copied, kind):
    robot = kind()
    for original in (robot, robot.io, robot.gripper):
        with pytest.raises(
            TypeError, match='cannot be copied or pickled, because there is one arm'
        ):
            copied(original)


def test_robot_of_an_ended_event_loop_asks_to_connect_again(ports, caplog, capfd):
    robot = aio.Robot(**{f'{name}_port': ports[name] for name in ports})

    async def enable():
        await robot.enable()

    async def start():
        await robot.connect()
        await enable()

    asyncio.run(start())
    with pytest.raises(RobotError, match=r'event loop, which has ended: call connect\(\)'):
        asyncio.run(enable())
    asyncio.run(start())
    assert 'TaskEndedError' not in caplog.text + capfd.readouterr().err
