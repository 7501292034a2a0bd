# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The page of a robot in the panel, and the arm that it draws."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.panel_client import PanelClient

from epson_driver.motion import Trajectory
from epson_driver.panel.scene import ArmScene
from epson_driver.panel.smooth_mesh import _smoothed, arm_meshes, quaternion
from epson_driver.panel.web_server import WebServer
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.chain import rotation_about
from epson_driver.robots.kinematics import Kinematics

pytest.importorskip('viser')

from support.ros_peer import PATIENCE

from epson_driver.panel.robot_control import RequestError, RobotControl
from epson_driver.panel.robot_page import INPUT, OUTPUT, BrowserControls, RobotPage
from epson_driver.panel.robot_state import MAX_AGES_S, IoRange, RobotState
from epson_driver.panel.sim_pendant import PendantThread

NOW = 100.0
NAMES = load_robot_model('c3_a601s').joint_names
WAY = Trajectory(NAMES, np.array([0.0, 1.0]), np.array([[0.0] * 6, [0.2] * 6]))


class Robot:
    """What a driver has said, and what it was asked for."""

    name = '/left/epson_driver'

    def __init__(self) -> None:
        zeros = np.zeros(6)
        self.state = RobotState(
            joint_names=NAMES, positions=zeros, velocities=zeros, link='connected'
        )
        self.state.times = dict.fromkeys((*MAX_AGES_S, 'first joints', 'parameters'), NOW)
        self.parameters: dict[str, Any] = {
            'robot_model': 'c3_a601s', 'robot_ip': '192.0.2.1', 'remote_port': 0,
        }  # fmt: skip
        self.goals: list[Any] = []
        self.written: list[tuple[int, int]] = []

    def log(self, text: str, _level: int) -> None:
        pass

    def cancel_goals(self) -> list[Any]:
        return []

    def write_output(self, index: int, value: int, _say: Any) -> None:
        self.written.append((index, value))


class Page:
    """A page, and the controls of one browser that is armed."""

    def __init__(self, trajectories: dict[str, Trajectory]) -> None:
        self.web = WebServer('127.0.0.1', 0, None)
        viewer = self.web.viser
        self.pendants = PendantThread(time.monotonic, self.fail)
        self.robot = Robot()
        self.control = RobotControl(
            self.robot,  # type: ignore[arg-type]
            self.pendants,
            lambda: NOW,
            on_error=self.fail,
            allow_motion=True,
        )
        group = viewer.gui.add_tab_group()
        tabs = group.add_tab('right'), group.add_tab('left')
        self.page = RobotPage(viewer, self.control, trajectories, tabs, np.zeros(3), '')
        self.client = PanelClient(self.web.port)
        self.client.wait(viewer.get_clients, 'a browser')
        (handle,) = viewer.get_clients().values()
        self.control.arming.connect(handle.client_id)
        self.control.arming.alive(handle.client_id)
        self.controls = BrowserControls(self.page, handle)
        self.browser = handle.client_id

    def fail(self, what: str, error: BaseException) -> None:
        raise AssertionError(what) from error

    def drawn(self) -> set[str]:
        """Return what is drawn of the robot, by the ends of the paths."""
        held = self.web.viser.scene._handle_from_node_name
        return {path.rpartition('/')[2] for path in held if path.startswith('/robots/')}

    def close(self) -> None:
        self.client.close()
        self.pendants.end()
        self.web.stop()


@pytest.fixture
def made() -> Iterator[Page]:
    found = Page({})
    yield found
    found.close()


def test_the_way_of_somebody_else_s_goal_is_drawn_as_it_goes(made: Page) -> None:
    made.control.look()
    made.control.plan = WAY
    made.page.draw_pose(NOW)
    assert 'planned' in made.drawn()
    made.page.draw_pose(NOW + 10.0)  # nothing is executed any more
    made.robot.state.times['joints'] = made.robot.state.times['reference'] = NOW + 20.0
    for step in range(3):
        made.robot.state.reference = np.full(6, 0.1 * step)
        made.robot.state.positions = np.full(6, 0.09 * step)
        made.page.draw_pose(NOW + 20.0)
        if step == 0:
            assert 'planned' not in made.drawn()  # that was the panel's own
    made.page.draw_curves(NOW + 20.0)
    assert {'planned', 'driven'} <= made.drawn()


@pytest.mark.invariant(6)
def test_a_model_that_is_not_known_any_more_is_not_drawn(made: Page) -> None:
    made.control.look()
    made.page.draw_pose(NOW)
    made.page.draw_text(NOW)
    assert 'arm' in made.drawn()
    assert 'joint_6' in made.page._joints.content
    made.robot.parameters['robot_model'] = 'gx4_c251s'
    made.control.look()
    made.page.draw_pose(NOW)
    curves = list(made.page._curves)
    assert len(curves) == 3
    made.robot.parameters['robot_model'] = '/no/such/file.yaml'
    made.control.look()
    made.page.draw_pose(NOW)
    made.page.draw_text(NOW)
    assert made.drawn() == set()
    assert made.page._joints.content == ''


@pytest.mark.slow
def test_a_window_that_is_not_armed_shows_the_speed_of_the_driver(made: Page) -> None:
    made.robot.state.speed = 0.4
    made.controls.refresh()
    assert made.controls._speed.value == 40
    made.control.arming.arm(made.browser)
    made.robot.state.speed = 0.7
    made.controls.refresh()
    assert made.controls._speed.value == 40  # a person's hand is at it


@pytest.mark.invariant(1)
def test_what_is_not_there_is_not_switched_and_not_executed(made: Page) -> None:
    made.control.arming.arm(made.browser)
    state = made.robot.state
    state.io, state.io_reason = (IoRange(OUTPUT, 8, (0, 1)), IoRange(INPUT, 0, (0,))), ''
    for action in (made.controls._execute, made.controls._go_to_start):
        with pytest.raises(RequestError, match='there is no trajectory to execute'):
            action()
    for index in (7, 10):
        with pytest.raises(RequestError, match=f'there is no point {index}'):
            made.controls._switch(index, OUTPUT)
    made.controls._switch(8, OUTPUT)
    made.controls._switch(9, OUTPUT)
    assert made.robot.written == [(8, 1), (9, 0)]
    state.io_reason = 'the I/O port is closed'
    with pytest.raises(RequestError, match='I/O is not known: the I/O port is closed'):
        made.controls._switch(8, OUTPUT)
    assert made.robot.written == [(8, 1), (9, 0)]


@pytest.mark.slow
def test_outputs_that_are_gone_have_no_buttons(made: Page) -> None:
    made.robot.state.io = (IoRange(OUTPUT, 8, (0, 1)),)
    made.controls.refresh()
    made.client.wait(lambda: 'Switch output' in made.client.labels, 'buttons of outputs')
    made.robot.state.io = ()
    made.controls.refresh()
    until = time.monotonic() + PATIENCE
    while 'Switch output' in made.client.labels:
        assert time.monotonic() < until
        time.sleep(0.01)


@pytest.mark.slow
def test_trajectories_for_another_number_of_joints_are_not_offered(made: Page) -> None:
    made.page.trajectories['way'] = WAY  # type: ignore[index]
    made.controls.refresh()
    assert made.controls._chosen.options == ('way',)
    made.robot.state.joint_names = NAMES[:4]
    made.controls.refresh()
    assert made.controls._chosen.options == ('none',)


pytest.importorskip('viser')


@pytest.fixture
def server() -> Iterator[WebServer]:
    found = WebServer('127.0.0.1', 0, None)
    yield found
    found.stop()


def rotation(wxyz: np.ndarray) -> np.ndarray:
    w, x, y, z = wxyz
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


@pytest.mark.parametrize('name', robot_models())
def test_every_model_is_drawn_where_its_kinematics_put_it(name: str, server: WebServer) -> None:
    model = load_robot_model(name)
    scene = ArmScene(server.viser, '/robot', model, np.zeros(3), '')
    limits = model.limits
    joints = limits.position_min + 0.3 * (limits.position_max - limits.position_min)
    scene.show(joints)
    frame = np.eye(4)
    for link, expected in zip(
        scene._arm._links, Kinematics(model).link_frames(joints), strict=True
    ):
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = rotation(link.wxyz), link.position
        frame = frame @ step
        assert_allclose(frame, expected, atol=1e-9)
    with PanelClient(server.port) as client:
        client.wait(lambda: 'MeshMessage' in client.kinds, 'meshes')


def test_meshes_keep_their_surface() -> None:
    for mesh in arm_meshes(load_robot_model('c3_a601s'))[1]:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        assert np.all(high - low > 0.005)
        assert np.all(np.abs(mesh.vertices) < 0.5)
        assert mesh.faces.max() == len(mesh.vertices) - 1


def test_creases_stay_and_flat_faces_share_vertices() -> None:
    corners = np.array(
        [
            [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            [[1, 0, 0], [1, 1, 0], [0, 1, 0]],  # in the same plane
            [[0, 0, 0], [0, 1, 0], [0, 0, 1]],  # across an edge of 90 degrees
        ],
        dtype=np.float32,
    )
    vertices, faces = _smoothed(corners)
    assert len(vertices) == 4 + 3
    assert_allclose(vertices[faces], corners)


def test_a_quaternion_is_the_rotation_of_the_kinematics() -> None:
    axis = np.array([0.6, 0.0, -0.8])
    assert_allclose(
        rotation(np.array(quaternion(axis, 1.234))), rotation_about(axis, 1.234), atol=1e-12
    )


def lines(server: WebServer) -> set[str]:
    """Return the paths that are drawn."""
    held = server.viser.scene._handle_from_node_name
    return {path.rpartition('/')[2] for path in held if path.endswith(('driven', 'planned'))}


def test_the_way_of_a_plan_that_is_not_known_is_drawn_as_it_goes(server: WebServer) -> None:
    model = load_robot_model('c3_a601s')
    scene = ArmScene(server.viser, '/robot', model, np.zeros(3), 'left')
    assert '/robot/name' in server.viser.scene._handle_from_node_name
    way = np.linspace(0.0, 0.2, 5)[:, None] * np.ones(6)
    scene.show_plan(None)
    for joints in way:
        scene.show_ghost(joints)
        scene.show(joints)
    assert lines(server) == set()
    scene.show_path()
    assert lines(server) == {'driven', 'planned'}
    short = Trajectory(model.joint_names, np.array([1.0]), way[-1:])
    scene.show_plan(short)  # one point is no way, but what was driven before is forgotten
    assert lines(server) == set()
    scene.show_plan(Trajectory(model.joint_names, np.linspace(0.0, 1.0, 5), way))
    assert lines(server) == {'planned'}
