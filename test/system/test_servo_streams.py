# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams through ROS and real processes: MoveIt Servo's, ros2_control's, single points."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
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
"""A process that is not scheduled for a while is not silent."""

WAY = 0.4
SPEED = 0.5
"""rad of joint 1, and rad/s on the way."""

FASTEST = math.radians(450.0)
"""What joint 1 may do, rad/s."""

RACES = 10
"""Of a stream against `~/stop` or `~/disable`, with each seed: 150 in all."""

ARRIVING = 0.01
"""The stream falls silent when the arm is so near to its end, rad: however late the machine made
sender, driver or controller, the end has been sent by then."""


@pytest.fixture(scope='module')
def servo_cell(tmp_path_factory: pytest.TempPathFactory) -> Any:
    cell = Cell(tmp_path_factory.mktemp('cell'), '--motion=smooth', **LENIENT)
    try:
        cell.ready().peer.enable()
        yield cell
    finally:
        cell.close()


def rest(cell: Cell) -> np.ndarray:
    """Wait until the stream is over, and return where the arm stands then."""
    peer = cell.peer
    peer.wait_until_still()
    while values(cell)['stream followed'] != 'none':
        pass  # once a second
    return peer.assert_still()


def go_home(cell: Cell) -> None:
    result = cell.peer.goal(trajectory((2.0, START))).result()
    assert result[0] == 'succeeded', result


class MoveItServo:
    """Makes the messages of MoveIt Servo of Jazzy: a window of commanded states.

    Each cycle adds the state for 0.1 s ahead, drops what is older than 0.1 s, and sends all but
    the newest, if there are three at least. Nothing more comes when the input ends.
    """

    LATENCY = 0.1

    def __init__(self, names: list[str] = JOINTS) -> None:
        self.names = names
        self.window: deque[tuple[float, list[float], list[float]]] = deque()

    def cycle(self, now: float, at: list[float], velocity: list[float]) -> JointTrajectory | None:
        self.window.append((now + self.LATENCY, at, velocity))
        while self.window[0][0] < now - self.LATENCY:
            self.window.popleft()
        if len(self.window) < 4:
            return None
        begin = self.window[0][0]
        message = JointTrajectory(joint_names=self.names)
        message.header.stamp = Time(sec=int(begin), nanosec=int(begin % 1.0 * 1e9))
        for moment, positions, velocities in list(self.window)[:-1]:
            nanoseconds = round((moment - begin) * 1e9)
            message.points.append(
                JointTrajectoryPoint(
                    positions=positions,
                    velocities=velocities,
                    time_from_start=Duration(nanosec=nanoseconds),
                )
            )
        return message


def reference(begin: np.ndarray, elapsed: float, way: float = WAY) -> tuple[list[float], float]:
    """Return positions after a time of a way of joint 1, and its velocity."""
    done = min(SPEED * elapsed, abs(way))
    sign = 1.0 if way > 0.0 else -1.0
    velocity = sign * SPEED if done < abs(way) else 0.0
    return [begin[0] + sign * done, *begin[1:].tolist()], velocity


def values(cell: Cell) -> dict[str, str]:
    """Return the newest diagnostics of the arm."""
    seen = len(cell.peer.diagnostics)
    cell.peer.wait_for(lambda: len(cell.peer.diagnostics) > seen, 'diagnostics')
    (arm,) = [s for s in cell.peer.diagnostics[-1].status if s.name.endswith(': arm')]
    return {value.key: value.value for value in arm.values}


@pytest.mark.parametrize(
    'rate', [pytest.param(30.0, marks=pytest.mark.slow), 100.0], ids=['30 Hz', '100 Hz']
)
def test_windows_of_moveit_servo_are_followed(servo_cell: Cell, rate: float) -> None:
    peer = servo_cell.peer
    publisher = peer.node.create_publisher(JointTrajectory, 'epson_driver/servo', 10)
    peer.wait_for(publisher.get_subscription_count, '~/servo')
    servo = MoveItServo()
    jitter = np.random.default_rng(1)
    before = int(values(servo_cell)['setpoints received'])
    begin = peer.position()
    way = WAY if begin[0] < 0.2 else -WAY
    started = time.time()
    while abs(peer.joint_states[-1].position[0] - begin[0] - way) > ARRIVING:
        elapsed = time.time() - started
        assert elapsed < PATIENCE, 'the arm does not arrive'
        at, velocity = reference(begin, elapsed, way)
        message = servo.cycle(time.time(), at, [velocity] + [0.0] * 5)
        if message is not None:
            publisher.publish(message)
        time.sleep((0.8 + 0.4 * jitter.random()) / rate)
    np.testing.assert_allclose(rest(servo_cell)[0], begin[0] + way, atol=1e-3)
    assert int(values(servo_cell)['setpoints received']) > before
    go_home(servo_cell)


STEPS = (0.0, 0.05, -0.05, 0.5, -0.5, 3600.0, -3600.0, 1e8, -1e8)
"""By which a clock is wrong, s, one after the other."""

FAKE_CLOCK = next(Path('/usr/lib').glob('*/faketime/libfaketimeMT.so.1'), None)
"""Sets the system clock of one process (Debian's package faketime)."""


def windows_through_steps(cell: Cell, step_to: Callable[[float], float]) -> None:
    """Send windows for six seconds while a clock is set; the arm is never faster for it.

    `step_to` sets the clock to be wrong by so much, s, and returns what that adds to stamps, s.
    """
    peer = cell.peer
    publisher = peer.node.create_publisher(JointTrajectory, 'epson_driver/servo', 10)
    peer.wait_for(publisher.get_subscription_count, '~/servo')
    servo, received = MoveItServo(), int(values(cell)['setpoints received'])
    begin, first = peer.position(), len(peer.joint_states)
    way = WAY if begin[0] < 0.2 else -WAY
    started = time.time()
    while (elapsed := time.time() - started) < 6.0:
        added = step_to(STEPS[int(elapsed / 0.3) % len(STEPS)])
        at, velocity = reference(begin, elapsed % 3.0, way)
        message = servo.cycle(time.time(), at, [velocity] + [0.0] * 5)
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
    assert min(begin[0], begin[0] + way) - 0.05 < there[0] < max(begin[0], begin[0] + way) + 0.05
    fastest = max(abs(state.velocity[0]) for state in peer.joint_states[first:])
    assert fastest < 0.27 * FASTEST  # servo.scale is 0.25
    go_home(cell)


@pytest.mark.slow
@pytest.mark.invariant(1, 4)
def test_inv1_steps_of_the_sender_s_clock_never_make_the_arm_faster(servo_cell: Cell) -> None:
    windows_through_steps(servo_cell, lambda wrong: wrong)


@pytest.mark.slow
@pytest.mark.invariant(1, 4)
@pytest.mark.skipif(FAKE_CLOCK is None, reason='no libfaketime (Debian: apt install faketime)')
def test_inv1_steps_of_the_driver_s_clock_never_make_the_arm_faster(tmp_path: Path) -> None:
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
    cell = Cell(tmp_path, '--motion=smooth', run=run, **LENIENT)
    try:
        cell.ready().peer.enable()
        windows_through_steps(cell, set_clock)
    finally:
        cell.close()


@pytest.mark.slow
def test_ros2_control_sends_while_the_arm_is_away_from_its_command(servo_cell: Cell) -> None:
    """Its first command is an initial value, 0: far away, and not followed."""
    peer = servo_cell.peer
    publisher = peer.node.create_publisher(JointState, 'epson_driver/joint_commands', 10)
    peer.wait_for(publisher.get_subscription_count, '~/joint_commands')
    begin = peer.position()
    for _ in range(50):
        publisher.publish(JointState(name=JOINTS, position=[3.0] + [0.0] * 5))
        time.sleep(0.01)
    np.testing.assert_array_equal(peer.position(), begin)
    refused = int(values(servo_cell)['setpoints refused'])
    assert refused > 0
    started = time.time()
    target = begin
    while True:
        at, _ = reference(begin, time.time() - started)
        away = np.abs(np.array(peer.joint_states[-1].position) - at).sum()
        if at[0] >= begin[0] + WAY and away < 1e-3:
            break  # silent, as the arm is there
        assert time.time() < started + PATIENCE
        publisher.publish(JointState(name=JOINTS, position=at))
        target = np.array(at)
        time.sleep(0.01)
    np.testing.assert_allclose(rest(servo_cell)[0], target[0], atol=1e-3)
    go_home(servo_cell)


@pytest.mark.slow
@pytest.mark.parametrize('topic', ['position_commands', 'velocity_commands', 'joint_jog', 'servo'])
def test_every_topic_moves_the_arm_and_silence_stops_it(servo_cell: Cell, topic: str) -> None:
    peer = servo_cell.peer
    kind, message_at = MESSAGES[topic]
    publisher = peer.node.create_publisher(kind, f'epson_driver/{topic}', 10)
    peer.wait_for(publisher.get_subscription_count, topic)
    begin = peer.position()
    started = time.time()
    while time.time() < started + PATIENCE:
        publisher.publish(message_at(reference(begin, time.time() - started)))
        if peer.joint_states[-1].position[0] > begin[0] + 0.2:
            break
        time.sleep(0.02)
    assert begin[0] + 0.2 < rest(servo_cell)[0]
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
    'servo': (JointTrajectory, _point),
}


class Publishers:
    """A held key, 50 Hz, and an idle stick, 10 Hz: two publishers on one topic, until closed."""

    def __init__(self, cell: Cell) -> None:
        self._node, self._held = cell.peer.node, threading.Event()
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
            if self._held.is_set():
                velocity = 0.0 if index else self.speed
                publisher.publish(Float64MultiArray(data=[velocity] + [0.0] * 5))

    def hold(self, speed: float) -> None:
        self.speed = speed
        self._held.set()

    def release(self) -> None:
        self._held.clear()

    def close(self) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()


def press(publishers: Publishers, peer: Any) -> int:
    """Hold the key until the arm moves; return how often it had to be let go of and held again.

    A driver that was held up cannot tell whether the key was let go of for a second before.
    """
    begin = peer.position()[0]
    for again in range(20):
        publishers.hold(SPEED if begin < 0.5 else -SPEED)
        until = time.monotonic() + 5.0
        while time.monotonic() < until:
            if abs(peer.joint_states[-1].position[0] - begin) > 0.02:
                return again
            time.sleep(0.005)
        publishers.release()
        time.sleep(1.5 * RELEASE_S)
    pytest.fail('the arm does not move')


@pytest.mark.slow
@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    'seed', [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 15))]
)
def test_inv4_stop_holds_while_a_key_is_held_and_a_stick_sends_zeros(
    servo_cell: Cell, seed: int
) -> None:
    """What moved the arm 0.086 rad after `~/stop`, and 0.123 rad after `~/enable`."""
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
    print(f'{again} of {RACES} times the key had to be let go of twice')
    go_home(servo_cell)
