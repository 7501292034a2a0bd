# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The asynchronous API against the simulated controller: real sockets, virtual time."""

import asyncio
import gc

import numpy as np
import pytest
from support.api_harness import FAR, ports_of, robot_cell
from support.driver_harness import ScriptedController, answer, simulated, smooth_in_process
from support.event_loop import run, stand_still, until
from support.examples import one_in
from support.sim_process import vacant_port
from support.two_jaws import TwoJaws

from epson_driver import aio
from epson_driver.aio import MotionError, Robot, RobotError, Settings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse

HOME = [0.0] * 6
LONG = [2.0, 0.0, 0.0, 0.0, 0.3, 0.0]
SLOW = 0.02


async def motion_error(coroutine):
    with pytest.raises(MotionError) as caught:
        await coroutine
    return caught.value


async def moving_slowly(robot):
    """Start a long slow motion, and return once the arm moves."""
    motion = await robot.move_joints(FAR, speed=SLOW, wait=False)
    await until(lambda: robot.joints[0] > 0.01)
    return motion


# --- moving -----------------------------------------------------------------------------------


@pytest.mark.parametrize('profile', ['simulated', 'generic', 'fanuc', 'abb', 'motoman'])
@pytest.mark.invariant(5)
async def test_move_reaches_its_target_on_every_kind_of_controller(profile):
    own_speed = Settings(require_planned_speed=profile != 'fanuc')
    async with robot_cell(profile=profile, settings=own_speed) as (robot, _):
        motion = await robot.move_joints([0.3, 0.1, -0.1, 0.2, 0.4, -0.3])
        assert motion.done
        assert motion.progress == 1.0
        assert motion.text.startswith('at the goal after')
        assert np.abs(robot.joints - [0.3, 0.1, -0.1, 0.2, 0.4, -0.3]).max() < 0.01


@pytest.mark.invariant(2)
async def test_speed_fraction_limits_the_joint_velocity():
    async with robot_cell(smooth=True) as (robot, _):
        fastest = np.zeros(6)
        motion = await robot.move_joints([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], speed=0.1, wait=False)
        while not motion.done:
            fastest = np.maximum(fastest, np.abs(robot.joint_velocities))
            await asyncio.sleep(0.01)
        await motion.wait()
        limit = robot.model.limits.velocity[0]
        assert 0.08 * limit < fastest[0] < 0.105 * limit


async def test_trajectory_in_another_joint_order_is_executed():
    async with robot_cell() as (robot, _):
        names = robot.model.joint_names[::-1]
        rows = np.linspace(0.0, 0.3, 4)[:, None] * [0, 0, 0, 0, 0, 1.0]
        await robot.move_trajectory([0.0, 0.5, 1.0, 1.5], rows, joint_names=names)
        assert np.abs(robot.joints - [0.3, 0, 0, 0, 0, 0]).max() < 0.01


async def test_pose_is_computed_from_the_measured_joints():
    async with robot_cell(enabled=False) as (robot, _):
        assert np.allclose(robot.pose @ np.linalg.inv(robot.pose), np.eye(4))
        assert robot.pose.shape == (4, 4)
        assert np.allclose(robot.frames['base'] @ robot.epson_point.pose, robot.pose)
        assert np.allclose(robot.ros_pose[:3], robot.pose[:3, 3])


@pytest.mark.invariant(6)
async def test_stale_joints_raise_until_catch_up():
    async with robot_cell() as (robot, _):
        for read in (lambda: robot.joints, lambda: robot.joint_velocities, lambda: robot.pose):
            stand_still(1.0)
            with pytest.raises(RobotError, match=r'the newest joint state is .* s old'):
                read()
            await robot.catch_up()
            read()
        stand_still(1.0)
        await robot.move_joints([0.1, 0, 0, 0, 0, 0])


@pytest.mark.invariant(6)
def test_measured_reads_fresh_joints_after_a_stall_or_raises():
    """The stall may also fall between catching up and reading."""

    async def scenario():
        async with robot_cell() as (robot, controller):

            def read_after_stall():
                stand_still(1.0)
                return robot.joints

            stand_still(1.0)
            assert len(await robot.measured(read_after_stall)) == 6
            with pytest.raises(RobotError, match=r'the newest joint state is .* s old'):
                read_after_stall()
            await robot.catch_up()
            controller.faults.start(parse('half_open port=state for=30'))
            await asyncio.sleep(0.4)  # plus 0.5 s in measured(): the link is lost after 1 s
            with pytest.raises(RobotError, match=r'the newest joint state is .* s old'):
                await robot.measured(lambda: robot.joints)

    run(scenario())


async def test_cancel_stops_the_arm_and_ends_the_motion():
    async with robot_cell() as (robot, _):
        motion = await moving_slowly(robot)
        before = motion.progress
        assert 0.0 < before < 1.0
        await until(lambda: motion.progress > before)
        assert await motion.cancel() == 'canceled, the arm is at rest'
        assert motion.done
        assert not robot.status.moving
        assert (await motion_error(motion.wait())).end is End.CANCELED
        await motion.cancel()  # no effect
        await robot.move_joints(HOME)


@pytest.mark.invariant(3)
async def test_cancelled_caller_stops_the_arm():
    async with robot_cell() as (robot, _):
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(2.0):
                await robot.move_joints(FAR, speed=SLOW)
        there = robot.joints
        await asyncio.sleep(0.5)
        assert np.array_equal(there, robot.joints)
        assert there[0] < 1.0
        await robot.move_joints(HOME)  # the arm is still enabled


async def test_timeout_of_wait_does_not_end_the_motion():
    async with robot_cell() as (robot, _):
        motion = await robot.move_joints([0.5, 0, 0, 0, 0, 0], speed=0.1, wait=False)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(motion.wait(), 0.2)
        assert 'at the goal' in await motion.wait()


async def test_speed_scaling_zero_pauses_and_out_of_range_is_rejected():
    async with robot_cell() as (robot, _):
        robot.set_speed_scaling(0.0)
        await asyncio.sleep(1.0)  # its ramp
        motion = await robot.move_joints([0.2, 0, 0, 0, 0, 0], wait=False)
        await asyncio.sleep(5.0)
        assert not motion.done
        robot.set_speed_scaling(1.0)
        await motion.wait()
        with pytest.raises(ValueError, match=r'factor = 2\.0: must be 0'):
            robot.set_speed_scaling(2.0)
        assert robot.speed_scaling == 1.0


async def started(robot, how):
    """Start a motion of several seconds with few points."""
    if how == 'joints':
        return await robot.move_joints(LONG, speed=0.08, wait=False)
    if how == 'waypoints':
        return await robot.move_waypoints([LONG], speed=0.08, wait=False)
    return await robot.move_trajectory([6.0], [LONG], wait=False)


@pytest.mark.parametrize(
    ('profile', 'smooth', 'how'),
    one_in(
        5,
        [
            ('generic', False, 'waypoints'),
            ('simulated', False, 'joints'),
            ('spel', False, 'joints'),
            ('fanuc', False, 'joints'),
            ('motoman', True, 'trajectory'),
            ('motoman', True, 'waypoints'),
            *(('simulated', True, how) for how in ('joints', 'waypoints', 'trajectory')),
        ],
        several=True,
    ),
)
async def test_paused_motion_of_every_kind_resumes(monkeypatch, profile, smooth, how):
    smooth_in_process(monkeypatch)
    own_speed = Settings(require_planned_speed=profile != 'fanuc')
    async with robot_cell(profile=profile, smooth=smooth, settings=own_speed) as (robot, _):
        start = robot.joints
        motion = await started(robot, how)
        await until(lambda: np.abs(np.subtract(robot.joints, start)).max() > 0.02)
        robot.set_speed_scaling(0.0)
        assert robot.status.paused
        assert robot.status.text == 'pausing: the arm brakes'
        assert robot.status.remedy == 'call set_speed_scaling(1.0)'
        await asyncio.sleep(1.0)
        assert robot.status.text == 'motions are paused: the speed scaling is 0'
        here = robot.joints
        await asyncio.sleep(2.0)
        assert robot.joints == pytest.approx(here, abs=1e-3)
        assert not motion.done
        robot.set_speed_scaling(1.0)
        await motion.wait()
        assert not robot.status.paused
        assert robot.joints == pytest.approx(LONG, abs=0.01)


async def test_speed_scaling_is_rejected_if_the_controller_cannot_be_slowed():
    async with robot_cell(profile='abb') as (robot, _):
        motion = await started(robot, 'joints')
        await asyncio.sleep(0.7)
        for factor in (0.0, 0.5):
            with pytest.raises(RobotError, match=r'the controller has all points'):
                robot.set_speed_scaling(factor)
        assert robot.speed_scaling == 1.0
        await motion.wait()
    async with robot_cell(profile='fanuc') as (robot, _):
        with pytest.raises(RobotError, match=r'factor = 0\.5: this controller i'):
            robot.set_speed_scaling(0.5)
        error = await motion_error(robot.move_joints(FAR, speed=0.01))
        assert 'override of its pendant' in str(error)
        assert 'require_planned_speed=False' in str(error)


# --- rejected motions --------------------------------------------------------------------------


@pytest.mark.invariant(1, 4)
async def test_move_before_enable_is_rejected_with_remedy():
    async with robot_cell(enabled=False) as (robot, _):
        error = await motion_error(robot.move_joints(FAR))
        assert 'the arm is not enabled' in str(error)
        assert 'call enable()' in str(error)
        assert error.code is ErrorCode.INVALID_GOAL
        await asyncio.sleep(1.0)
        assert not robot.joints.any()


async def test_move_is_rejected_while_another_runs():
    async with robot_cell() as (robot, _):
        motion = await robot.move_joints([0.3, 0, 0, 0, 0, 0], speed=0.1, wait=False)
        for again in (
            robot.move_joints(HOME),
            robot.move_waypoints([HOME]),
            robot.move_trajectory([1.0], [HOME]),
        ):
            assert 'another motion runs' in str(await motion_error(again))
        await motion.wait()
        assert robot.joints[0] == pytest.approx(0.3, abs=0.01)


@pytest.mark.invariant(1)
async def test_trajectory_from_another_position_is_rejected():
    async with robot_cell() as (robot, _):
        error = await motion_error(robot.move_trajectory([0.0, 5.0], [FAR, HOME]))
        assert 'the trajectory starts at 1.5 rad, the joint is at 0 rad' in str(error)


# --- stops -----------------------------------------------------------------------


@pytest.mark.invariant(3, 4, 5)
async def test_estop_ends_the_motion_and_only_enable_permits_the_next():
    pressed, errors = [], []
    async with robot_cell() as (robot, controller):
        robot.on_estop(pressed.append)
        robot.on_error(errors.append)
        motion = await moving_slowly(robot)
        controller.apply(Event.ESTOP_PRESS)
        error = await motion_error(motion.wait())
        assert 'E-stop is pressed' in str(error)
        assert error.end is End.ABORTED
        assert pressed == [True]
        status = robot.status
        assert status.e_stopped
        assert not status.enabled
        assert 'E-stop' in status.text
        assert 'call reset()' in status.remedy
        with pytest.raises(RobotError, match=r'call reset\(\)'):
            await robot.enable()
        with pytest.raises(
            RobotError, match=r'^the E-stop is pressed or not reset.*; release it, '
        ):
            await robot.reset()
        controller.apply(Event.ESTOP_RELEASE)
        assert 'until it is enabled' in await robot.reset()
        with pytest.raises(aio.ArgumentError, match='enable'):
            await robot.reset(enable='yes')
        assert pressed == [True, False]
        assert 'not enabled (the E-stop was pressed, error 2261)' in robot.status.text
        assert 'not enabled' in str(await motion_error(robot.move_joints(HOME)))
        assert await robot.reset(enable=True) == 'the arm is enabled'
        await robot.move_joints(HOME)


async def test_paused_controller_is_reported_with_remedy():
    async with robot_cell() as (robot, controller):
        await moving_slowly(robot)
        controller.apply(Event.PAUSE)
        await until(lambda: robot.status.paused)
        assert robot.status.text.startswith('the controller is paused')
        assert robot.status.remedy == 'continue at the controller, or start main'


async def test_controller_error_is_reported_and_reset_clears_it():
    errors = []
    async with robot_cell() as (robot, controller):
        robot.on_error(errors.append)
        motion = await moving_slowly(robot)
        controller.servo_error(0)
        assert 'error' in str(await motion_error(motion.wait()))
        (error,) = errors
        assert error.number
        assert str(error.number) in error.text
        assert robot.status.error == error
        await until(lambda: not robot.status.moving)
        await robot.reset()
        assert errors[1:] == [None]


@pytest.mark.invariant(3, 4, 5, 6)
async def test_cut_state_link_ends_the_motion_and_reading_joints_raises():
    links = []
    async with robot_cell() as (robot, controller):
        robot.on_link(lambda name, _why: links.append(name))
        motion = await moving_slowly(robot)
        controller.faults.start(parse('cut port=state for=0.5'))
        assert 'the state link was lost' in str(await motion_error(motion.wait()))
        with pytest.raises(RobotError, match='no joint state'):
            _ = robot.joints
        await until(lambda: links and links[-1] == 'connected')
        assert 'backing_off' in links
        assert 'not enabled' in str(await motion_error(robot.move_joints(HOME)))


@pytest.mark.invariant(3, 9)
async def test_raising_callback_stops_the_arm_and_is_reported():
    reported = []
    asyncio.get_running_loop().set_exception_handler(
        lambda _loop, context: reported.append(str(context['exception']))
    )
    async with robot_cell() as (robot, controller):
        motion = await moving_slowly(robot)

        def fail(_name, _why):
            raise ZeroDivisionError('mine')

        robot.on_link(fail)
        controller.faults.start(parse('cut port=motion for=0.5'))
        await motion_error(motion.wait())
        assert not robot.status.enabled
        assert 'mine' in reported


async def test_removed_callback_is_not_called():
    calls = []
    async with robot_cell() as (robot, controller):
        with pytest.raises(aio.ArgumentError, match='callback = 3: must be a function'):
            robot.on_estop(3)
        remove = robot.on_estop(calls.append)
        remove()
        remove()
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: robot.status.e_stopped)
        assert calls == []


@pytest.mark.invariant(3)
@pytest.mark.parametrize('error', [ZeroDivisionError, KeyboardInterrupt, None])
async def test_leaving_the_context_manager_stops_the_arm(error):
    async with simulated() as (controller, ports):
        robot = Robot(motion_port=ports.motion, state_port=ports.state, remote_port=ports.remote)
        try:
            async with robot:
                await robot.enable()
                motion = await moving_slowly(robot)
                if error is not None:
                    raise error
        except (ZeroDivisionError, KeyboardInterrupt):
            pass
        assert motion.text == 'stopped on request, the arm is at rest'
        there = controller.arm.commanded
        await asyncio.sleep(1.0)
        assert np.array_equal(there, controller.arm.commanded)
        with pytest.raises(RobotError, match=r'no connection .*call connect\(\)'):
            _ = robot.joints


@pytest.mark.invariant(9)
async def test_driver_defect_ends_the_motion_and_is_reported(monkeypatch):
    reported = []
    asyncio.get_running_loop().set_exception_handler(
        lambda _loop, context: reported.append(context)
    )
    async with robot_cell() as (robot, _):
        motion = await moving_slowly(robot)

        def fail(_sample, _now):
            raise ZeroDivisionError('a defect')

        monkeypatch.setattr(robot._connection.driver.goal_queue, 'on_joints', fail)
        await motion_error(motion.wait())
        await until(lambda: robot._connection.task.done())
        with pytest.raises(RobotError, match=r'the driver has ended .*a defect'):
            await robot.enable()
        assert reported


# --- connecting -------------------------------------------------------------------------------


async def test_connect_without_listener_names_port_and_remedy():
    port = vacant_port()
    robot = Robot(motion_port=port, state_port=port, io_port=0)
    with pytest.raises(RobotError) as caught:
        await robot.connect(timeout=2.0)
    assert f'state link to port {port}' in str(caught.value)
    assert 'refused' in str(caught.value)
    assert 'check host and ports' in str(caught.value)


@pytest.mark.parametrize(
    ('shows', 'missing'),
    [('shows_joints', 'no joint state'), ('shows_status', 'sends no STATUS')],
)
async def test_connect_names_the_missing_message(shows, missing):
    async with ScriptedController() as controller:
        setattr(controller, shows, False)
        ports = controller.ports
        robot = Robot(motion_port=ports.motion, state_port=ports.state, io_port=0)
        with pytest.raises(RobotError, match=missing):
            await robot.connect(timeout=2.0)


async def test_robot_reconnects_but_rejects_a_second_connect():
    async with simulated() as (_, ports):
        robot = Robot(motion_port=ports.motion, state_port=ports.state, remote_port=ports.remote)
        for _ in range(2):
            await robot.connect()
            with pytest.raises(RobotError, match='already connected'):
                await robot.connect()
            await robot.enable()
            await robot.close()
        await robot.close()


# --- I/O --------------------------------------------------------------------------------------


@pytest.mark.invariant(4)
async def test_connect_enables_the_arm_only_with_enable_true():
    async with simulated() as (controller, ports):
        with pytest.raises(ValueError, match='enable = 1: must be True or False'):
            Robot(enable=1)
        asking = Robot(**ports_of(ports), enable=True)
        for robot, enabled in ((Robot(**ports_of(ports)), False), (asking, True)):
            async with robot:
                assert robot.status.enabled is enabled
        controller.apply(Event.ESTOP_PRESS)
        with pytest.raises(RobotError, match='E-stop'):
            await asking.connect()
        with pytest.raises(RobotError, match='no connection'):
            await asking.enable()
        controller.apply(Event.ESTOP_RELEASE)
        async with Robot(**ports_of(ports)) as robot:
            await robot.reset()
            assert not robot.status.enabled
        async with asking:
            controller.apply(Event.ESTOP_PRESS)
            await until(lambda: not asking.status.enabled)
            controller.apply(Event.ESTOP_RELEASE)
            await asking.reset()
            assert not asking.status.enabled


async def test_io_reads_writes_and_rejects_bad_requests():
    async with robot_cell() as (robot, _):
        await robot.io.write('DO', 3, 1)
        assert await robot.io.read('DO', 3) == 1
        assert await robot.io.read('DI', 0) == 0
        with pytest.raises(RobotError, match='DI 9999: the controller has 0 to'):
            await robot.io.read('DI', 9999)
        with pytest.raises(RobotError, match='an input cannot be written'):
            await robot.io.write('DI', 0, 1)
        with pytest.raises(ValueError, match="kind = 'XY'"):
            await robot.io.read('XY', 0)


async def test_io_access_without_an_io_port_is_rejected():
    async with ScriptedController() as controller:
        ports = controller.ports
        async with Robot(motion_port=ports.motion, state_port=ports.state, io_port=0) as robot:
            with pytest.raises(RobotError, match='I/O is not used: its port is 0'):
                await robot.io.read('DI', 0)


def test_gripper_opens_closes_holds_and_reports_stuck_jaws():
    wiring = aio.GripperWiring(open_output=0, close_output=1, opened_input=0, closed_input=1)

    async def scenario():
        async with robot_cell(settings=aio.Settings(gripper=wiring)) as (robot, controller):
            jaws = TwoJaws(controller, wiring)
            assert (await robot.gripper.open()).opened
            assert (await robot.gripper.close()).closed
            await robot.gripper.open()
            jaws.part = True
            assert await robot.gripper.close() == aio.GripperState(False, False)
            assert await robot.gripper.state() == aio.GripperState(False, False)
            jaws.stuck = True
            with pytest.raises(RobotError, match=r'DI 0 \(opened\) did not come on within 2 s'):
                await robot.gripper.open()

    run(scenario())


def test_aborted_motion_is_logged_only_if_never_awaited(caplog):
    gc.collect()  # motions of other tests
    caplog.clear()

    async def scenario():
        async with robot_cell() as (robot, _):
            for awaited in (True, False):
                motion = await moving_slowly(robot)
                assert repr(motion).startswith('<Motion: ')
                await robot.stop()
                assert 'nobody waited' not in caplog.text
                if awaited:
                    assert 'stopped on request' in str(await motion_error(motion.wait()))
                assert 'stopped on request' in repr(motion)
                del motion
            gc.collect()
            assert caplog.text.count('a motion was aborted') == 1
            assert repr(robot) == '<Robot: simulated, c3_a601s, the arm is enabled>'
        assert repr(robot) == '<Robot: simulated, c3_a601s, not connected>'

    run(scenario())


async def test_io_type_names_may_be_lower_case():
    async with robot_cell() as (robot, _):
        await robot.io.write('do', 3, 1)
        assert await robot.io.read('Do', 3) == 1
        assert await robot.io.read('FLAG', 0) == 0
        for wrong in ('dx', 3):
            with pytest.raises(ValueError, match='must be DI or DO'):
                await robot.io.read(wrong, 3)


@pytest.mark.invariant(9)
def test_inv9_gripper_without_any_input_signal_holds_no_object():
    wiring = aio.GripperWiring(open_output=0, close_output=1, opened_input=0, closed_input=1)

    async def scenario():
        async with robot_cell(settings=aio.Settings(gripper=wiring)) as (robot, _):
            with pytest.raises(RobotError, match='has ever been on: check the wiring'):
                await robot.gripper.close()

    run(scenario())


async def test_gripper_without_wiring_is_rejected():
    async with robot_cell() as (robot, _):
        with pytest.raises(RobotError, match='no gripper is configured'):
            await robot.gripper.open()
    with pytest.raises(RobotError, match=r'call connect\(\)'):
        await robot.gripper.open()


@pytest.mark.invariant(5)
async def test_point_rejected_by_the_controller_ends_the_motion():
    async with ScriptedController(reply=lambda sequence: answer(2, sequence)) as controller:
        ports = controller.ports
        async with Robot(motion_port=ports.motion, state_port=ports.state, io_port=0) as robot:
            robot._connection.driver.stopper.goal_reached()
            with robot._connection.driver.gate.enabling() as enabling:
                robot._connection.driver.gate.open(enabling)
            error = await motion_error(robot.move_joints([0.2, 0, 0, 0, 0, 0]))
            assert 'the controller refused point 0 of ' in str(error)


@pytest.mark.invariant(4)
async def test_disable_during_recovery_keeps_the_arm_disabled():
    async with robot_cell() as (robot, controller):
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: robot.status.e_stopped)
        controller.apply(Event.ESTOP_RELEASE)
        recovery = asyncio.create_task(robot.reset(enable=True))
        await asyncio.sleep(0)
        await robot.disable()
        with pytest.raises(RobotError, match='during it and stays disabled; call enable'):
            await recovery
        assert not robot.status.enabled
