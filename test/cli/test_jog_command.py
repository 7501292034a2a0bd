# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver jog` at a terminal: its keys, what it says, nothing goes on without one."""

import io
import os
import sys
import threading
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState

from epson_driver.cli import jog
from epson_driver.cli.jog import MAX_SPEED, MIN_SPEED, RELEASE_S, JogKeys
from epson_driver.processes import processes


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def called(monkeypatch, capsys):
    """Return a function that calls the command at a terminal, in a domain of its own."""
    domain = processes.free_ros_domain()
    for name, value in processes.ros_environment(domain).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, 'stdin', Terminal())

    def call(*words):
        monkeypatch.setattr(sys, 'argv', ['epson_driver jog', *words])
        return jog.main(), capsys.readouterr().err

    return call


def test_without_a_driver_it_says_what_to_start(called, monkeypatch):
    monkeypatch.setattr(jog, 'WAIT_S', 0.2)
    code, said = called('--node', 'mine')
    assert code == 1
    assert said == (
        'epson_driver jog: no joint_states and mine/joint_jog within 0.2 s: start the client, '
        'and give its name with --node\n'
    )


@pytest.mark.invariant(3)
def test_a_key_that_is_released_stops_and_a_new_speed_is_shown(monkeypatch):
    read, write = os.pipe()
    said, published = [], []

    def then(text):
        said.append(text)
        os.write(write, b'1' if len(said) == 1 else b'x')

    def publish(message):
        published.append((list(message.joint_names), list(message.velocities)))
        if not any(message.velocities):
            os.write(write, b'-')

    monkeypatch.setattr('builtins.print', then)
    with os.fdopen(read) as keys:
        monkeypatch.setattr(sys, 'stdin', keys)
        os.write(write, b'+')
        jog._jog(['a', 'b'], 0.1, publish, lambda now: ('', []))
    os.close(write)
    assert [text.split()[0] for text in said] == ['0.15', '0.1']
    assert published[0] == (['a'], [pytest.approx(0.15)])
    assert published[-1] == (['a', 'b'], [0.0, 0.0])


def test_why_the_arm_does_not_move_is_said_at_once_and_when_it_changes(monkeypatch):
    read, write = os.pipe()
    said = []
    reasons = iter([('', []), ('', ['not followed']), ('E-stop', []), ('E-stop', ['E-stop'])])

    def why_not(now):
        if (found := next(reasons, None)) is None:
            os.write(write, b'x')
        return found or ('', [])

    monkeypatch.setattr('builtins.print', said.append)
    with os.fdopen(read) as keys:
        monkeypatch.setattr(sys, 'stdin', keys)
        monkeypatch.setattr(jog, 'RELEASE_S', 3600.0)
        os.write(write, b'1')
        jog._jog(['a'], 0.1, lambda message: None, why_not)
    os.close(write)
    assert said == ['not followed', 'the arm does not move: E-stop']


@pytest.fixture
def left(called):
    """Two nodes, of the driver and of jog, in a namespace."""
    rclpy.init(args=['--ros-args', '-r', '__ns:=/left'])
    yield rclpy.create_node('epson_driver'), rclpy.create_node('jog')
    rclpy.shutdown()


def until_heard(why, done):
    """Return what `why` says once that is `done`, or after 5 s."""
    until = time.monotonic() + 5.0
    while not done(said := why(time.monotonic())) and time.monotonic() < until:
        time.sleep(0.01)
    return said


@pytest.mark.parametrize(
    ('cause', 'name', 'said'),
    [
        ('NOT_ENABLED', 'left/epson_driver: arm', 'not enabled; call ~/enable'),
        ('NONE', 'left/epson_driver: arm', ''),
        ('NOT_ENABLED', 'right/epson_driver: arm', ''),
    ],
)
def test_why_the_arm_does_not_move_is_taken_from_its_own_diagnostics(left, cause, name, said):
    driver, node = left
    why = jog.WhyNot(node, 'epson_driver')
    values = [KeyValue(key='cause', value=cause), KeyValue(key='remedy', value='ENABLE')]
    status = DiagnosticStatus(name=name, message='not enabled', values=values)
    publisher = driver.create_publisher(DiagnosticArray, '/diagnostics', 10)
    publisher.publish(DiagnosticArray(status=[status]))
    assert until_heard(why, lambda heard: heard[0] or not said)[0] == said


def test_what_its_driver_says_of_the_stream_is_said_and_nothing_else(left):
    driver, node = left
    why = jog.WhyNot(node, 'epson_driver')
    driver.get_logger().warning('the stream on ~/pose_target is not followed: so')
    driver.get_logger().info('following the stream of velocities on ~/joint_jog')
    node.get_logger().warning('the stream on ~/joint_jog is not followed: of another node')
    driver.get_logger().warning('the stream on ~/joint_jog is not followed: it moves')
    _, said = until_heard(why, lambda heard: heard[1])
    assert said == ['the stream on ~/joint_jog is not followed: it moves']


@pytest.mark.parametrize(
    ('seconds', 'said'), [(0.1, ''), (1.0, 'no joint_states come'), (3.0, 'its driver is silent')]
)
def test_what_is_silent_is_said(left, seconds, said):
    why = jog.WhyNot(left[1], 'epson_driver')
    assert why(time.monotonic() + seconds)[0].partition(':')[0] == said


@pytest.mark.invariant(3)
def test_the_joints_are_named_once_however_many_joint_states_come(left):
    driver, node = left
    publisher = driver.create_publisher(JointState, 'joint_states', 10)
    timer = threading.Event()

    def publish():
        while not timer.wait(0.01):
            publisher.publish(JointState(name=['a', 'b']))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        names = jog._joint_names(node)
        why = jog.WhyNot(node, 'epson_driver')
        for _ in range(20):
            why(time.monotonic())
            time.sleep(0.01)
    finally:
        timer.set()
        thread.join()
    assert names == ['a', 'b']


def test_a_held_key_moves_its_joint_and_released_it_stops():
    keys = JogKeys(6, 0.1)
    assert keys.velocity(0.0) is None
    for count in range(10):
        keys.press('3', 0.03 * count)
        assert keys.velocity(0.03 * count) == (2, 0.1)
    assert keys.velocity(0.27 + 0.9 * RELEASE_S) == (2, 0.1)
    assert keys.velocity(0.27 + RELEASE_S) is None


def test_the_keys_below_move_back():
    keys = JogKeys(6, 0.1)
    keys.press('e', 0.0)
    assert keys.velocity(0.0) == (2, -0.1)


@pytest.mark.parametrize('key', [' ', '7', 'u', 'Q', '\n', 'é', '+'])
def test_any_other_key_stops(key):
    keys = JogKeys(6, 0.1)
    keys.press('1', 0.0)
    keys.press(key, 0.01)
    assert keys.velocity(0.01) is None
    assert not keys.ended


@pytest.mark.parametrize('key', ['x', '\x1b', '\x03', '\x04', ''])
def test_it_ends_at_rest(key):
    keys = JogKeys(6, 0.1)
    keys.press('1', 0.0)
    keys.press(key, 0.01)
    assert keys.ended
    assert keys.velocity(0.01) is None


def test_the_speed_changes_within_bounds():
    keys = JogKeys(6, 0.1)
    keys.press('+', 0.0)
    assert keys.speed == pytest.approx(0.15)
    for _ in range(50):
        keys.press('+', 0.0)
    assert keys.speed == MAX_SPEED
    for _ in range(50):
        keys.press('-', 0.0)
    assert keys.speed == MIN_SPEED
