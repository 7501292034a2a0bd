# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The synchronous API: processes, sockets and threads in real time, and Ctrl-C."""

import asyncio
import inspect
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from support import sim_process
from support.api_harness import FAR, output, program
from support.api_patience import be_patient
from support.controller_harness import do
from support.examples import one_in
from support.sim_process import wait_for

import epson_driver
from epson_driver import MotionError, Robot, RobotError

HOME = [0.0] * 6
SLOW = 0.02
PATIENCE = 120.0


@pytest.fixture(autouse=True)
def _timeout(monkeypatch):
    """Extend time-outs for a busy machine."""
    be_patient(monkeypatch.setattr)


def robot_at(ports):
    """Return a robot for these ports that is not connected yet."""
    return Robot(**{f'{name}_port': ports[name] for name in ports})


def moving_slowly(robot):
    """Start a long slow motion, and return once the arm moves."""
    motion = robot.move_joints(FAR, speed=SLOW, wait=False)
    wait_for(lambda: robot.joints[0] > 0.01)
    return motion


# --- stops -----------------------------------------------------------------------


@pytest.mark.invariant(3, 4, 5)
@pytest.mark.slow
def test_killed_controller_ends_the_motion_and_the_robot_reconnects():
    links = []
    process, numbers = sim_process.started()
    with robot_at(numbers) as robot:
        robot.on_link(lambda name, _why: links.append(name))
        robot.enable()
        motion = moving_slowly(robot)
        process.kill()
        process.wait()
        process.stdout.close()
        with pytest.raises(MotionError, match='link was lost'):
            motion.wait(PATIENCE)
        assert not robot.status.connected
        assert 'no link to the controller' in robot.status.text
        with pytest.raises(RobotError, match='no joint state'):
            _ = robot.joints
        for command in (robot.enable, lambda: robot.move_joints(HOME)):
            with pytest.raises(RobotError):
                command()
        words = [word for name in numbers for word in (f'--{name}-port', str(numbers[name]))]
        again = subprocess.Popen(
            [*sim_process.COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_for(lambda: robot.status.connected and links[-1] == 'connected')
        wait_for(lambda: robot.status.e_stopped is not None)
        with pytest.raises(MotionError, match='not enabled'):
            robot.move_joints(HOME)
    again.send_signal(signal.SIGINT)
    again.wait(PATIENCE)


@pytest.mark.slow
@pytest.mark.invariant(3, 9)
@pytest.mark.parametrize('error', one_in(2, [ZeroDivisionError, KeyboardInterrupt]))
def test_exception_in_the_context_manager_stops_the_arm(ports, error):
    try:
        with robot_at(ports) as robot:
            robot.enable()
            motion = moving_slowly(robot)
            raise error
    except error:
        pass
    assert motion.text == 'stopped on request, the arm is at rest'
    with robot_at(ports) as robot:
        assert 0.0 < robot.joints[0] < 1.0
        assert not robot.status.moving


WAITS = """
import sys
from epson_driver import Robot

motion, state, io, remote = map(int, sys.argv[1:5])
robot = Robot(motion_port=motion, state_port=state, io_port=io, remote_port=remote)
try:
    with robot:
        robot.enable()
        long = robot.move_joints([1.5, 0.2, -0.2, 0.0, 0.5, 0.0], speed=0.02, wait=False)
        while robot.joints[0] < 0.01:
            pass
        {how}
except KeyboardInterrupt:
    print(long.text)
"""

AWAITS = """
import asyncio, sys
from epson_driver.aio import Robot

motion, state, io, remote = map(int, sys.argv[1:5])

async def main():
    global long
    ports = dict(motion_port=motion, state_port=state, io_port=io, remote_port=remote)
    async with Robot(**ports) as robot:
        await robot.enable()
        long = await robot.move_joints([1.5, 0.2, -0.2, 0.0, 0.5, 0.0], speed=0.02, wait=False)
        while robot.joints[0] < 0.01:
            await asyncio.sleep(0.01)
        print('moving', flush=True)
        await long.wait()

try:
    asyncio.run(main())
except KeyboardInterrupt:
    print(long.text)
"""

MOVES = """
from epson_driver import Robot, MotionError
import threading, time

with Robot.simulated() as robot:
    robot.enable()

    def report():
        while robot.joints[0] < 0.01:
            time.sleep(0.01)
        print('moving', flush=True)

    threading.Thread(target=report).start()
    try:
        robot.move_joints([1.5, 0.2, -0.2, 0.0, 0.5, 0.0], speed=0.02)
    except KeyboardInterrupt:
        robot.move_joints(robot.joints)  # at rest, connected and enabled
        print('moved')
"""


@pytest.mark.invariant(3)
@pytest.mark.parametrize(
    'code',
    one_in(2, [AWAITS, WAITS.format(how="print('moving'); __import__('time').sleep(1000)")]),
    ids=['asyncio', 'sleep'],
)
def test_ctrl_c_stops_the_arm(ports, code):
    process = program(code, *(ports[name] for name in sim_process.PORTS))
    assert process.stdout.readline() == 'moving\n'
    process.send_signal(signal.SIGINT)
    assert output(process) == 'stopped on request, the arm is at rest\n'
    with robot_at(ports) as robot:
        assert 0.0 < robot.joints[0] < 1.0


INTERRUPTED = """
from epson_driver import Robot
import threading, time

with Robot.simulated() as robot:
    robot.enable()
    motion = robot.move_joints([1.5, 0.2, -0.2, 0.0, 0.5, 0.0], speed=0.02, wait=False)

    def report():
        while robot.joints[0] < 0.01:
            time.sleep(0.01)
        print('moving', flush=True)

    threading.Thread(target=report).start()
    try:
        motion.wait()
    except KeyboardInterrupt:
        print(motion.text, robot.status.enabled)
"""


@pytest.mark.slow
@pytest.mark.invariant(3)
def test_ctrl_c_in_wait_cancels_the_motion():
    process = program(INTERRUPTED, start_new_session=True)
    assert process.stdout.readline() == 'moving\n'
    process.send_signal(signal.SIGINT)
    assert output(process) == 'canceled, the arm is at rest True\n'


@pytest.mark.invariant(3)
@pytest.mark.slow
def test_ctrl_c_in_a_move_cancels_it_and_spares_the_simulated_controller():
    process = program(MOVES, start_new_session=True)
    assert process.stdout.readline() == 'moving\n'
    os.killpg(process.pid, signal.SIGINT)  # to the whole group, like a terminal
    assert output(process) == 'moved\n'


def children(pid):
    """Return the child processes of a process."""
    pids = set()
    for stat in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = stat.read_text().rpartition(')')[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            pids.add(int(stat.parent.name))
    return pids


@pytest.mark.skipif(sys.platform != 'linux', reason='reads /proc')
@pytest.mark.invariant(9)
@pytest.mark.slow
def test_killed_program_leaves_no_simulated_controller():
    code = (
        'import time\nfrom epson_driver import Robot\n'
        'robot = Robot.simulated().connect()\nprint("connected")\ntime.sleep(1000)'
    )
    process = program(code)
    assert process.stdout.readline() == 'connected\n'
    (controller,) = children(process.pid)
    process.kill()
    process.communicate(timeout=PATIENCE)
    wait_for(lambda: not Path(f'/proc/{controller}').exists())


# --- threads ----------------------------------------------------------------------------------


@pytest.mark.parametrize('count', [10, pytest.param(100, marks=pytest.mark.soak)])
@pytest.mark.slow
def test_moves_leave_no_threads_or_tasks(ports, count):
    before = threading.active_count()
    with robot_at(ports) as robot:
        robot.enable()
        robot.move_joints([0.01, 0, 0, 0, 0, 0])
        tasks = robot._session.call(lambda: len(asyncio.all_tasks()))
        threads = threading.active_count()
        for index in range(count):
            robot.move_joints([0.01 * (index % 2), 0, 0, 0, 0, 0])
        assert threading.active_count() == threads
        assert robot._session.call(lambda: len(asyncio.all_tasks())) <= tasks
    assert threading.active_count() == before


@pytest.mark.slow
def test_close_in_a_callback_ends_a_waiting_thread(ports):
    ended = []
    robot = robot_at(ports).connect()
    robot.enable()

    def wait():
        try:
            robot.move_joints(FAR, speed=SLOW)
        except RobotError as error:
            ended.append(str(error))

    waiting = threading.Thread(target=wait)
    waiting.start()
    wait_for(lambda: robot.joints[0] > 0.01)
    robot.on_estop(lambda _pressed: robot.close())
    do(ports['remote'], 'estop', 'press')
    waiting.join(PATIENCE)
    (error,) = ended
    assert 'E-stop' in error

    def closed():
        try:
            _ = robot.status
        except RobotError:
            return True
        return False

    wait_for(closed)


@pytest.mark.invariant(9)
@pytest.mark.slow
def test_close_in_a_callback_and_at_block_exit_may_coincide(ports):
    for _ in range(5):
        with robot_at(ports) as robot:
            called = threading.Event()

            def close(_name, _why, robot=robot, called=called):
                called.set()
                robot.close()

            robot.on_link(close)
            robot._session.call(
                lambda robot=robot: robot._awaited._connection.on_link_state('connected', 'a test')
            )
            called.wait(PATIENCE)
        with pytest.raises(RobotError, match='no connection'):
            robot.enable()


@pytest.mark.slow
def test_move_waypoints_reaches_the_last_waypoint(ports):
    with robot_at(ports) as robot:
        robot.enable()
        motion = robot.move_waypoints([[0.3, 0.1, 0, 0, 0, 0], [0.0, 0, 0, 0, 0.3, 0]], speed=0.5)
        assert motion.progress == 1.0
        assert np.abs(robot.joints - [0, 0, 0, 0, 0.3, 0]).max() < 0.01


# --- without a connection ---------------------------------------------------------------------


def test_request_without_connection_raises():
    robot = Robot()
    for request in (
        robot.enable,
        lambda: robot.joints,
        lambda: robot.status,
        lambda: robot.move_joints(HOME),
        lambda: robot.io.read('DI', 0),
    ):
        with pytest.raises(RobotError, match=r'no connection.*: call connect\(\)'):
            request()
    robot.close()


@pytest.mark.parametrize('kind', [Robot, epson_driver.Waypoint])
def test_signatures_fit_into_a_few_lines_of_help(kind):
    methods = [kind, *(getattr(kind, name) for name in vars(kind) if not name.startswith('_'))]
    for signature in (str(inspect.signature(item)) for item in methods if callable(item)):
        assert 'numpy' not in signature
        assert len(signature) < 450


def test_access_to_an_unknown_name_of_the_package_raises():
    with pytest.raises(AttributeError, match='Robots'):
        _ = epson_driver.Robots
