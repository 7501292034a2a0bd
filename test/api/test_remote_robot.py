# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The profile `remote`: Remote Ethernet alone, no program in the controller."""

import asyncio
import contextlib

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.driver_harness import simulated, smooth_in_process
from support.event_loop import run, until
from support.remote_peer import RemotePeer

from epson_driver import Robot, aio
from epson_driver.aio import ArgumentError, MotionError, RobotError
from epson_driver.remote_ethernet.client import HungUpError, execute
from epson_driver.robots.kinematics import Kinematics
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.faults.fault_kinds import parse

START = [0.0, 0.3, -0.2, 0.0, 0.5, 0.0]
FAR = [1.5, 0.3, -0.2, 0.0, 0.5, 0.0]


async def watched(controller, motion):
    """Return the motion's result, and the commanded joints along it, shape (k, n)."""
    task, places = asyncio.ensure_future(motion), []
    while not task.done():
        places.append(controller.arm.commanded.copy())
        await asyncio.sleep(0.02)
    return await task, np.array(places)


async def started_motion(robot, controller, target=FAR):
    """Start a slow motion and return it once the arm moves."""
    motion = await robot.move_joints(target, speed=0.1, wait=False)
    await until(lambda: controller.in_motion)
    await asyncio.sleep(0.3)
    assert controller.in_motion
    return motion


async def assert_stays_at_rest(controller):
    """Wait for standstill, and assert that it lasts."""
    await until(lambda: not controller.in_motion)
    before = controller.arm.commanded.copy()
    await asyncio.sleep(0.5)
    assert np.array_equal(controller.arm.commanded, before)


def remote_cell(**options):
    return robot_cell(profile='remote', **options)


async def test_joint_moves_lines_and_arcs_follow_their_path():
    async with remote_cell() as (robot, controller):
        assert 'at the goal' in (await robot.move_joints(START)).text
        arm = Kinematics(robot.model)
        start = robot.ros_pose
        end = start + np.array([0.0, 0.06, -0.04, 0, 0, 0, 0])
        _, places = await watched(controller, robot.move_line(end))
        way = (end - start)[:3] / np.linalg.norm((end - start)[:3])
        tool = np.array([arm.forward(place)[:3, 3] for place in places]) - start[:3]
        assert np.abs(tool - np.outer(tool @ way, way)).max() < 2e-4
        assert np.abs(robot.ros_pose) == pytest.approx(np.abs(end), abs=1e-5)

        centre, radius = end[:3] - np.array([0.0, 0.03, 0.0]), 0.03
        via = centre + np.array([radius, 0.0, 0.0])
        goal = end - np.array([0.0, 0.06, 0.0, 0, 0, 0, 0])
        _, places = await watched(controller, robot.move_arc(via, goal))
        tool = np.array([arm.forward(place)[:3, 3] for place in places])
        away = np.linalg.norm(tool - centre, axis=1)
        assert np.abs(away - radius).max() < 2e-4
        assert np.linalg.norm(tool - via, axis=1).min() < 2e-3
        assert np.abs(robot.ros_pose) == pytest.approx(np.abs(goal), abs=1e-5)


async def test_line_that_turns_the_tool_keeps_the_tip_in_place():
    async with remote_cell() as (robot, controller):
        await robot.move_joints(START)
        tool = np.eye(4)
        tool[:3, 3] = [0.02, 0.0, 0.1]
        robot.set_tool(tool)
        arm = Kinematics(robot.model, tool)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
        place = robot.tool_pose[:3, 3]
        _, places = await watched(controller, robot.move_line(turn, frame='tool'))
        tips = np.array([arm.forward(item)[:3, 3] for item in places])
        assert np.abs(tips - place).max() < 2e-4
        assert np.ptp(places, axis=0).max() > 0.1


async def test_move_keeps_low_power_and_sets_the_requested_speed():
    async with remote_cell() as (robot, controller):
        await robot.move_joints(START, speed=0.07, acceleration=0.3)
        assert controller.condition.power.value == 'low'
        asked = {robot.io: '1'}  # the controller reports the last values set
        assert asked
        speed = await robot._connection.driver.state_link.ask('Execute,"Print Speed, Accel(1)"')
        assert speed == '"7 30"'


@pytest.mark.parametrize('model', ['gx4_a251s', 'vt6_a901s'])
async def test_other_arm_models_move_to_a_joint_target(model):
    async with remote_cell(model=model) as (robot, _):
        limits = robot.model.limits
        target = robot.joints + 0.1 * np.where(robot.joints > 0.0, -1.0, 1.0)
        linear = np.array([unit == 'm' for unit in limits.units])
        target[linear] = robot.joints[linear] - 0.02
        target = np.clip(target, limits.position_min, limits.position_max)
        await robot.move_joints(target)
        assert robot.joints == pytest.approx(target, abs=1e-4)


@pytest.mark.invariant(6)
async def test_joints_are_stale_while_the_arm_moves():
    async with remote_cell() as (robot, controller):
        samples = []
        robot.on_joints(lambda sample: samples.append((controller.in_motion, sample)))
        motion = await started_motion(robot, controller)
        samples.clear()
        with pytest.raises(RobotError, match=r'the newest joint state is [0-9.]+ s old'):
            _ = robot.joints
        assert robot.status.moving
        assert robot.status.text == 'the arm is moving'
        await asyncio.sleep(2.0)
        assert not samples
        assert robot.status.enabled
        await motion.wait()
        assert robot.joints == pytest.approx(FAR, abs=1e-4)
        assert not any(moving for moving, _ in samples)
        assert max(np.abs(sample.velocities).max() for _, sample in samples) < 1e-3


@pytest.mark.invariant(3)
async def test_stop_aborts_the_motion_and_the_next_one_succeeds():
    async with remote_cell() as (robot, controller):
        await robot.move_joints(START)
        motion = await started_motion(robot, controller)
        assert 'the arm is at rest' in await robot.stop()
        await assert_stays_at_rest(controller)
        assert controller.arm.commanded[0] < 1.4
        with pytest.raises(MotionError, match='stopped on request, the arm is at rest'):
            await motion.wait()
        await robot.move_joints(START)
        assert robot.joints == pytest.approx(START, abs=1e-4)


ENDS = {
    'E-stop': (
        [Event.ESTOP_PRESS],
        [Event.ESTOP_RELEASE],
        'E-stop is pressed|refused|system error',
    ),
    'motors off': ([Event.MOTORS_OFF], [], 'motors are off|system error'),
    'door': ([Event.DOOR_OPEN], [Event.DOOR_CLOSE], 'door is open|system error'),
    'manual': ([Event.MODE_MANUAL], [Event.MODE_AUTO], 'mode is TEACH|system error'),
}


@pytest.mark.parametrize('case', ENDS)
@pytest.mark.invariant(4)
def test_disturbed_arm_stays_at_rest_until_enabled(case):
    events, undo, expected = ENDS[case]

    async def scenario():
        async with remote_cell() as (robot, controller):
            motion = await started_motion(robot, controller)
            for event in events:
                controller.apply(event)
            with pytest.raises(MotionError, match=expected):
                await motion.wait()
            assert not robot.status.enabled
            await assert_stays_at_rest(controller)
            with pytest.raises(MotionError, match='enable'):
                await robot.move_joints(START)
            for event in undo:
                controller.apply(event)
            if case == 'E-stop':
                with pytest.raises(RobotError, match='reset'):
                    await robot.enable()
            await robot.reset()
            await assert_stays_at_rest(controller)
            await robot.enable()
            await assert_stays_at_rest(controller)
            await robot.move_joints(START)
            assert robot.joints == pytest.approx(START, abs=1e-4)

    run(scenario())


@pytest.mark.parametrize(
    ('trigger', 'undo'),
    [(Event.DOOR_OPEN, (Event.DOOR_CLOSE, Event.STOP)), (Event.MODE_MANUAL, (Event.MODE_AUTO,))],
)
@pytest.mark.invariant(4)
async def test_resting_arm_stays_disabled_when_its_motors_are_switched_on(trigger, undo):
    async with remote_cell() as (robot, controller):
        controller.apply(trigger)
        await until(lambda: not robot.status.enabled)
        for event in (*undo, Event.START, Event.MOTORS_ON):
            with contextlib.suppress(RejectedError):
                controller.apply(event)
        await until(lambda: controller.condition.powered)
        await asyncio.sleep(0.5)
        with pytest.raises(MotionError, match='enable'):
            await robot.move_joints(START)
        await assert_stays_at_rest(controller)
        await robot.enable()
        await robot.move_joints(START)


@pytest.mark.invariant(4)
async def test_cut_during_a_motion_is_reported_and_abort_follows_the_reconnect():
    async with remote_cell() as (robot, controller):
        motion = await started_motion(robot, controller)
        controller.faults.start(parse('cut port=remote for=1'))
        with pytest.raises(MotionError) as caught:
            await motion.wait()
        assert 'completes its command' in str(caught.value)
        assert 'unless the E-stop' in str(caught.value)
        assert controller.in_motion
        assert not robot.status.enabled
        await until(lambda: robot.status.connected)
        await until(lambda: not controller.in_motion)
        assert controller.arm.commanded[0] < 1.4  # the motion was aborted
        await assert_stays_at_rest(controller)
        await robot.enable()
        await robot.move_joints(START)


@pytest.mark.invariant(4)
async def test_close_during_a_motion_stops_the_arm():
    async with simulated(profile='remote') as (controller, ports):
        async with aio.Robot(controller='remote', remote_port=ports.remote) as robot:
            await robot.enable()
            await started_motion(robot, controller)
        await until(lambda: not controller.in_motion)
        assert controller.arm.commanded[0] < 1.4


@pytest.mark.invariant(1)
async def test_second_remote_client_is_rejected():
    """The first client logs in and stays connected, like programs that use epsonrc."""
    async with simulated(profile='remote') as (controller, ports):
        reader, writer = await asyncio.open_connection('127.0.0.1', ports.remote)
        writer.write(b'$Login,\r\n')
        assert await reader.readline() == b'#Login,0\r\n'
        robot = aio.Robot(controller='remote', remote_port=ports.remote)
        with pytest.raises(RobotError, match='another Remote Ethernet client is connected'):
            await robot.connect(timeout=3.0)
        writer.write(b'$SetMotorsOn,1\r\n')
        assert await reader.readline() == b'#SetMotorsOn,0\r\n'
        writer.close()
        async with robot:
            await robot.enable()
            motion = await started_motion(robot, controller)
            with pytest.raises(HungUpError, match='before the reply to Login'):
                await execute('127.0.0.1', ports.remote, ['Abort'], 3.0)
            assert controller.in_motion
            await motion.cancel()


async def test_other_ports_of_a_controller_without_program_are_closed():
    async with simulated(profile='remote') as (_, ports):
        for port in (ports.motion, ports.state, ports.io):
            reader, writer = await asyncio.open_connection('127.0.0.1', port)
            with contextlib.suppress(ConnectionResetError):
                assert await reader.read() == b''
            writer.close()


SHIFTED = np.eye(4)
SHIFTED[2, 3] = 0.02

REFUSED = {
    'waypoints': lambda robot: robot.move_waypoints([START, FAR]),
    'trajectory': lambda robot: robot.move_trajectory([1.0, 2.0], [START, START]),
    'path': lambda robot: robot.move_path([robot.tool_pose, robot.tool_pose @ SHIFTED]),
}


@pytest.mark.parametrize('case', REFUSED)
@pytest.mark.invariant(1)
async def test_remote_controller_rejects_trajectories_of_several_points(monkeypatch, case):
    smooth_in_process(monkeypatch)
    async with remote_cell() as (robot, controller):
        await robot.move_joints(START)
        with pytest.raises(MotionError, match=r'a plan of \d+ points: over Remote Ethernet'):
            await REFUSED[case](robot)
        await assert_stays_at_rest(controller)


async def test_streams_speed_scaling_and_pause_are_rejected():
    async with remote_cell() as (robot, controller):
        with pytest.raises(RobotError, match='over Remote Ethernet alone the arm follows no'):
            robot.servo(robot.joints)
        for factor in (0.0, 0.5):
            with pytest.raises(
                RobotError, match='cannot change the speed during a motion, or pause'
            ):
                robot.set_speed_scaling(factor)
        robot.set_speed_scaling(1.0)
        await assert_stays_at_rest(controller)


@pytest.mark.invariant(2)
async def test_limits_are_checked_before_sending():
    async with RemotePeer(Execute='#Execute,"0 0 0 0 0 0 1"') as peer:
        async with aio.Robot(controller='remote', remote_port=peer.port) as robot:
            await robot.enable()
            for target in ([9.0, 0, 0, 0, 0, 0], [float('nan')] * 6, [0.0] * 5):
                with pytest.raises(ArgumentError):
                    await robot.move_joints(target)
            with pytest.raises(ArgumentError):
                await robot.move_line([5.0, 0, 0, 0, 0, 0, 1])
        assert all('Print' in line for line in peer.given('Execute'))


@pytest.mark.invariant(5)
async def test_reply_without_motion_is_no_success():
    """The controller confirms the motion, but the arm is still at its start."""
    async with (
        RemotePeer(Execute='#Execute,"0 0 0 0 0 0 1"') as peer,
        aio.Robot(controller='remote', remote_port=peer.port) as robot,
    ):
        await robot.enable()
        with pytest.raises(MotionError, match=r'joint_1 is 0\.5 rad from the goal'):
            await robot.move_joints([0.5, 0, 0, 0, 0, 0])


async def test_slow_replies_only_delay_the_state():
    async with remote_cell() as (robot, controller):
        link = robot._connection.driver.state_link
        send = link._write

        def send_late(connection, data):
            asyncio.get_running_loop().call_later(0.2, send, connection, data)

        link._write = send_late
        await robot.move_joints(START)
        motion = await started_motion(robot, controller)
        assert 'the arm is at rest' in await robot.stop()
        assert motion.done
        del link._write


def test_wrong_password_is_reported_and_the_profile_s_password_is_used(tmp_path):
    profile = tmp_path / 'cell.yaml'

    def profile_with(password):
        profile.write_text(
            f'like: remote\nname: cell\ndescription: ours\nremote: {{password: {password}}}\n'
        )
        return str(profile)

    async def scenario():
        async with simulated(profile=profile_with('secret')) as (_, ports):
            for name in (profile_with('wrong'), 'remote'):
                robot = aio.Robot(controller=name, remote_port=ports.remote)
                with pytest.raises(RobotError, match=r'password is wrong.*password_variable'):
                    await robot.connect(timeout=2.0)
            async with aio.Robot(
                controller=profile_with('secret'), remote_port=ports.remote
            ) as robot:
                assert robot.status.connected

    run(scenario())


async def test_io_during_a_motion_is_limited_by_the_controller():
    async with remote_cell() as (robot, controller):
        await robot.io.write('DO', 3, 1)
        assert await robot.io.read('DO', 3) == 1
        motion = await started_motion(robot, controller)
        await robot.io.write('DO', 3, 0)
        assert controller.io.read_port(1, 3, 1) in (0, 1)
        with pytest.raises(RobotError, match='another command is being executed'):
            await robot.io.read('DI', 1)
        await motion.cancel()
        assert await robot.io.read('DO', 3) == 0


@pytest.mark.invariant(4)
async def test_connect_with_pressed_estop_reports_the_remedy():
    async with simulated(profile='remote') as (controller, ports):
        controller.apply(Event.ESTOP_PRESS)
        async with aio.Robot(controller='remote', remote_port=ports.remote) as robot:
            assert robot.status.e_stopped
            with pytest.raises(RobotError, match='no joint state from the controller'):
                _ = robot.joints
            with pytest.raises(RobotError, match='E-stop is pressed'):
                await robot.enable()
            controller.apply(Event.ESTOP_RELEASE)
            await robot.reset()
            await robot.enable()
            await robot.move_joints(START)


def test_simulated_remote_controller_runs_as_a_process():
    with Robot.simulated(controller='remote', start=START) as robot:
        robot.enable()
        robot.move_joints([0.2, *START[1:]])
        assert robot.joints == pytest.approx([0.2, *START[1:]], abs=1e-4)
        assert robot.disable().startswith('the arm is disabled and the motors are off')
