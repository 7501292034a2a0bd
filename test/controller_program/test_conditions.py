# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""E-stop, door, errors, lost clients, starts: nothing moves until it is enabled again."""

from collections.abc import Callable

import pytest
from support.robot_program import (
    FILES,
    IO_PORT,
    MOTION_PORT,
    STATE_PORT,
    Client,
    RobotHarness,
    SimpleRobot,
    TaskType,
    moved,
    point,
    request,
)

from epson_driver.simple_message import (
    IoSetting,
    IoType,
    JointTrajPt,
    Ping,
    ReplyCode,
    SpecialSequence,
    reply,
)
from epson_driver.simple_message.io_messages import IoWrite
from epson_driver.spel import SpelError

OK, FAILURE = 1, 2
STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)


def line(harness: RobotHarness, count: int, step: float = 20.0, duration: float = 1.0):
    start = harness.robot.position
    return [point(n, moved(start, j1=step * (n + 1)), duration) for n in range(count)]


def moving(harness: RobotHarness) -> Client:
    """Return a client whose trajectory of six points is at its first one."""
    client = harness.client()
    assert harness.stream(client, line(harness, 6)) == [(n, OK) for n in range(6)]
    harness.run(0.6)
    assert harness.robot.move_now is not None
    return client


def assert_still(harness: RobotHarness, seconds: float = 3.0) -> None:
    """Assert that the arm does not move and no Go starts."""
    started, where = len(harness.robot.gone_to), harness.robot.position
    harness.run(seconds)
    assert len(harness.robot.gone_to) == started
    assert harness.robot.position == where


def assert_works(harness: RobotHarness, client: Client) -> None:
    """Assert that only a new trajectory is executed."""
    assert harness.stream(client, [point(6, harness.robot.position)]) == [(6, FAILURE)]
    points = line(harness, 3, -5.0, 0.3)
    assert harness.stream(client, points) == [(n, OK) for n in range(3)]
    started = len(harness.robot.gone_to)
    harness.rest()
    assert len(harness.robot.gone_to) >= started
    assert abs(harness.robot.position[0] - points[-1].joints[0] * 57.29577951308232) < 1e-4


@pytest.mark.invariant(4)
def test_inv4_nothing_moves_after_an_estop_until_enabled() -> None:
    harness = RobotHarness()
    client = moving(harness)
    harness.press_estop()
    assert_still(harness)
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    harness.robot.states['estopon'] = 0
    assert_still(harness)
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    harness.robot.motors = True
    assert_still(harness)
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    harness.enable()
    assert_still(harness)
    assert_works(harness, client)
    assert harness.robot.failures == []


def test_points_waiting_at_an_estop_are_never_executed() -> None:
    """main drops the points in the ring without help of a server."""
    harness = RobotHarness()
    moving(harness)
    harness.press_estop()
    harness.robot.states['estopon'] = 0
    harness.robot.motors = True
    harness.start_main()
    assert_still(harness)


def test_points_not_yet_passed_to_main_are_dropped_at_an_estop() -> None:
    """main waits until MotionServer has dropped its points too."""
    harness = RobotHarness(LOOK_AHEAD='2')
    client = harness.client()
    client.send(*(request(item) for item in line(harness, 6)))
    harness.run(0.6)
    assert client.replies() == [(0, OK), (1, OK)]
    harness.press_estop()
    harness.robot.states['estopon'] = 0
    harness.robot.motors = True
    harness.start_main()
    assert_still(harness)
    assert client.replies() == [(n, FAILURE) for n in range(2, 6)]


def test_motors_off_in_a_pause_drops_the_points() -> None:
    harness = RobotHarness()
    client = harness.client()
    harness.machine.pause()
    assert harness.stream(client, line(harness, 3)) == [(n, OK) for n in range(3)]
    harness.robot.halt()
    harness.run(0.1)
    harness.robot.motors = True
    harness.machine.resume()
    assert_still(harness)
    assert_works(harness, client)


def test_motors_off_and_on_drops_the_points() -> None:
    harness = RobotHarness()
    client = moving(harness)
    harness.robot.halt()
    harness.run(0.1)
    harness.robot.motors = True
    assert_still(harness)
    assert_works(harness, client)


@pytest.mark.invariant(4)
def test_inv4_open_door_ends_main_and_the_motion() -> None:
    harness = RobotHarness()
    client = moving(harness)
    harness.robot.states['safetyon'] = -1
    harness.machine.pause()
    harness.robot.halt()
    harness.run(0.5)
    assert not harness.task(1)
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    harness.robot.states['safetyon'] = 0
    harness.robot.motors = True
    harness.machine.resume()
    assert_still(harness)
    harness.enable()
    assert_works(harness, client)


def test_without_door_ends_motion_the_door_pauses() -> None:
    harness = RobotHarness(DOOR_ENDS_MOTION='')
    moving(harness)
    harness.robot.states.update(safetyon=-1, pauseon=-1)
    harness.machine.pause()
    harness.run(0.5)
    assert harness.task(1)
    harness.robot.states.update(safetyon=0, pauseon=0)
    harness.machine.resume()
    harness.rest()
    assert len(harness.robot.gone_to) == 6


def test_stop_works_in_a_pause() -> None:
    harness = RobotHarness()
    client = harness.client()
    harness.robot.states['pauseon'] = -1
    harness.machine.pause()
    assert harness.stream(client, line(harness, 3)) == [(n, OK) for n in range(3)]
    assert_still(harness, 1.0)
    assert harness.stream(client, [STOP]) == [(-4, OK)]
    harness.robot.states['pauseon'] = 0
    harness.machine.resume()
    assert_still(harness)
    assert_works(harness, client)


@pytest.mark.invariant(4)
def test_inv4_lost_client_stops_the_arm_and_switches_motors_off() -> None:
    harness = RobotHarness()
    client = moving(harness)
    client.leave()
    harness.run(0.5)
    assert harness.robot.move_now is None
    assert not harness.robot.motors
    assert_still(harness)
    client = harness.client()
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    harness.robot.motors = True
    harness.run(0.1)
    assert_still(harness)
    assert_works(harness, client)


def test_config_may_keep_the_motors_on() -> None:
    harness = RobotHarness(LOST_CLIENT_MOTORS_OFF='')
    client = moving(harness)
    client.leave()
    harness.run(0.5)
    assert harness.robot.move_now is None
    assert harness.robot.motors
    assert_still(harness)
    assert_works(harness, harness.client())


def test_port_listens_again_after_each_client() -> None:
    harness = RobotHarness(LOST_CLIENT_MOTORS_OFF='')
    for _ in range(4):
        client = harness.client()
        assert harness.stream(client, line(harness, 2, 1.0, 0.1)) == [(0, OK), (1, OK)]
        client.leave()
        harness.run(0.6)
    assert harness.robot.failures == []


@pytest.mark.parametrize('number', [4001, 4031, 4242, 2999])
def test_failed_motion_drops_the_points_and_main_continues(number: int) -> None:
    harness = RobotHarness()
    client = harness.client()
    harness.robot.fails_with = number
    assert harness.stream(client, line(harness, 3))[0] == (0, OK)
    harness.run(0.5)
    assert harness.shared('g_main_error') == number
    assert harness.robot.failures == []
    assert_still(harness)
    assert_works(harness, client)


def test_failed_later_motion_drops_the_points() -> None:
    harness = RobotHarness()
    client = moving(harness)
    harness.robot.fails_with = 4242
    harness.rest()
    assert harness.shared('g_main_error') == 4242
    assert_works(harness, client)


def test_stop_bit_set_by_another_program_is_an_error() -> None:
    harness = RobotHarness()
    client = moving(harness)
    world = harness.machine.world
    world.host.write_bits(next(m for m in harness.robot.bits if m.value == 'memory'), 500, 1, 1)
    harness.run(0.5)
    assert harness.robot.move_now is None
    assert harness.shared('g_main_error') == 8003
    assert_still(harness)
    assert_works(harness, client)


def test_power_is_high_only_in_motion_with_full_power() -> None:
    harness = RobotHarness()
    assert not harness.robot.power
    moving(harness)
    assert harness.robot.power
    assert 'Low power' not in ''.join(harness.robot.printed)
    low = RobotHarness(FULL_POWER='')
    moving(low)
    assert not low.robot.power
    assert low.robot.printed == [
        'Low power, slower than planned: FULL_POWER is off in config.inc\n'
    ]


@pytest.mark.invariant(2)
def test_inv2_shipped_program_uses_low_power() -> None:
    assert "\n'#define FULL_POWER 1\n" in FILES['config.inc']


def test_program_never_switches_motors_on() -> None:
    harness = RobotHarness()
    moving(harness)
    harness.press_estop()
    harness.enable()
    harness.run(1.0)
    assert [words for name, _, words in harness.robot.commands if name == 'motor'] == []
    assert {name for name, _, _ in harness.robot.commands} <= {
        'power',
        'speed',
        'accel',
        'waitpos',
    }


def test_main_reports_missing_tables() -> None:
    """Background tasks are off, or main has cleared the global variables."""
    harness = RobotHarness(ready=False)
    harness.machine.clear_variables()
    harness.machine.start('main', clear=False)
    harness.run(6.0)
    (failure,) = harness.robot.failures
    assert (failure.number, failure.position.file) == (8002, 'main.prg')


def test_ended_server_is_restarted() -> None:
    harness = RobotHarness()
    for number in (66, 67, 68):
        harness.machine.world.end(harness.machine.world.tasks[number])
    harness.run(0.5)
    assert all(harness.task(number) for number in (66, 67, 68))
    client = harness.client()
    assert harness.stream(client, line(harness, 2)) == [(0, OK), (1, OK)]


def test_used_task_number_does_not_end_bgmain() -> None:
    harness = RobotHarness()
    world = harness.machine.world
    world.end(world.tasks[66])
    harness.machine.start('MoveAll', 66, TaskType.TRAP, clear=False)
    harness.run(0.5)
    assert harness.task(65)
    world.end(world.tasks[66])
    harness.run(0.5)
    assert harness.task(66)


@pytest.mark.parametrize('port', [STATE_PORT, MOTION_PORT, IO_PORT])
def test_failed_write_ends_the_connection_not_the_server(port: int) -> None:
    """Error 2902 ends the connection, not the server."""
    harness = RobotHarness()
    client = harness.client(port)
    harness.robot.sends = False
    client.send(request(STOP))
    harness.run(0.5)
    harness.robot.sends = True
    assert not client.open
    client = harness.client(port)
    client.packets()
    client.send(request(Ping()))
    harness.run(0.3)
    assert reply(Ping(), ReplyCode.SUCCESS) in client.packets()


@pytest.mark.invariant(4)
def test_inv4_start_main_needs_motors_on() -> None:
    harness = RobotHarness(ready=False, START_MAIN='1')
    harness.run(1.0)
    assert not harness.task(1)
    harness.robot.motors = True
    harness.run(0.5)
    assert harness.task(1)
    client = moving(harness)
    harness.press_estop()
    harness.robot.states['estopon'] = 0
    assert_still(harness)
    assert not harness.task(1)
    harness.robot.motors = True
    assert_still(harness)
    assert harness.task(1)
    assert_works(harness, client)


def test_without_background_tasks_main_starts_the_servers() -> None:
    """The servers are NoEmgAbort and survive an E-stop."""
    harness = RobotHarness(NO_BACKGROUND='1')
    assert [view.number for view in harness.machine.tasks()] == [1, 2, 3, 4]
    state = harness.client(STATE_PORT)
    client = moving(harness)
    harness.press_estop()
    harness.run(0.2)
    assert [view.number for view in harness.machine.tasks()] == [2, 3, 4]
    state.packets()
    harness.run(0.5)
    assert state.packets()
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    harness.robot.states['estopon'] = 0
    harness.robot.motors = True
    harness.start_main()
    assert_still(harness)
    assert_works(harness, client)


def failing_function(number: int = 2002) -> Callable[..., None]:
    """Return a function of the robot that fails."""

    def refuse(*_: object) -> None:
        raise SpelError(number, 'refused')

    return refuse


def test_error_between_two_clients_ends_no_server() -> None:
    """Dropping points and switching outputs off may fail. The servers continue."""
    harness = RobotHarness()
    motion, io = harness.client(MOTION_PORT), harness.client(IO_PORT)
    harness.stream(motion, [point(0, harness.robot.position)])
    io.send(request(IoWrite(1, (IoSetting(IoType.DIGITAL_OUTPUT, 3, 1),))))
    harness.run(0.1)
    writes, harness.robot.write_bits = harness.robot.write_bits, failing_function()
    motion.leave()
    io.leave()
    harness.run(1.0)
    harness.robot.write_bits = writes
    harness.run(0.5)
    assert harness.robot.failures == []
    assert harness.client(MOTION_PORT).open
    assert {66, 67, 68} <= harness.machine.world.tasks.keys()


def test_main_waits_for_tables_that_cannot_be_filled() -> None:
    values, SimpleRobot.value = SimpleRobot.value, failing_function()  # type: ignore[assignment]
    try:
        harness = RobotHarness(ready=False)
    finally:
        SimpleRobot.value = values
    harness.robot.motors = True
    harness.start_main()
    harness.run(6.0)
    assert [failure.number for failure in harness.robot.failures] == [8002]
