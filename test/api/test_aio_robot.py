# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The asynchronous API against the simulated controller: real sockets, virtual time."""

import asyncio
import gc

import numpy as np
import pytest
from support.api_harness import FAR, ports_of, robot_cell
from support.driver_harness import ScriptedController, answer, simulated
from support.event_loop import real_time, run, stand_still, until
from support.examples import one_in
from support.sim_process import vacant_port
from support.two_jaws import TwoJaws

from epson_driver import aio
from epson_driver.aio import MotionError, Robot, RobotError, Settings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_text import parse
from epson_driver.simple_message import IoType

HOME = [0.0] * 6
LONG = [2.0, 0.0, 0.0, 0.0, 0.3, 0.0]
SLOW = 0.02


async def motion_error(coroutine):
    with pytest.raises(MotionError) as caught:
        await coroutine
    return caught.value


async def begun(robot):
    """Begin a long motion and see the arm move."""
    motion = await robot.move_joints(FAR, speed=SLOW, wait=False)
    await until(lambda: robot.joints[0] > 0.01)
    return motion


# --- moving -----------------------------------------------------------------------------------


@pytest.mark.parametrize('profile', ['simulated', 'rc700a', 'generic', 'fanuc', 'abb', 'motoman'])
@pytest.mark.invariant(5)
def test_a_move_ends_at_its_target_on_every_kind_of_controller(profile):
    async def scenario():
        own_speed = Settings(require_planned_speed=profile != 'fanuc')
        async with robot_cell(profile=profile, settings=own_speed) as (robot, _):
            motion = await robot.move_joints([0.3, 0.1, -0.1, 0.2, 0.4, -0.3])
            assert motion.done
            assert motion.progress == 1.0
            assert motion.text.startswith('at the goal after')
            assert np.abs(robot.joints - [0.3, 0.1, -0.1, 0.2, 0.4, -0.3]).max() < 0.01

    run(scenario())


@pytest.mark.invariant(2)
def test_a_share_of_the_speed_is_what_the_arm_does():
    async def scenario():
        async with robot_cell() as (robot, _):
            fastest = np.zeros(6)
            motion = await robot.move_joints([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], speed=0.1, wait=False)
            while not motion.done:
                fastest = np.maximum(fastest, np.abs(robot.joint_velocities))
                await asyncio.sleep(0.01)
            await motion.wait()
            limit = robot.model.limits.velocity[0]
            assert 0.08 * limit < fastest[0] < 0.105 * limit

    run(scenario())


def test_a_trajectory_in_another_joint_order_is_executed():
    async def scenario():
        async with robot_cell() as (robot, _):
            names = robot.model.joint_names[::-1]
            rows = np.linspace(0.0, 0.3, 4)[:, None] * [0, 0, 0, 0, 0, 1.0]
            await robot.move_trajectory([0.0, 0.5, 1.0, 1.5], rows, joint_names=names)
            assert np.abs(robot.joints - [0.3, 0, 0, 0, 0, 0]).max() < 0.01

    run(scenario())


def test_a_move_to_where_the_arm_is_succeeds_at_once():
    async def scenario():
        async with robot_cell() as (robot, _):
            assert (await robot.move_joints(robot.joints)).text.startswith('at the goal')

    run(scenario())


def test_the_pose_is_that_of_the_measured_joints():
    async def scenario():
        async with robot_cell(enabled=False) as (robot, _):
            assert np.allclose(robot.pose @ np.linalg.inv(robot.pose), np.eye(4))
            assert robot.pose.shape == (4, 4)
            assert np.allclose(robot.frames['base'] @ robot.epson_point.pose, robot.pose)
            assert np.allclose(robot.ros_pose[:3], robot.pose[:3, 3])

    run(scenario())


@pytest.mark.invariant(6)
def test_joints_that_are_too_old_are_not_told_and_newer_ones_are_caught_up_with():
    async def scenario():
        async with robot_cell() as (robot, _):
            for read in (lambda: robot.joints, lambda: robot.joint_velocities, lambda: robot.pose):
                stand_still(1.0)
                with pytest.raises(RobotError, match=r'the newest joint state is .* s old'):
                    read()
                await robot.catch_up()
                read()
            stand_still(1.0)
            await robot.move_joints([0.1, 0, 0, 0, 0, 0])

    run(scenario())


@pytest.mark.invariant(6)
def test_what_is_measured_is_as_of_when_it_came_however_long_the_process_is_held_up():
    """Between catching up and reading, too; the joints of a silent controller are still old."""

    async def scenario():
        async with robot_cell() as (robot, controller):

            def held_up():
                stand_still(1.0)
                return robot.joints

            stand_still(1.0)
            assert len(await robot.measured(held_up)) == 6
            with pytest.raises(RobotError, match=r'the newest joint state is .* s old'):
                held_up()
            await robot.catch_up()
            controller.faults.start(parse('half_open port=state for=30'))
            await asyncio.sleep(0.4)  # and 0.5 s of waiting: the link is lost after 1 s
            with pytest.raises(RobotError, match=r'the newest joint state is .* s old'):
                await robot.measured(lambda: robot.joints)

    run(scenario())


def test_progress_grows_and_canceling_stops_the_arm():
    async def scenario():
        async with robot_cell() as (robot, _):
            motion = await begun(robot)
            before = motion.progress
            assert 0.0 < before < 1.0
            await until(lambda: motion.progress > before)
            assert await motion.cancel() == 'canceled; the arm stands'
            assert motion.done
            assert not robot.status.moving
            assert (await motion_error(motion.wait())).end is End.CANCELED
            await motion.cancel()  # nothing more
            await robot.move_joints(HOME)

    run(scenario())


@pytest.mark.invariant(3)
def test_a_caller_that_is_cancelled_stops_the_arm_before_it_ends():
    async def scenario():
        async with robot_cell() as (robot, _):
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(2.0):
                    await robot.move_joints(FAR, speed=SLOW)
            there = robot.joints
            await asyncio.sleep(0.5)
            assert np.array_equal(there, robot.joints)
            assert there[0] < 1.0
            await robot.move_joints(HOME)  # it is still enabled

    run(scenario())


def test_giving_up_waiting_does_not_end_a_motion():
    async def scenario():
        async with robot_cell() as (robot, _):
            motion = await robot.move_joints([0.5, 0, 0, 0, 0, 0], speed=0.1, wait=False)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(motion.wait(), 0.2)
            assert 'at the goal' in await motion.wait()

    run(scenario())


def test_speed_scaling_pauses_and_is_refused_out_of_range():
    async def scenario():
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

    run(scenario())


async def begun_slowly(robot, way):
    """Begin a motion of several seconds with few points."""
    if way == 'joints':
        return await robot.move_joints(LONG, speed=0.08, wait=False)
    if way == 'waypoints':
        with real_time():  # a worker plans
            return await robot.move_waypoints([LONG], speed=0.08, wait=False)
    return await robot.move_trajectory([6.0], [LONG], wait=False)


@pytest.mark.parametrize(
    ('profile', 'smooth', 'way'),
    one_in(
        5,
        [
            ('generic', False, 'waypoints'),
            ('simulated', False, 'joints'),
            ('spel', False, 'joints'),
            ('fanuc', False, 'joints'),
            ('motoman', True, 'trajectory'),
            ('motoman', True, 'waypoints'),
            *(('simulated', True, way) for way in ('joints', 'waypoints', 'trajectory')),
        ],
        several=True,
    ),
)
def test_a_pause_holds_every_motion_and_it_goes_on(profile, smooth, way):
    async def scenario():
        own_speed = Settings(require_planned_speed=profile != 'fanuc')
        async with robot_cell(profile=profile, smooth=smooth, settings=own_speed) as (robot, _):
            motion = await begun_slowly(robot, way)
            await asyncio.sleep(0.7)
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

    run(scenario())


@pytest.mark.slow
@pytest.mark.parametrize('profile', ['simulated', 'generic', 'motoman'])
def test_half_the_speed_acts_on_a_move_that_runs(profile):
    async def scenario():
        async with robot_cell(profile=profile, smooth=profile != 'generic') as (robot, _):
            motion = await begun_slowly(robot, 'joints')
            await asyncio.sleep(0.5)
            robot.set_speed_scaling(0.1)
            await asyncio.sleep(motion.duration)
            assert not motion.done
            robot.set_speed_scaling(1.0)
            await motion.wait()

    run(scenario())


def test_a_controller_that_cannot_be_slowed_says_so():
    async def scenario():
        async with robot_cell(profile='abb') as (robot, _):
            motion = await begun_slowly(robot, 'joints')
            await asyncio.sleep(0.7)
            for factor in (0.0, 0.5):
                with pytest.raises(RobotError, match=r'the controller has all points'):
                    robot.set_speed_scaling(factor)
            assert robot.speed_scaling == 1.0
            await motion.wait()
        async with robot_cell(profile='fanuc') as (robot, _):
            with pytest.raises(RobotError, match=r'factor = 0\.5: this kind of controller i'):
                robot.set_speed_scaling(0.5)
            error = await motion_error(robot.move_joints(FAR, speed=0.01))
            assert 'override of its pendant' in str(error)
            assert 'require_planned_speed=False' in str(error)

    run(scenario())


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.invariant(1, 4)
def test_a_move_before_enable_is_refused_with_what_to_do():
    async def scenario():
        async with robot_cell(enabled=False) as (robot, _):
            error = await motion_error(robot.move_joints(FAR))
            assert 'the arm is not enabled' in str(error)
            assert 'call enable()' in str(error)
            assert error.code is ErrorCode.INVALID_GOAL
            await asyncio.sleep(1.0)
            assert not robot.joints.any()

    run(scenario())


def test_a_move_while_another_runs_is_refused_and_that_one_goes_on():
    async def scenario():
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

    run(scenario())


@pytest.mark.invariant(1)
def test_a_trajectory_that_begins_elsewhere_is_refused():
    async def scenario():
        async with robot_cell() as (robot, _):
            error = await motion_error(robot.move_trajectory([0.0, 5.0], [FAR, HOME]))
            assert 'the trajectory starts at 1.5 rad, the joint is at 0 rad' in str(error)

    run(scenario())


# --- what stops the arm -----------------------------------------------------------------------


@pytest.mark.invariant(3, 4, 5)
def test_an_estop_ends_the_motion_and_only_enable_lets_the_arm_move_again():
    async def scenario():
        pressed, errors = [], []
        async with robot_cell() as (robot, controller):
            robot.on_estop(pressed.append)
            robot.on_error(errors.append)
            motion = await begun(robot)
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
            assert 'not enabled' in str(await motion_error(robot.move_joints(HOME)))
            assert await robot.reset(enable=True) == 'the arm is enabled'
            await robot.move_joints(HOME)

    run(scenario())


def test_a_controller_that_is_paused_says_so_and_what_helps():
    async def scenario():
        async with robot_cell() as (robot, controller):
            await begun(robot)
            controller.apply(Event.PAUSE)
            await until(lambda: robot.status.paused)
            assert robot.status.text.startswith('the controller is paused')
            assert robot.status.remedy == 'continue at the controller, or start main'

    run(scenario())


def test_an_error_of_the_controller_is_told_with_its_meaning_and_remedy():
    async def scenario():
        errors = []
        async with robot_cell() as (robot, controller):
            robot.on_error(errors.append)
            motion = await begun(robot)
            controller.servo_error(0)
            assert 'error' in str(await motion_error(motion.wait()))
            (error,) = errors
            assert error.number
            assert str(error.number) in error.text
            assert robot.status.error == error
            await until(lambda: not robot.status.moving)
            await robot.reset()
            assert errors[1:] == [None]

    run(scenario())


@pytest.mark.invariant(3, 4, 5, 6)
def test_a_cut_link_ends_the_motion_and_joints_are_not_told_any_more():
    async def scenario():
        links = []
        async with robot_cell() as (robot, controller):
            robot.on_link(lambda name, _why: links.append(name))
            motion = await begun(robot)
            controller.faults.start(parse('cut port=state for=0.5'))
            assert 'the state link was lost' in str(await motion_error(motion.wait()))
            with pytest.raises(RobotError, match='no joint state'):
                _ = robot.joints
            await until(lambda: links and links[-1] == 'connected')
            assert 'backing_off' in links
            assert 'not enabled' in str(await motion_error(robot.move_joints(HOME)))

    run(scenario())


@pytest.mark.invariant(3, 9)
def test_a_callback_that_raises_stops_the_arm_and_is_reported():
    async def scenario():
        reported = []
        asyncio.get_running_loop().set_exception_handler(
            lambda _loop, context: reported.append(str(context['exception']))
        )
        async with robot_cell() as (robot, controller):
            motion = await begun(robot)

            def fail(_name, _why):
                raise ZeroDivisionError('mine')

            robot.on_link(fail)
            controller.faults.start(parse('cut port=motion for=0.5'))
            await motion_error(motion.wait())
            assert not robot.status.enabled
            assert 'mine' in reported

    run(scenario())


def test_a_callback_can_be_taken_away():
    async def scenario():
        told = []
        async with robot_cell() as (robot, controller):
            with pytest.raises(aio.ArgumentError, match='callback = 3: must be a function'):
                robot.on_estop(3)
            remove = robot.on_estop(told.append)
            remove()
            remove()
            controller.apply(Event.ESTOP_PRESS)
            await until(lambda: robot.status.e_stopped)
            assert told == []

    run(scenario())


@pytest.mark.invariant(3)
@pytest.mark.parametrize('error', [ZeroDivisionError, KeyboardInterrupt, None])
def test_leaving_the_block_stops_the_arm(error):
    async def scenario():
        async with simulated() as (controller, ports):
            robot = Robot(
                motion_port=ports.motion, state_port=ports.state, remote_port=ports.remote
            )
            try:
                async with robot:
                    await robot.enable()
                    motion = await begun(robot)
                    if error is not None:
                        raise error
            except (ZeroDivisionError, KeyboardInterrupt):
                pass
            assert motion.text == 'stopped on request; the arm stands'
            there = controller.arm.commanded
            await asyncio.sleep(1.0)
            assert np.array_equal(there, controller.arm.commanded)
            with pytest.raises(RobotError, match=r'no connection .*call connect\(\)'):
                _ = robot.joints

    run(scenario())


@pytest.mark.invariant(9)
def test_a_driver_that_ends_by_itself_is_said_and_the_motion_has_its_outcome(monkeypatch):
    async def scenario():
        reported = []
        asyncio.get_running_loop().set_exception_handler(
            lambda _loop, context: reported.append(context)
        )
        async with robot_cell() as (robot, _):
            motion = await begun(robot)

            def fail(_sample, _now):
                raise ZeroDivisionError('a defect')

            monkeypatch.setattr(robot._connection.driver.goal_queue, 'on_joints', fail)
            await motion_error(motion.wait())
            await until(lambda: robot._connection.task.done())
            with pytest.raises(RobotError, match=r'the driver has ended .*a defect'):
                await robot.enable()
            assert reported

    run(scenario())


# --- connecting -------------------------------------------------------------------------------


def test_connect_says_that_nothing_listens():
    async def scenario():
        port = vacant_port()
        robot = Robot(motion_port=port, state_port=port, io_port=0)
        with pytest.raises(RobotError) as caught:
            await robot.connect(timeout=2.0)
        assert f'state link to port {port}' in str(caught.value)
        assert 'refused' in str(caught.value)
        assert 'check host and ports' in str(caught.value)

    run(scenario())


@pytest.mark.parametrize(
    ('shows', 'missing'),
    [('shows_joints', 'no joint state'), ('shows_status', 'sends no STATUS')],
)
def test_connect_says_what_the_controller_does_not_tell(shows, missing):
    async def scenario():
        async with ScriptedController() as controller:
            setattr(controller, shows, False)
            ports = controller.ports
            robot = Robot(motion_port=ports.motion, state_port=ports.state, io_port=0)
            with pytest.raises(RobotError, match=missing):
                await robot.connect(timeout=2.0)

    run(scenario())


def test_a_robot_can_be_connected_again_but_not_twice():
    async def scenario():
        async with simulated() as (_, ports):
            robot = Robot(
                motion_port=ports.motion, state_port=ports.state, remote_port=ports.remote
            )
            for _ in range(2):
                await robot.connect()
                with pytest.raises(RobotError, match='connected already'):
                    await robot.connect()
                await robot.enable()
                await robot.close()
            await robot.close()

    run(scenario())


# --- I/O --------------------------------------------------------------------------------------


@pytest.mark.invariant(4)
async def test_connecting_enables_the_arm_only_where_that_is_asked_for_and_can_be():
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
        with pytest.raises(RobotError, match='there is no connection'):
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


def test_io_is_read_and_written_and_refused_in_the_driver_s_words():
    async def scenario():
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

    run(scenario())


def test_without_an_io_port_a_request_says_so():
    async def scenario():
        async with ScriptedController() as controller:
            ports = controller.ports
            async with Robot(motion_port=ports.motion, state_port=ports.state, io_port=0) as robot:
                with pytest.raises(RobotError, match='I/O is not used: its port is 0'):
                    await robot.io.read('DI', 0)

    run(scenario())


@pytest.mark.parametrize('profile', one_in(2, ['rc700a', 'spel', 'motoman']))
def test_io_is_the_same_by_every_way_to_it(profile):
    async def scenario():
        async with robot_cell(profile=profile, enabled=False) as (robot, controller):
            controller.io.set_input(IoType.DIGITAL_INPUT, 3, 1)
            await until(lambda: not robot._connection.driver.io.reason)
            assert await robot.io.read('DI', 3) == 1
            await robot.io.write('DO', 3, 1)
            assert await robot.io.read('DO', 3) == 1
            with pytest.raises(RobotError, match='DI 9999: the controller has 0 to'):
                await robot.io.read('DI', 9999)

    run(scenario())


def test_a_gripper_opens_and_closes_and_says_why_it_does_not():
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


def test_a_gripper_of_which_no_input_was_ever_on_is_not_closed():
    wiring = aio.GripperWiring(open_output=0, close_output=1, opened_input=0, closed_input=1)

    async def scenario():
        async with robot_cell(settings=aio.Settings(gripper=wiring)) as (robot, _):
            with pytest.raises(RobotError, match='has ever been on: check the wiring'):
                await robot.gripper.close()

    run(scenario())


def test_a_motion_that_is_aborted_is_logged_only_if_nobody_ever_asks(caplog):
    gc.collect()  # motions of other tests
    caplog.clear()

    async def scenario():
        async with robot_cell() as (robot, _):
            for asked in (True, False):
                motion = await begun(robot)
                assert repr(motion).startswith('<Motion: ')
                await robot.stop()
                assert 'nobody waited' not in caplog.text
                if asked:
                    assert 'stopped on request' in str(await motion_error(motion.wait()))
                assert 'stopped on request' in repr(motion)
                del motion
            gc.collect()
            assert caplog.text.count('a motion that nobody waited for was aborted') == 1
            assert repr(robot) == '<Robot: simulated, c3_a601s, the arm is enabled>'
        assert repr(robot) == '<Robot: simulated, c3_a601s, not connected>'

    run(scenario())


def test_io_kinds_may_be_in_small_letters():
    async def scenario():
        async with robot_cell() as (robot, _):
            await robot.io.write('do', 3, 1)
            assert await robot.io.read('Do', 3) == 1
            assert await robot.io.read('FLAG', 0) == 0
            for wrong in ('dx', 3):
                with pytest.raises(ValueError, match='must be DI or DO'):
                    await robot.io.read(wrong, 3)

    run(scenario())


def test_without_a_wiring_there_is_no_gripper():
    async def scenario():
        async with robot_cell() as (robot, _):
            with pytest.raises(RobotError, match='no gripper is known'):
                await robot.gripper.open()
        with pytest.raises(RobotError, match=r'call connect\(\)'):
            await robot.gripper.open()

    run(scenario())


@pytest.mark.invariant(5)
def test_a_point_that_the_controller_refuses_ends_the_motion_with_its_words():
    async def scenario():
        async with ScriptedController(reply=lambda sequence: answer(2, sequence)) as controller:
            ports = controller.ports
            async with Robot(motion_port=ports.motion, state_port=ports.state, io_port=0) as robot:
                robot._connection.driver.stopper.goal_reached()
                with robot._connection.driver.gate.enabling() as enabling:
                    robot._connection.driver.gate.open(enabling)
                error = await motion_error(robot.move_joints([0.2, 0, 0, 0, 0, 0]))
                assert 'the controller refused point 0 of 1' in str(error)

    run(scenario())


@pytest.mark.parametrize('count', [10, pytest.param(100, marks=pytest.mark.slow)])
def test_moves_leave_no_task_behind(count):
    async def scenario():
        async with robot_cell() as (robot, _):
            await robot.move_joints([0.01, 0, 0, 0, 0, 0])
            before = len(asyncio.all_tasks())
            for index in range(count):
                await robot.move_joints([0.01 * (index % 2), 0, 0, 0, 0, 0])
            assert len(asyncio.all_tasks()) <= before

    run(scenario(), patience=600.0)


def test_the_public_names_are_those_of_the_synchronous_door():
    from epson_driver import robot

    assert robot.__all__ == aio.__all__

    def public(kind):
        return {name for name in dir(kind) if not name.startswith('_')}

    own = {'catch_up', 'measured'}
    for name in ('Robot', 'Motion', 'Io', 'Gripper'):
        missing = public(getattr(aio, name)) - public(getattr(robot, name)) - own
        assert missing <= {'begin', 'finish'}, name


def test_whatever_is_wrong_with_a_motion_is_a_robot_error():
    async def scenario():
        async with robot_cell() as (robot, _):
            for wrong in (
                robot.move_joints([9.0] * 6),
                robot.move_joints(None),
                robot.move_joints([0.0] * 6, speed=2.0),
                robot.move_waypoints([]),
                robot.move_waypoints([[0.0] * 5]),
                robot.move_trajectory([1.0], [['a'] * 6]),
                robot.move_trajectory([1.0], [[0.0] * 6], joint_names=['a']),
                robot.move_line('here'),
                robot.move_line(robot.pose, frame='tabel'),
                robot.move_arc([0.0], robot.pose),
                robot.move_path([]),
            ):
                with pytest.raises(aio.ArgumentError) as caught:
                    await wrong
                assert isinstance(caught.value, RobotError)
                assert isinstance(caught.value, ValueError)

    run(scenario())


@pytest.mark.invariant(4)
async def test_a_disable_during_a_recovery_keeps_the_arm_disabled():
    async with robot_cell() as (robot, controller):
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: robot.status.e_stopped)
        controller.apply(Event.ESTOP_RELEASE)
        recovery = asyncio.create_task(robot.reset(enable=True))
        await asyncio.sleep(0)
        await robot.disable()
        with pytest.raises(RobotError, match='disabled meanwhile, and stays so; call enable'):
            await recovery
        assert not robot.status.enabled
