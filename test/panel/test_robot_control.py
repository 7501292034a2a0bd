# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Which robot the panel takes it for, and whether it may be moved."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from epson_driver.motion import Trajectory
from epson_driver.panel.arming import NotArmedError
from epson_driver.panel.request_error import RequestError
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.robot_state import MAX_AGES_S, RobotState, Simulation
from epson_driver.panel.ros_robot import ERROR, INFO, WARN, NoDriverError
from epson_driver.panel.sim_pendant import NotSimulatedError, PendantThread

PARAMETERS = {'robot_model': 'c3_a601s', 'robot_ip': '192.0.2.1', 'remote_port': 0}
NOW = 100.0


class Robot:
    """What a driver has said, without ROS."""

    def __init__(self) -> None:
        self.state = RobotState(positions=np.zeros(6), link='connected')
        self.state.times = dict.fromkeys((*MAX_AGES_S, 'first joints', 'parameters'), NOW)
        self.parameters: dict[str, Any] = dict(PARAMETERS)
        self.logged: list[str] = []

        self.asked: list[Any] = []
        self.served = True
        """Whether somebody answers requests."""

    def log(self, text: str, _level: int) -> None:
        self.logged.append(text)

    def cancel_goals(self) -> list[Any]:
        return []

    def trigger(self, name: str, _say: Any) -> None:
        self.asked.append(name)

    def set_speed(self, factor: float, say: Any) -> None:
        if not self.served:
            raise NoDriverError('nobody serves ~/set_speed_scaling')
        self.asked.append((factor, say))


@pytest.fixture
def robot() -> Robot:
    return Robot()


def fail(what: str, error: BaseException) -> None:
    raise AssertionError(what) from error


@pytest.fixture
def pendants() -> Iterator[PendantThread]:
    found = PendantThread(time.monotonic, fail)
    yield found
    found.end()


def controlled(robot: Robot, pendants: PendantThread, *, allow_motion: bool) -> RobotControl:
    found = RobotControl(
        robot,  # type: ignore[arg-type]
        pendants,
        lambda: NOW,
        on_error=fail,
        allow_motion=allow_motion,
    )
    found.arming.connect(1)
    return found


@pytest.fixture
def control(robot: Robot, pendants: PendantThread) -> RobotControl:
    return controlled(robot, pendants, allow_motion=True)


@pytest.mark.parametrize('name', ['c3_a601s', 'C3-A601S', 'vt6'])
def test_a_model_is_loaded_once_however_the_driver_calls_it(
    name: str, robot: Robot, control: RobotControl
) -> None:
    robot.parameters['robot_model'] = name
    control.look()
    model = control.model
    assert model is not None
    control.look()
    assert control.model is model


def test_a_model_that_is_not_there_is_said_once_and_is_not_shown_as_the_one_before(
    robot: Robot, control: RobotControl
) -> None:
    control.look()
    robot.parameters['robot_model'] = '/no/such/file.yaml'
    for _ in range(3):
        control.look()
    assert control.model is None
    (said,) = robot.logged
    assert '/no/such/file.yaml' in said
    robot.parameters['robot_model'] = 'c3_a601s'
    control.look()
    assert control.model is not None


def test_of_a_scara_the_shaft_that_is_away_from_the_start_is_named_in_mm(
    robot: Robot, control: RobotControl
) -> None:
    robot.parameters['robot_model'] = 'gx8_c652s'
    control.look()
    robot.state.positions = np.array([0.5, 0.5, -0.1, 0.0])
    names = tuple(f'joint_{number}' for number in range(1, 5))
    for start, said in (
        ([0.5, 0.5, -0.1, 0.015], ''),
        ([0.5, 0.5, -0.15, 0.015], 'joint_3 is 50.0 mm away'),
        ([0.5, 0.4, -0.1, 0.0], 'joint_2 is 5.7° away'),
    ):
        there = Trajectory(names, np.array([0.0, 1.0]), np.array([start, start]))
        assert control.away_from_start(there) == said


@pytest.mark.invariant(1)
def test_after_joint_states_that_were_missing_the_driver_is_asked_first_which_robot_it_has(
    robot: Robot, control: RobotControl
) -> None:
    """Another driver of the same name may have come, for a robot that is not simulated."""
    robot.state.times['first joints'] = NOW - 1.0
    robot.state.times['parameters'] = NOW - 1.5
    with pytest.raises(NotArmedError, match='which robot'):
        control.arming.arm(1)
    robot.state.times['parameters'] = NOW - 0.5
    control.arming.arm(1)
    assert control.arming.holder == 1
    robot.state.times['first joints'] = NOW
    control.look()
    assert control.arming.holder is None


@pytest.mark.invariant(1)
@pytest.mark.parametrize('silent', ['joints', 'status', 'diagnostics'])
def test_what_cannot_be_seen_is_not_moved(
    silent: str, robot: Robot, control: RobotControl
) -> None:
    control.arming.arm(1)
    robot.state.times[silent] -= MAX_AGES_S[silent] + 0.01
    control.look()
    assert control.arming.holder is None
    with pytest.raises(NotArmedError, match='cannot be seen'):
        control.arming.arm(1)


@pytest.mark.invariant(1)
def test_a_robot_that_nobody_says_is_simulated_is_moved_only_if_the_panel_may(
    robot: Robot, pendants: PendantThread
) -> None:
    careful = controlled(robot, pendants, allow_motion=False)
    with pytest.raises(NotArmedError, match='--allow-motion'):
        careful.arming.arm(1)
    robot.state.simulation = Simulation({'estop': 'not active'})
    careful.arming.arm(1)
    robot.state.times['simulation'] -= MAX_AGES_S['simulation'] + 0.01
    careful.arming.watch()
    assert careful.arming.holder is None


SHORT = Trajectory(('a', 'b'), np.array([0.0, 1.0]), np.zeros((2, 2)))


@pytest.mark.invariant(3)
def test_stop_and_disable_need_no_armed_browser(robot: Robot, control: RobotControl) -> None:
    control.stop()
    control.disable()
    assert robot.asked == ['stop', 'disable']


@pytest.mark.invariant(1)
def test_nothing_that_lets_the_arm_move_is_pressed_by_a_browser_that_is_not_armed(
    control: RobotControl,
) -> None:
    with pytest.raises(NotArmedError):
        control.press(1, 'Motors', 'on')
    with pytest.raises(NotArmedError):
        control.go_to_start(1, 'short', SHORT)


def test_where_no_simulated_controller_is_known_nothing_is_pressed(control: RobotControl) -> None:
    control.arming.arm(1)
    for what, how in (('Motors', 'on'), ('E-stop', 'press')):
        with pytest.raises(NotSimulatedError, match='no simulated controller is known'):
            control.press(1, what, how)


def test_a_trajectory_for_other_joints_is_refused_with_both_numbers(
    robot: Robot, control: RobotControl
) -> None:
    control.arming.arm(1)
    with pytest.raises(RequestError, match='the robot model is not known'):
        control.go_to_start(1, 'short', SHORT)
    control.look()
    robot.state.joint_names = tuple(f'joint_{number}' for number in range(1, 7))
    for ask in (control.execute, control.go_to_start):
        with pytest.raises(RequestError, match='for 2 joints, the robot has 6'):
            ask(1, 'short', SHORT)
    assert control.away_from_start(SHORT) == ''
    assert control.plan is None


def test_of_many_wishes_for_a_speed_the_last_one_is_asked_for(
    robot: Robot, control: RobotControl
) -> None:
    control.arming.arm(1)
    for factor in (0.9, 0.5, 0.2):
        control.set_speed(1, factor)
    ((factor, answered),) = robot.asked
    assert factor == 0.9
    answered('~/set_speed_scaling: refused', WARN)
    assert [factor for factor, _ in robot.asked] == [0.9, 0.2]
    robot.asked[-1][1]('done', INFO)
    assert len(robot.asked) == 2
    assert robot.logged == ['~/set_speed_scaling: refused']


def test_a_speed_that_nobody_takes_is_said_and_the_next_one_is_asked_for(
    robot: Robot, control: RobotControl
) -> None:
    """Otherwise the slider would be dead: one request would count as under way for ever."""
    control.arming.arm(1)
    robot.served = False
    with pytest.raises(NoDriverError):
        control.set_speed(1, 0.5)
    robot.served = True
    control.set_speed(1, 0.6)
    control.set_speed(1, 0.7)
    robot.served = False
    robot.asked[-1][1]('~/set_speed_scaling: no answer in 15 s', ERROR)
    assert robot.logged == [
        '~/set_speed_scaling: no answer in 15 s',
        'nobody serves ~/set_speed_scaling',
    ]
    robot.served = True
    control.set_speed(1, 0.8)
    assert [factor for factor, _ in robot.asked] == [0.6, 0.8]
