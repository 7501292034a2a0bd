# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""E-stop, door, errors, lost clients, starts: nothing moves until it is enabled again."""

import pytest
from support.robot_program import (
    IO_PORT,
    MOTION_PORT,
    STATE_PORT,
    Client,
    RobotBench,
    TaskType,
    moved,
    point,
    request,
)

from epson_driver.simple_message import JointTrajPt, Ping, ReplyCode, SpecialSequence, reply

OK, FAILURE = 1, 2
STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)


def line(bench: RobotBench, count: int, step: float = 20.0, duration: float = 1.0):
    start = bench.robot.position
    return [point(n, moved(start, j1=step * (n + 1)), duration) for n in range(count)]


def moving(bench: RobotBench) -> Client:
    """Return a client whose trajectory of six points is at its first one."""
    client = bench.client()
    assert bench.stream(client, line(bench, 6)) == [(n, OK) for n in range(6)]
    bench.run(0.6)
    assert bench.robot.move_now is not None
    return client


def assert_still(bench: RobotBench, seconds: float = 3.0) -> None:
    """Nothing moves for a time, and no Go begins."""
    begun, where = len(bench.robot.gone_to), bench.robot.position
    bench.run(seconds)
    assert len(bench.robot.gone_to) == begun
    assert bench.robot.position == where


def assert_works(bench: RobotBench, client: Client) -> None:
    """The rest of the old trajectory is refused, a new one is executed."""
    assert bench.stream(client, [point(6, bench.robot.position)]) == [(6, FAILURE)]
    points = line(bench, 3, -5.0, 0.3)
    assert bench.stream(client, points) == [(n, OK) for n in range(3)]
    begun = len(bench.robot.gone_to)
    bench.rest()
    assert len(bench.robot.gone_to) >= begun
    assert abs(bench.robot.position[0] - points[-1].joints[0] * 57.29577951308232) < 1e-4


def test_nothing_moves_after_an_estop_until_it_is_enabled() -> None:
    bench = RobotBench()
    client = moving(bench)
    bench.press_estop()
    assert_still(bench)
    assert bench.stream(client, line(bench, 1)) == [(0, FAILURE)]
    bench.robot.states['estopon'] = 0
    assert_still(bench)
    assert bench.stream(client, line(bench, 1)) == [(0, FAILURE)]
    bench.robot.motors = True
    assert_still(bench)
    assert bench.stream(client, line(bench, 1)) == [(0, FAILURE)]
    bench.enable()
    assert_still(bench)
    assert_works(bench, client)
    assert bench.robot.failures == []


def test_points_that_wait_at_an_estop_are_never_executed_even_if_all_is_quick() -> None:
    """main drops what is in the ring by itself: no server needs to have seen the E-stop."""
    bench = RobotBench()
    moving(bench)
    bench.press_estop()
    bench.robot.states['estopon'] = 0
    bench.robot.motors = True
    bench.start_main()
    assert_still(bench)


def test_nor_are_those_that_main_has_not_got_yet() -> None:
    """main waits until MotionServer has dropped them too."""
    bench = RobotBench(LOOK_AHEAD='2')
    client = bench.client()
    client.send(*(request(each) for each in line(bench, 6)))
    bench.run(0.6)
    assert client.replies() == [(0, OK), (1, OK)]
    bench.press_estop()
    bench.robot.states['estopon'] = 0
    bench.robot.motors = True
    bench.start_main()
    assert_still(bench)
    assert client.replies() == [(n, FAILURE) for n in range(2, 6)]


def test_motors_off_in_a_pause_drop_the_points_too() -> None:
    bench = RobotBench()
    client = bench.client()
    bench.machine.pause()
    assert bench.stream(client, line(bench, 3)) == [(n, OK) for n in range(3)]
    bench.robot.halt()
    bench.run(0.1)
    bench.robot.motors = True
    bench.machine.resume()
    assert_still(bench)
    assert_works(bench, client)


def test_motors_off_and_on_drop_the_points() -> None:
    bench = RobotBench()
    client = moving(bench)
    bench.robot.halt()
    bench.run(0.1)
    bench.robot.motors = True
    assert_still(bench)
    assert_works(bench, client)


def test_an_open_door_ends_main_and_the_motion() -> None:
    bench = RobotBench()
    client = moving(bench)
    bench.robot.states['safetyon'] = -1
    bench.machine.pause()
    bench.robot.halt()
    bench.run(0.5)
    assert not bench.task(1)
    assert bench.stream(client, line(bench, 1)) == [(0, FAILURE)]
    bench.robot.states['safetyon'] = 0
    bench.robot.motors = True
    bench.machine.resume()
    assert_still(bench)
    bench.enable()
    assert_works(bench, client)


def test_without_door_ends_motion_the_door_is_a_pause() -> None:
    bench = RobotBench(DOOR_ENDS_MOTION='')
    moving(bench)
    bench.robot.states.update(safetyon=-1, pauseon=-1)
    bench.machine.pause()
    bench.run(0.5)
    assert bench.task(1)
    bench.robot.states.update(safetyon=0, pauseon=0)
    bench.machine.resume()
    bench.rest()
    assert len(bench.robot.gone_to) == 6


def test_in_a_pause_points_wait_and_a_stop_works() -> None:
    bench = RobotBench()
    client = bench.client()
    bench.robot.states['pauseon'] = -1
    bench.machine.pause()
    assert bench.stream(client, line(bench, 3)) == [(n, OK) for n in range(3)]
    assert_still(bench, 1.0)
    assert bench.stream(client, [STOP]) == [(-4, OK)]
    bench.robot.states['pauseon'] = 0
    bench.machine.resume()
    assert_still(bench)
    assert_works(bench, client)


def test_a_lost_client_stops_the_arm_and_switches_the_motors_off() -> None:
    bench = RobotBench()
    client = moving(bench)
    client.leave()
    bench.run(0.5)
    assert bench.robot.move_now is None
    assert not bench.robot.motors
    assert_still(bench)
    client = bench.client()
    assert bench.stream(client, line(bench, 1)) == [(0, FAILURE)]
    bench.robot.motors = True
    bench.run(0.1)
    assert_still(bench)
    assert_works(bench, client)


def test_the_motors_stay_on_if_config_says_so() -> None:
    bench = RobotBench(LOST_CLIENT_MOTORS_OFF='')
    client = moving(bench)
    client.leave()
    bench.run(0.5)
    assert bench.robot.move_now is None
    assert bench.robot.motors
    assert_still(bench)
    assert_works(bench, bench.client())


def test_the_port_listens_again_after_each_client() -> None:
    bench = RobotBench(LOST_CLIENT_MOTORS_OFF='')
    for _ in range(4):
        client = bench.client()
        assert bench.stream(client, line(bench, 2, 1.0, 0.1)) == [(0, OK), (1, OK)]
        client.leave()
        bench.run(0.6)
    assert bench.robot.failures == []


@pytest.mark.parametrize('number', [4001, 4031, 4242, 2999])
def test_a_motion_that_fails_drops_the_points_and_main_goes_on(number: int) -> None:
    bench = RobotBench()
    client = bench.client()
    bench.robot.fails_with = number
    assert bench.stream(client, line(bench, 3))[0] == (0, OK)
    bench.run(0.5)
    assert bench.shared('g_main_error') == number
    assert bench.robot.failures == []
    assert_still(bench)
    assert_works(bench, client)


def test_a_later_motion_that_fails_drops_the_points() -> None:
    bench = RobotBench()
    client = moving(bench)
    bench.robot.fails_with = 4242
    bench.rest()
    assert bench.shared('g_main_error') == 4242
    assert_works(bench, client)


def test_the_stop_bit_of_somebody_else_stops_and_is_an_error() -> None:
    bench = RobotBench()
    client = moving(bench)
    world = bench.machine.world
    world.host.write_bits(next(m for m in bench.robot.bits if m.value == 'memory'), 500, 1, 1)
    bench.run(0.5)
    assert bench.robot.move_now is None
    assert bench.shared('g_main_error') == 8001
    assert_still(bench)
    assert_works(bench, client)


def test_power_is_high_only_when_it_moves_and_only_with_the_switch() -> None:
    bench = RobotBench()
    assert not bench.robot.power
    moving(bench)
    assert bench.robot.power
    low = RobotBench(FULL_POWER='')
    moving(low)
    assert not low.robot.power


def test_main_switches_no_motors_on_and_the_servers_run_no_robot_command() -> None:
    bench = RobotBench()
    moving(bench)
    bench.press_estop()
    bench.enable()
    bench.run(1.0)
    assert [words for name, _, words in bench.robot.commands if name == 'motor'] == []
    assert {name for name, _, _ in bench.robot.commands} <= {'power', 'speed', 'accel', 'waitpos'}


def test_main_says_what_is_missing_without_its_tables() -> None:
    """Background tasks are off, or main has cleared the global variables."""
    bench = RobotBench(ready=False)
    bench.machine.clear_variables()
    bench.machine.start('main', clear=False)
    bench.run(6.0)
    (failure,) = bench.robot.failures
    assert (failure.number, failure.position.file) == (8002, 'main.prg')


def test_a_server_that_ended_is_started_again() -> None:
    bench = RobotBench()
    for number in (66, 67, 68):
        bench.machine.world.end(bench.machine.world.tasks[number])
    bench.run(0.5)
    assert all(bench.task(number) for number in (66, 67, 68))
    client = bench.client()
    assert bench.stream(client, line(bench, 2)) == [(0, OK), (1, OK)]


def test_a_task_number_that_is_taken_does_not_end_bgmain() -> None:
    bench = RobotBench()
    world = bench.machine.world
    world.end(world.tasks[66])
    bench.machine.start('MoveAll', 66, TaskType.TRAP, clear=False)
    bench.run(0.5)
    assert bench.task(65)
    world.end(world.tasks[66])
    bench.run(0.5)
    assert bench.task(66)


@pytest.mark.parametrize('port', [STATE_PORT, MOTION_PORT, IO_PORT])
def test_a_client_that_is_gone_when_it_is_written_to(port: int) -> None:
    """Error 2902 ends the connection, not the server."""
    bench = RobotBench()
    client = bench.client(port)
    bench.robot.sends = False
    client.send(request(STOP))
    bench.run(0.5)
    bench.robot.sends = True
    assert not client.open
    client = bench.client(port)
    client.packets()
    client.send(request(Ping()))
    bench.run(0.3)
    assert reply(Ping(), ReplyCode.SUCCESS) in client.packets()


def test_start_main_starts_main_only_when_the_motors_are_switched_on() -> None:
    bench = RobotBench(ready=False, START_MAIN='1')
    bench.run(1.0)
    assert not bench.task(1)
    bench.robot.motors = True
    bench.run(0.5)
    assert bench.task(1)
    client = moving(bench)
    bench.press_estop()
    bench.robot.states['estopon'] = 0
    assert_still(bench)
    assert not bench.task(1)
    bench.robot.motors = True
    assert_still(bench)
    assert bench.task(1)
    assert_works(bench, client)


def test_without_background_tasks_main_starts_the_servers() -> None:
    """The servers are NoEmgAbort: they live through an E-stop. What it loses: docs."""
    bench = RobotBench(NO_BACKGROUND='1')
    assert [view.number for view in bench.machine.tasks()] == [1, 2, 3, 4]
    state = bench.client(STATE_PORT)
    client = moving(bench)
    bench.press_estop()
    bench.run(0.2)
    assert [view.number for view in bench.machine.tasks()] == [2, 3, 4]
    state.packets()
    bench.run(0.5)
    assert state.packets()
    assert bench.stream(client, line(bench, 1)) == [(0, FAILURE)]
    bench.robot.states['estopon'] = 0
    bench.robot.motors = True
    bench.start_main()
    assert_still(bench)
    assert_works(bench, client)


def test_two_runs_give_the_same_bytes() -> None:
    def run() -> tuple[bytes, bytes]:
        bench = RobotBench()
        state, client = bench.client(STATE_PORT), bench.client(MOTION_PORT)
        client.send(*(request(each) for each in line(bench, 5)))
        bench.run(2.0)
        client.send(request(STOP))
        bench.run(1.0)
        return bytes(state.socket.sent), bytes(client.socket.sent)

    assert run() == run()
