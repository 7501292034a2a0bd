# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoint streams through ROS and processes: MoveIt Servo, jogging, single points."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from control_msgs.msg import JointJog
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from support.cell import START, Cell
from support.ros_peer import JOINTS, PATIENCE, trajectory
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.servo.restart_interlock import RELEASE_S

LENIENT = {'servo__timeout': 1.0, 'servo__start_tolerance': 0.5}
"""Settings that tolerate an unscheduled process."""

TRAVEL = 0.4
SPEED = 0.5
"""Travel of joint 1, rad, and its speed, rad/s."""

FASTEST = math.radians(450.0)
"""Velocity limit of joint 1, rad/s."""

RACES = 10
"""Races of a stream against `~/stop` or `~/disable` per seed."""

ARRIVING = 0.01
"""Distance from the end at which the stream stops, rad. The end was sent before."""


@pytest.fixture(scope='module')
def servo_cell(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with closing(Cell(tmp_path_factory.mktemp('cell'), '--motion=smooth', **LENIENT)) as cell:
        cell.ready().peer.enable()
        yield cell


def rest(cell: Cell) -> np.ndarray:
    """Wait until the stream has ended, and return the arm's position."""
    peer = cell.peer
    peer.wait_until_still()
    while values(cell)['stream followed'] != 'none':
        pass  # one message a second
    return peer.assert_still()


def go_home(cell: Cell) -> None:
    result = cell.peer.goal(trajectory((2.0, START))).result()
    assert result[0] == 'succeeded', result


class MoveItServo:
    """Makes the messages of MoveIt Servo (Jazzy): a window of commanded states.

    A cycle adds the state 0.1 s ahead and drops states older than 0.1 s. It sends all except
    the newest, at least three. Messages stop when the input ends.
    """

    LATENCY = 0.1

    def __init__(self, names: list[str] = JOINTS) -> None:
        self.names = names
        self.window: deque[tuple[float, list[float], list[float]]] = deque()

    def cycle(
        self, now: float, positions: list[float], velocity: list[float]
    ) -> JointTrajectory | None:
        self.window.append((now + self.LATENCY, positions, velocity))
        while self.window[0][0] < now - self.LATENCY:
            self.window.popleft()
        if len(self.window) < 4:
            return None
        start = self.window[0][0]
        message = JointTrajectory(joint_names=self.names)
        message.header.stamp = Time(sec=int(start), nanosec=int(start % 1.0 * 1e9))
        for moment, positions, velocities in list(self.window)[:-1]:
            nanoseconds = round((moment - start) * 1e9)
            message.points.append(
                JointTrajectoryPoint(
                    positions=positions,
                    velocities=velocities,
                    time_from_start=Duration(nanosec=nanoseconds),
                )
            )
        return message


def reference(
    begin: np.ndarray, elapsed: float, distance: float = TRAVEL
) -> tuple[list[float], float]:
    """Return the positions after a time of a motion of joint 1, and its velocity."""
    done = min(SPEED * elapsed, abs(distance))
    sign = 1.0 if distance > 0.0 else -1.0
    velocity = sign * SPEED if done < abs(distance) else 0.0
    return [begin[0] + sign * done, *begin[1:].tolist()], velocity


def values(cell: Cell) -> dict[str, str]:
    """Return the newest diagnostics of the arm."""
    seen = len(cell.peer.diagnostics)
    cell.peer.wait_for(lambda: len(cell.peer.diagnostics) > seen, 'diagnostics')
    (arm,) = [s for s in cell.peer.diagnostics[-1].status if s.name.endswith(': arm')]
    return {value.key: value.value for value in arm.values}


def test_moveit_servo_windows_are_followed(servo_cell: Cell) -> None:
    peer = servo_cell.peer
    publisher = peer.node.create_publisher(JointTrajectory, 'epson_driver/servo', 10)
    peer.wait_for(publisher.get_subscription_count, '~/servo')
    servo = MoveItServo()
    jitter = np.random.default_rng(1)
    before = int(values(servo_cell)['setpoints received'])
    start = peer.position()
    distance = TRAVEL if start[0] < 0.2 else -TRAVEL
    started = time.time()
    while abs(peer.joint_states[-1].position[0] - start[0] - distance) > ARRIVING:
        elapsed = time.time() - started
        assert elapsed < PATIENCE, 'the arm does not arrive'
        positions, velocity = reference(start, elapsed, distance)
        message = servo.cycle(time.time(), positions, [velocity] + [0.0] * 5)
        if message is not None:
            publisher.publish(message)
        time.sleep((0.8 + 0.4 * jitter.random()) / 100.0)
    np.testing.assert_allclose(rest(servo_cell)[0], start[0] + distance, atol=1e-3)
    assert int(values(servo_cell)['setpoints received']) > before
    go_home(servo_cell)


STEPS = (0.0, 0.05, -0.05, 0.5, -0.5, 3600.0, -3600.0, 1e8, -1e8)
"""Successive errors of a clock, s."""

FAKE_CLOCK = next(Path('/usr/lib').glob('*/faketime/libfaketimeMT.so.1'), None)
"""Sets the system clock of one process (Debian's package faketime)."""


def windows_through_steps(cell: Cell, step_to: Callable[[float], float]) -> None:
    """Send windows for 6 s while a clock steps, and assert that the arm is not faster.

    `step_to` sets the clock's error, s, and returns the resulting error of stamps, s.
    """
    peer = cell.peer
    publisher = peer.node.create_publisher(JointTrajectory, 'epson_driver/servo', 10)
    peer.wait_for(publisher.get_subscription_count, '~/servo')
    servo, received = MoveItServo(), int(values(cell)['setpoints received'])
    start, first = peer.position(), len(peer.joint_states)
    distance = TRAVEL if start[0] < 0.2 else -TRAVEL
    started = time.time()
    while (elapsed := time.time() - started) < 6.0:
        added = step_to(STEPS[int(elapsed / 0.3) % len(STEPS)])
        positions, velocity = reference(start, elapsed % 3.0, distance)
        message = servo.cycle(time.time(), positions, [velocity] + [0.0] * 5)
        if message is not None:
            stamp = message.header.stamp
            nanoseconds = stamp.sec * 10**9 + stamp.nanosec + round(added * 1e9)
            stamp.sec, stamp.nanosec = divmod(nanoseconds, 10**9)
            publisher.publish(message)
        time.sleep(0.02)
    step_to(0.0)
    there = rest(cell)
    after = values(cell)
    assert after['arm gate'] == 'open'
    assert int(after['setpoints received']) > received
    assert (
        min(start[0], start[0] + distance) - 0.05
        < there[0]
        < max(start[0], start[0] + distance) + 0.05
    )
    fastest = max(abs(state.velocity[0]) for state in peer.joint_states[first:])
    assert fastest < 0.27 * FASTEST  # servo.scale is 0.25
    go_home(cell)


@pytest.mark.invariant(1, 4)
def test_inv1_clock_steps_of_the_sender_do_not_speed_up_the_arm(servo_cell: Cell) -> None:
    windows_through_steps(servo_cell, lambda wrong: wrong)


@pytest.mark.invariant(1, 4)
@pytest.mark.skipif(FAKE_CLOCK is None, reason='no libfaketime (Debian: apt install faketime)')
def test_inv1_clock_steps_of_the_driver_do_not_speed_up_the_arm(tmp_path: Path) -> None:
    file = tmp_path / 'clock'
    settings = {
        'LD_PRELOAD': FAKE_CLOCK,
        'FAKETIME_TIMESTAMP_FILE': file,
        'FAKETIME_NO_CACHE': 1,
        'FAKETIME_DONT_FAKE_MONOTONIC': 1,
    }
    run = ('env', *(f'{name}={value}' for name, value in settings.items()))

    def set_clock(wrong: float) -> float:
        file.with_suffix('.new').write_text(f'{wrong:+f}')
        file.with_suffix('.new').replace(file)
        return 0.0

    set_clock(0.0)
    with closing(Cell(tmp_path, '--motion=smooth', run=run, **LENIENT)) as cell:
        cell.ready().peer.enable()
        windows_through_steps(cell, set_clock)


@pytest.mark.parametrize(
    'topic', ['position_commands', 'velocity_commands', 'joint_commands', 'joint_jog', 'servo']
)
def test_every_topic_moves_the_arm_until_its_messages_end(servo_cell: Cell, topic: str) -> None:
    peer = servo_cell.peer
    kind, message_at = MESSAGES[topic]
    publisher = peer.node.create_publisher(kind, f'epson_driver/{topic}', 10)
    peer.wait_for(publisher.get_subscription_count, topic)
    start = peer.position()
    started = time.time()
    while time.time() < started + PATIENCE:
        publisher.publish(message_at(reference(start, time.time() - started)))
        if peer.joint_states[-1].position[0] > start[0] + 0.2:
            break
        time.sleep(0.02)
    assert start[0] + 0.2 < rest(servo_cell)[0]
    go_home(servo_cell)


def _point(state: tuple[list[float], float]) -> JointTrajectory:
    return trajectory((0.02, state[0]))


MESSAGES: dict[str, tuple[Any, Any]] = {
    'position_commands': (Float64MultiArray, lambda state: Float64MultiArray(data=state[0])),
    'velocity_commands': (
        Float64MultiArray,
        lambda _state: Float64MultiArray(data=[SPEED] + [0.0] * 5),
    ),
    'joint_jog': (
        JointJog,
        lambda _state: JointJog(joint_names=JOINTS[:1], velocities=[SPEED]),
    ),
    'joint_commands': (JointState, lambda state: JointState(name=JOINTS, position=state[0])),
    'servo': (JointTrajectory, _point),
}


class Publishers:
    """Two publishers on one topic: a pressed key at 50 Hz and an idle joystick at 10 Hz."""

    def __init__(self, cell: Cell) -> None:
        self._node, self._pressed = cell.peer.node, threading.Event()
        self._ended = threading.Event()
        self.speed = SPEED
        self._threads = [
            threading.Thread(target=self._send, args=(index,), daemon=True) for index in range(2)
        ]
        for thread in self._threads:
            thread.start()

    def _send(self, index: int) -> None:
        publisher = self._node.create_publisher(
            Float64MultiArray, 'epson_driver/velocity_commands', 10
        )
        while not self._ended.wait(0.1 if index else 0.02):
            if self._pressed.is_set():
                velocity = 0.0 if index else self.speed
                publisher.publish(Float64MultiArray(data=[velocity] + [0.0] * 5))

    def hold(self, speed: float) -> None:
        self.speed = speed
        self._pressed.set()

    def release(self) -> None:
        self._pressed.clear()

    def close(self) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()


def press(publishers: Publishers, peer: Any) -> int:
    """Press the key until the arm moves, and return the number of repetitions.

    After a stall, the driver cannot know whether the key was released for a second before.
    """
    start = peer.position()[0]
    for again in range(20):
        publishers.hold(SPEED if start < 0.5 else -SPEED)
        until = time.monotonic() + 5.0
        while time.monotonic() < until:
            if abs(peer.joint_states[-1].position[0] - start) > 0.02:
                return again
            time.sleep(0.005)
        publishers.release()
        time.sleep(1.5 * RELEASE_S)
    pytest.fail('the arm does not move')


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    'seed', [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 15))]
)
def test_inv4_stop_holds_while_a_key_and_an_idle_joystick_send(
    servo_cell: Cell, seed: int
) -> None:
    """The arm once moved 0.086 rad after `~/stop`, and 0.123 rad after `~/enable`."""
    peer, random = servo_cell.peer, np.random.default_rng(seed)
    publishers, again = Publishers(servo_cell), 0
    try:
        for race in range(RACES):
            again += press(publishers, peer)
            time.sleep(random.uniform(0.0, 0.3))
            if race % 3:
                assert peer.call('stop')[0]
            else:
                assert peer.call('disable')[0]
                peer.enable()
            there = peer.position()
            time.sleep(1.5)
            np.testing.assert_allclose(peer.position(), there, atol=1e-4)
            publishers.release()
            time.sleep(1.5 * RELEASE_S)
    finally:
        publishers.close()
    print(f'{again} of {RACES} presses were repeated')
    go_home(servo_cell)
