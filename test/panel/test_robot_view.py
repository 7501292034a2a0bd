# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The parts of a robot that are sent to the page, and the requests of a window."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.examples import one_in

from epson_driver.motion import Trajectory
from epson_driver.panel.requests import Requests
from epson_driver.panel.robot_control import RequestError, RobotControl
from epson_driver.panel.robot_state import MAX_AGES_S, Event, IoRange, RobotState
from epson_driver.panel.robot_view import (
    INPUT,
    OUTPUT,
    OVER_S,
    PERIOD_S,
    SPAN_S,
    History,
    RobotView,
)
from epson_driver.panel.sim_pendant import PendantThread
from epson_driver.panel.window import BadMessageError
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.robots.model import SCARA
from epson_driver.tool_motion.tool_pose import quaternion_pose

NOW = 100.0
MODEL = load_robot_model('c3_a601s')
NAMES = MODEL.joint_names
TRAJECTORY = Trajectory(NAMES, np.array([0.0, 1.0]), np.array([[0.0] * 6, [0.2] * 6]))
BROWSER = 7


class Robot:
    """The panel's robot without ROS: a state, and the requests to the driver."""

    name = '/left/epson_driver'

    def __init__(self, model: RobotModel) -> None:
        names = model.joint_names
        positions = np.zeros(len(names))
        self.state = RobotState(joint_names=names, positions=positions, link='connected')
        self.state.times = dict.fromkeys((*MAX_AGES_S, 'first joints', 'parameters'), NOW)
        self.parameters: dict[str, Any] = {
            'robot_model': model.name, 'robot_ip': '192.0.2.1', 'remote_port': 0,
        }  # fmt: skip
        self.goals: list[Any] = []
        self.executed: list[tuple[Trajectory, str]] = []
        self.written: list[tuple[int, int]] = []
        self.jogged: list[list[float]] = []

    def log(self, text: str, level: int) -> None:
        self.state.add_event(Event(NOW, level, text))

    def cancel_goals(self) -> list[Any]:
        return []

    def execute(self, trajectory: Trajectory, text: str, _say: Any) -> None:
        self.executed.append((trajectory, text))

    def write_output(self, index: int, value: int, _say: Any) -> None:
        self.written.append((index, value))

    def jog(self, names: tuple[str, ...], velocities: np.ndarray) -> None:
        assert tuple(names) == NAMES
        self.jogged.append(velocities.tolist())


class ViewAndRequests:
    """A view of a robot and the requests of one window."""

    def __init__(self, model: RobotModel = MODEL) -> None:
        self.pendants = PendantThread(time.monotonic, self.fail)
        self.robot = Robot(model)
        self.control = RobotControl(
            self.robot,  # type: ignore[arg-type]
            self.pendants.pendant,
            lambda: NOW,
            allow_motion=True,
        )
        self.view = RobotView(self.control, {'way': TRAJECTORY}, 'left')
        self.control.arming.connect(BROWSER)
        self.control.arming.alive(BROWSER)
        self.view.update(NOW)
        self.table = Requests({'way': TRAJECTORY}).table

    def fail(self, what: str, error: BaseException) -> None:
        raise AssertionError(what) from error

    def arm(self) -> None:
        self.control.arming.arm(BROWSER)

    def ask(self, word: str, **more: Any) -> None:
        self.table[word](self.control, BROWSER, more)

    def part(self, name: str, now: float = NOW) -> Any:
        return json.loads((self.view.parts(now) | self.view.pose(now))[name])


@pytest.fixture
def shown() -> Iterator[ViewAndRequests]:
    result = ViewAndRequests()
    yield result
    result.pendants.end()


def test_path_of_a_foreign_goal_is_drawn_during_motion(shown: ViewAndRequests) -> None:
    shown.control.plan = TRAJECTORY
    shown.view.update(NOW)
    own = shown.part('plan')
    ends = [Kinematics(MODEL).forward(joints)[:3, 3] for joints in TRAJECTORY.positions]
    assert_allclose([own['points'][0], own['points'][-1]], ends, atol=1e-4)
    shown.view.update(NOW + 10.0)  # nothing is executed any more
    shown.robot.state.times['joints'] = shown.robot.state.times['reference'] = NOW + 20.0
    shown.robot.state.reference = np.full(6, 0.1)
    shown.view.update(NOW + 20.0)
    theirs = shown.part('plan', NOW + 20.0)
    assert theirs['points'] is None
    assert theirs['number'] != own['number']
    assert shown.part('pose', NOW + 20.0)['plan'] == [0.1] * 6


def test_taught_points_are_in_pendant_units(shown: ViewAndRequests) -> None:
    assert shown.part('taught') == {}
    arm = Kinematics(MODEL)
    pose = arm.forward(np.array([0.3, 0.2, 0.1, 0.0, -0.8, 0.4]))
    shown.robot.state.taught = {'pick': quaternion_pose(pose)}
    place = shown.part('taught')['pick']
    base = np.array(shown.part('arm')['base'])
    assert_allclose(base @ [*np.array(place[:3]) / 1e3, 1.0], pose[:3, 3], atol=1e-6)
    assert_allclose(rotation_of_uvw(np.radians(place[3:])), arm.in_base(pose)[:3, :3], atol=1e-4)


@pytest.mark.invariant(6)
def test_unknown_model_is_not_drawn(shown: ViewAndRequests) -> None:
    assert shown.part('arm')['units'] == ['°'] * 6
    assert shown.part('pose')['joints'] == [0.0] * 6
    shown.robot.parameters['robot_model'] = '/no/such/file.yaml'
    shown.view.update(NOW)
    assert shown.part('arm') is None
    assert shown.part('pose') is None


@pytest.mark.invariant(6)
def test_outdated_joints_are_marked_and_not_in_the_curves(shown: ViewAndRequests) -> None:
    assert shown.part('pose')['fresh']
    later = NOW + MAX_AGES_S['joints'] + 0.1
    rows = json.loads(shown.view.history())
    shown.view.update(later)
    assert not shown.part('pose', later)['fresh']
    assert json.loads(shown.view.history()) == rows


def test_tool_pose_is_in_pendant_units(shown: ViewAndRequests) -> None:
    joints = np.array([0.1, 0.2, 0.3, 0.4, -0.5, 0.6])
    shown.robot.state.positions = joints
    place, angles = Kinematics(MODEL).epson_point(joints)
    wanted = [*(1e3 * place), *np.degrees(angles)]
    assert_allclose(shown.part('pose')['tool'], wanted, atol=0.006)


@pytest.mark.parametrize('name', one_in(25, robot_models()))
def test_every_model_is_drawn_and_its_cautions_are_logged(name: str) -> None:
    model = load_robot_model(name)
    shown = ViewAndRequests(model)
    try:
        arm, pose = shown.part('arm'), shown.part('pose')
        kinds = [{'rad': '°', 'm': 'mm'}[unit] for unit in model.limits.units]
        assert (arm['description'], arm['units']) == (model.description, kinds)
        assert len(arm['packed']['origins']) == len(model.joint_names)
        if model.kind == SCARA:
            assert pose['tool'][2] == pytest.approx(0.0, abs=1e-6)
        logged = [text for _, _, text in shown.part('log')]
        assert [text for text in logged if 'compare them' in text] == list(model.cautions)
    finally:
        shown.pendants.end()


def test_io_shows_values_or_the_reason_for_none(shown: ViewAndRequests) -> None:
    assert shown.part('io') == 'nothing reported yet'
    shown.robot.state.io_reason = ''
    shown.robot.state.io = (IoRange(1, 8, (0, 1)), IoRange(3, 0, (1200,)), IoRange(5, 0, (7,)))
    result = shown.part('io')
    assert [(item['name'], item['start'], item['values'], item['analog']) for item in result] == [
        ('Inputs', 8, [0, 1], False),
        ('Analog inputs [mV]', 0, [1200], True),
    ]


@pytest.mark.invariant(1)
def test_unknown_trajectories_and_outputs_are_refused(shown: ViewAndRequests) -> None:
    shown.arm()
    state = shown.robot.state
    state.io, state.io_reason = (IoRange(OUTPUT, 8, (0, 1)), IoRange(INPUT, 0, (0,))), ''
    for word in ('execute', 'go_to_start'):
        with pytest.raises(RequestError, match='unknown trajectory'):
            shown.ask(word, name='none')
    for index in (7, 10):
        with pytest.raises(RequestError, match=f'unknown point {index}'):
            shown.ask('output', index=index)
    shown.ask('output', index=8)
    shown.ask('output', index=9)
    assert shown.robot.written == [(8, 1), (9, 0)]
    state.io_reason = 'the I/O port is closed'
    with pytest.raises(RequestError, match='I/O is unknown: the I/O port is closed'):
        shown.ask('output', index=8)
    assert shown.robot.written == [(8, 1), (9, 0)]


POINT = [
    *(1e3 * Kinematics(MODEL).epson_point(np.full(6, 0.2))[0]),
    *np.degrees(Kinematics(MODEL).epson_point(np.full(6, 0.2))[1]),
]

MOVES: dict[str, dict[str, Any]] = {
    'execute': {'name': 'way'},
    'go_to_start': {'name': 'way'},
    'go_to': {'name': 'pick', **dict(zip('xyzuvw', POINT, strict=True))},
    'jog': {'axis': '1', 'frame': 'world', 'share': 0.5},
    'step': {'axis': 'X', 'frame': 'tool', 'size': 0.001, 'share': 0.5},
}


@pytest.mark.invariant(1)
@pytest.mark.parametrize('word', MOVES)
def test_motion_requests_need_an_armed_window(word: str, shown: ViewAndRequests) -> None:
    shown.robot.state.positions = np.array([0.0, 0.0, 0.0, 0.0, -0.5, 0.0])
    with pytest.raises(RequestError, match='not armed'):
        shown.ask(word, **MOVES[word])
    assert shown.robot.jogged == shown.robot.executed == []
    shown.arm()
    if word == 'execute':
        with pytest.raises(RequestError, match='move there first'):
            shown.ask(word, **MOVES[word])
        shown.robot.state.positions = np.zeros(6)
    shown.ask(word, **MOVES[word])
    assert len(shown.robot.jogged) + len(shown.robot.executed) == 1


@pytest.mark.invariant(10)
@pytest.mark.parametrize('prefix', ['', 'left_'])
def test_inv10_trajectory_is_mapped_by_joint_names(prefix: str, shown: ViewAndRequests) -> None:
    shown.arm()
    names = shown.robot.state.joint_names = tuple(prefix + name for name in NAMES)
    there = np.arange(6) / 10.0
    points = np.array([np.zeros(6), there[::-1]])
    for own in {names, NAMES}:
        back = Trajectory(own[::-1], np.array([0.0, 1.0]), points)
        shown.control.execute(BROWSER, 'back', back)
        executed = shown.robot.executed[-1][0]
        assert executed.joint_names == names
        assert_allclose(executed.positions[-1], there)
        assert shown.control.away_from_start(replace(back, positions=points[::-1])) == (
            'joint_6 is 28.6° away'
        )


def test_motion_to_a_point_uses_the_nearest_configuration(shown: ViewAndRequests) -> None:
    shown.arm()
    shown.ask('go_to', **MOVES['go_to'])
    assert_allclose(shown.robot.executed[0][0].positions[-1], np.full(6, 0.2), atol=1e-6)
    with pytest.raises(RequestError, match='out of reach'):
        shown.ask('go_to', **(MOVES['go_to'] | {'x': 5000.0}))


@pytest.mark.invariant(3)
def test_jog_brakes_when_the_window_disconnects(shown: ViewAndRequests) -> None:
    shown.arm()
    shown.ask('jog', **MOVES['jog'])
    shown.control.arming.disconnect(BROWSER)
    assert shown.robot.jogged[-1] == [0.0] * 6
    shown.ask('jog', share=0)  # ignored: nothing moves
    assert len(shown.robot.jogged) == 2


@pytest.mark.parametrize(
    ('word', 'more'),
    [
        ('jog', {}),
        ('jog', {'axis': '1', 'frame': 'world', 'share': 1.5}),
        ('jog', {'axis': '1', 'frame': 'world', 'share': float('nan')}),
        ('jog', {'axis': '1', 'frame': 'moon', 'share': 1}),
        ('jog', {'axis': 1, 'frame': 'world', 'share': 1}),
        ('step', {'axis': '1', 'frame': 'world', 'share': 1, 'size': True}),
        ('go_to', {'name': 'a', **dict.fromkeys('xyzuv', 0.0)}),
        ('go_to', {'name': 'a', **dict.fromkeys('xyzuvw', '0')}),
        ('go_to', {'name': 'a', **dict.fromkeys('xyzuvw', 1e9)}),
        ('go_to', {'name': 'a' * 300, **dict.fromkeys('xyzuvw', 0.0)}),
        ('speed', {'value': '1'}),
        ('press', {'what': 'E-stop', 'how': 'lick'}),
        ('press', {'what': ['E-stop'], 'how': 'press'}),
        ('output', {'index': -1}),
        ('fault', {}),
    ],
)
@pytest.mark.invariant(7)
def test_invalid_request_is_rejected(
    word: str, more: dict[str, Any], shown: ViewAndRequests
) -> None:
    shown.arm()
    with pytest.raises(BadMessageError):
        shown.ask(word, **more)
    assert shown.robot.jogged == shown.robot.executed == shown.robot.written == []


def test_velocities_are_robust_to_jittering_time_stamps() -> None:
    """Differences of joint states 5 ms apart with 2 ms jitter would have 40 % error."""
    history, random = History(np.ones(1)), np.random.default_rng(3)
    for now in np.arange(0.0, 3.0, 0.04):
        measured = now + random.uniform(-0.002, 0.002)
        history.add(now, measured, np.array([0.5 * now]), None)
    result = [row[2][0] for row in history.rows if row[2] is not None]
    assert len(result) > 2.0 / PERIOD_S / 1.5
    assert_allclose(result, 0.5, rtol=2 * 0.004 / OVER_S)


def test_curves_have_gaps_and_a_limited_span() -> None:
    history = History(np.array([2.0]))
    for now in (0.0, 0.2, 0.25, 3.0, 3.2):
        history.add(now, now, np.array([now]), None if now < 3.0 else np.array([0.1]))
    assert list(history.rows) == [
        (0.0, [0.0], None, None),
        (0.2, [0.4], [2.0], None),
        (3.0, [6.0], None, [0.2]),
        (3.2, [6.4], [2.0], [0.2]),
    ]
    history.add(3.0 + SPAN_S, 3.1 + SPAN_S, np.zeros(1), None)
    assert [row[0] for row in history.rows] == [3.0, 3.2, 3.0 + SPAN_S]
