# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel with other publishers of joint_states: a jog moves the chosen joint only."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from support.cell import Cell
from support.ros_peer import JOINTS, PATIENCE

from epson_driver.exercise.cell import Observer
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.robot_state import MAX_AGES_S
from epson_driver.processes import processes
from epson_driver.robots import load_robot_model
from epson_driver.ros_panel import RosDiscovery

BROWSER = 1

pytestmark = pytest.mark.slow


class JogRig:
    """The panel's own objects, a driver, a controller, and a second publisher of joint_states."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.observer = Observer(cell.ports.remote, load_robot_model('c3_a601s'))
        self.ros = RosDiscovery([], ['/epson_driver'], self.fail)
        self._stranger = self.cell.peer.node.create_publisher(JointState, 'joint_states', 10)
        self._message = JointState()
        (self.robot,) = self.ros.robots.values()
        self.control = RobotControl(self.robot, lambda *_: None, time.monotonic, allow_motion=True)
        self.control.arming.connect(BROWSER)

    def fail(self, what: str, error: BaseException) -> None:
        raise AssertionError(what) from error

    def say(self, names: Sequence[str], positions: Sequence[float]) -> None:
        """Publish this from the second publisher from now on."""
        self._message = JointState(name=list(names), position=list(positions))

    def turn(self) -> None:
        now = time.monotonic()
        if self._message.name:
            self._message.header.stamp = self.cell.peer.node.get_clock().now().to_msg()
            self._stranger.publish(self._message)
        self.ros.sample(now)
        self.ros.discover(now)
        self.control.arming.alive(BROWSER)
        self.control.update()
        time.sleep(0.02)

    def wait(self, what: Callable[[], Any], meaning: str) -> Any:
        until = time.monotonic() + PATIENCE
        while not (result := what()):
            assert time.monotonic() < until, f'{meaning}: {self.control.forbidden()}'
            self.turn()
        return result

    def close(self) -> None:
        self.ros.close()
        self.observer.close()
        self.cell.close()

    def at_rest(self) -> bool:
        times, positions = self.observer.seen
        return bool(np.ptp(positions[times > times[-1] - 0.5], axis=0).max() < 1e-6)

    @property
    def at(self) -> np.ndarray:
        return self.observer.seen[1][-1]


@pytest.fixture(scope='module')
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[JogRig]:
    """One rig for all tests, of which the last kills its driver."""
    cell = Cell(tmp_path_factory.mktemp('cell')).ready()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in processes.ros_environment(cell.domain).items():
            patch.setenv(name, value)
        result = JogRig(cell)
        yield result
        result.close()


@pytest.mark.invariant(10)
@pytest.mark.parametrize(
    ('names', 'positions'),
    [
        pytest.param(JOINTS[::-1], [0.5, -0.4, 0.3, 0.2, -0.1, 0.6], id='the same, reversed'),
        pytest.param(['finger_joint'], [0.01], id='of a gripper'),
    ],
)
def test_inv10_jog_ignores_other_joint_state_publishers(
    rig: JogRig, names: list[str], positions: list[float]
) -> None:
    rig.say(names, positions)
    rig.wait(lambda: rig.control.forbidden() is None, 'a robot that can be armed')
    rig.cell.peer.enable()
    rig.wait(lambda: rig.robot.state.gate_open, 'an open gate')
    rig.control.arming.arm(BROWSER)
    before = rig.at

    def jogged() -> bool:
        if time.monotonic() % 6.0 < 4.0:  # release a refused jog before the next
            rig.control.jog(BROWSER, '1', 'world', 0.2)
        return bool(np.abs(rig.at - before).max() > 0.1)

    rig.wait(jogged, 'a jog')
    rig.control.jog(BROWSER, '1', 'world', 0.0)
    rig.wait(rig.at_rest, 'rest')
    jogged_by = rig.at - before
    assert jogged_by[0] > 0.1
    rig.control.step(BROWSER, '2', 'world', -0.1, 1.0)
    rig.wait(lambda: not rig.robot.goals, 'the end of a step')
    rig.wait(rig.at_rest, 'rest after the step')
    np.testing.assert_allclose(rig.at - before, [jogged_by[0], -0.1, 0, 0, 0, 0], atol=1e-5)


@pytest.mark.invariant(6, 10)
def test_inv6_joints_are_not_fresh_after_the_driver_was_killed(rig: JogRig) -> None:
    rig.say(JOINTS, [0.0] * 6)
    rig.wait(lambda: rig.control.forbidden() is None, 'a robot that can be armed')
    state = rig.robot.state
    rig.cell.client.kill()
    rig.turn()
    last = state.times['joints']
    until = last + MAX_AGES_S['joints']
    while time.monotonic() < until + 0.5:
        rig.turn()
    assert not state.fresh('joints', time.monotonic())
    assert rig.control.forbidden() is not None
