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
    IoWrite,
    JointTrajPt,
    Ping,
    ReplyCode,
    SpecialSequence,
    reply,
)
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
    """Nothing moves for a time, and no Go begins."""
    begun, where = len(harness.robot.gone_to), harness.robot.position
    harness.run(seconds)
    assert len(harness.robot.gone_to) == begun
    assert harness.robot.position == where


def assert_works(harness: RobotHarness, client: Client) -> None:
    """The rest of the old trajectory is refused, a new one is executed."""
    assert harness.stream(client, [point(6, harness.robot.position)]) == [(6, FAILURE)]
    points = line(harness, 3, -5.0, 0.3)
    assert harness.stream(client, points) == [(n, OK) for n in range(3)]
    begun = len(harness.robot.gone_to)
    harness.rest()
    assert len(harness.robot.gone_to) >= begun
    assert abs(harness.robot.position[0] - points[-1].joints[0] * 57.29577951308232) < 1e-4


def test_nothing_moves_after_an_estop_until_it_is_enabled() -> None:
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


def test_points_that_wait_at_an_estop_are_never_executed_even_if_all_is_quick() -> None:
    """main drops what is in the ring by itself: no server needs to have seen the E-stop."""
    harness = RobotHarness()
    moving(harness)
    harness.press_estop()
    harness.robot.states['estopon'] = 0
    harness.robot.motors = True
    harness.start_main()
    assert_still(harness)


def test_nor_are_those_that_main_has_not_got_yet() -> None:
    """main waits until MotionServer has dropped them too."""
    harness = RobotHarness(LOOK_AHEAD='2')
    client = harness.client()
    client.send(*(request(each) for each in line(harness, 6)))
    harness.run(0.6)
    assert client.replies() == [(0, OK), (1, OK)]
    harness.press_estop()
    harness.robot.states['estopon'] = 0
    harness.robot.motors = True
    harness.start_main()
    assert_still(harness)
    assert client.replies() == [(n, FAILURE) for n in range(2, 6)]


def test_motors_off_in_a_pause_drop_the_points_too() -> None:
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


def test_motors_off_and_on_drop_the_points() -> None:
    harness = RobotHarness()
    client = moving(harness)
    harness.robot.halt()
    harness.run(0.1)
    harness.robot.motors = True
    assert_still(harness)
    assert_works(harness, client)


def test_an_open_door_ends_main_and_the_motion() -> None:
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


def test_without_door_ends_motion_the_door_is_a_pause() -> None:
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


def test_in_a_pause_points_wait_and_a_stop_works() -> None:
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


def test_a_lost_client_stops_the_arm_and_switches_the_motors_off() -> None:
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


def test_the_motors_stay_on_if_config_says_so() -> None:
    harness = RobotHarness(LOST_CLIENT_MOTORS_OFF='')
    client = moving(harness)
    client.leave()
    harness.run(0.5)
    assert harness.robot.move_now is None
    assert harness.robot.motors
    assert_still(harness)
    assert_works(harness, harness.client())


def test_the_port_listens_again_after_each_client() -> None:
    harness = RobotHarness(LOST_CLIENT_MOTORS_OFF='')
    for _ in range(4):
        client = harness.client()
        assert harness.stream(client, line(harness, 2, 1.0, 0.1)) == [(0, OK), (1, OK)]
        client.leave()
        harness.run(0.6)
    assert harness.robot.failures == []


@pytest.mark.parametrize('number', [4001, 4031, 4242, 2999])
def test_a_motion_that_fails_drops_the_points_and_main_goes_on(number: int) -> None:
    harness = RobotHarness()
    client = harness.client()
    harness.robot.fails_with = number
    assert harness.stream(client, line(harness, 3))[0] == (0, OK)
    harness.run(0.5)
    assert harness.shared('g_main_error') == number
    assert harness.robot.failures == []
    assert_still(harness)
    assert_works(harness, client)


def test_a_later_motion_that_fails_drops_the_points() -> None:
    harness = RobotHarness()
    client = moving(harness)
    harness.robot.fails_with = 4242
    harness.rest()
    assert harness.shared('g_main_error') == 4242
    assert_works(harness, client)


def test_the_stop_bit_of_somebody_else_stops_and_is_an_error() -> None:
    harness = RobotHarness()
    client = moving(harness)
    world = harness.machine.world
    world.host.write_bits(next(m for m in harness.robot.bits if m.value == 'memory'), 500, 1, 1)
    harness.run(0.5)
    assert harness.robot.move_now is None
    assert harness.shared('g_main_error') == 8003
    assert_still(harness)
    assert_works(harness, client)


def test_power_is_high_only_when_it_moves_and_only_with_the_switch() -> None:
    harness = RobotHarness()
    assert not harness.robot.power
    moving(harness)
    assert harness.robot.power
    assert 'Low power' not in ''.join(harness.robot.printed)
    low = RobotHarness(FULL_POWER='')
    moving(low)
    assert not low.robot.power
    assert low.robot.printed == [
        'Low power, slower than asked for: FULL_POWER is off in config.inc\n'
    ]


def test_the_program_is_shipped_for_a_first_run_at_low_power() -> None:
    """Invariant 2, on a machine that nobody has tried it on: full power is switched on."""
    assert "\n'#define FULL_POWER 1\n" in FILES['config.inc']


def test_main_switches_no_motors_on_and_the_servers_run_no_robot_command() -> None:
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


def test_main_says_what_is_missing_without_its_tables() -> None:
    """Background tasks are off, or main has cleared the global variables."""
    harness = RobotHarness(ready=False)
    harness.machine.clear_variables()
    harness.machine.start('main', clear=False)
    harness.run(6.0)
    (failure,) = harness.robot.failures
    assert (failure.number, failure.position.file) == (8002, 'main.prg')


def test_a_server_that_ended_is_started_again() -> None:
    harness = RobotHarness()
    for number in (66, 67, 68):
        harness.machine.world.end(harness.machine.world.tasks[number])
    harness.run(0.5)
    assert all(harness.task(number) for number in (66, 67, 68))
    client = harness.client()
    assert harness.stream(client, line(harness, 2)) == [(0, OK), (1, OK)]


def test_a_task_number_that_is_taken_does_not_end_bgmain() -> None:
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
def test_a_client_that_is_gone_when_it_is_written_to(port: int) -> None:
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


def test_start_main_starts_main_only_when_the_motors_are_switched_on() -> None:
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
    """The servers are NoEmgAbort: they live through an E-stop. What it loses: docs."""
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


def test_two_runs_give_the_same_bytes() -> None:
    def run() -> tuple[bytes, bytes]:
        harness = RobotHarness()
        state, client = harness.client(STATE_PORT), harness.client(MOTION_PORT)
        client.send(*(request(each) for each in line(harness, 5)))
        harness.run(2.0)
        client.send(request(STOP))
        harness.run(1.0)
        return bytes(state.socket.sent), bytes(client.socket.sent)

    assert run() == run()


def refusing(number: int = 2002) -> Callable[..., None]:
    """Return a function of the robot that fails."""

    def refuse(*_: object) -> None:
        raise SpelError(number, 'refused')

    return refuse


def test_an_error_between_two_clients_ends_no_server() -> None:
    """What drops points and switches outputs off may fail; the servers serve the next client."""
    harness = RobotHarness()
    motion, io = harness.client(MOTION_PORT), harness.client(IO_PORT)
    harness.stream(motion, [point(0, harness.robot.position)])
    io.send(request(IoWrite(1, (IoSetting(IoType.DIGITAL_OUTPUT, 3, 1),))))
    harness.run(0.1)
    writes, harness.robot.write_bits = harness.robot.write_bits, refusing()
    motion.leave()
    io.leave()
    harness.run(1.0)
    harness.robot.write_bits = writes
    harness.run(0.5)
    assert harness.robot.failures == []
    assert harness.client(MOTION_PORT).open
    assert {66, 67, 68} <= harness.machine.world.tasks.keys()


def test_tables_that_cannot_be_filled_leave_main_waiting() -> None:
    values, SimpleRobot.value = SimpleRobot.value, refusing()  # type: ignore[assignment]
    try:
        harness = RobotHarness(ready=False)
    finally:
        SimpleRobot.value = values
    harness.robot.motors = True
    harness.start_main()
    harness.run(6.0)
    assert [failure.number for failure in harness.robot.failures] == [8002]
