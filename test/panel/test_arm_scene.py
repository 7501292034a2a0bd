# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm that is drawn is the arm of the model."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip('viser')

from support.panel_client import PanelClient

from epson_driver.motion import Trajectory
from epson_driver.panel.scene import JOINT_RADIUS_M, LINK_RADIUS_M, ArmScene, _sticks
from epson_driver.panel.smooth_mesh import Mesh, _smoothed, arm_meshes, quaternion
from epson_driver.panel.web_server import WebServer
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.chain import rotation_about
from epson_driver.robots.kinematics import Kinematics


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


def test_a_model_without_meshes_has_none() -> None:
    model = load_robot_model('c3_a601s')
    assert arm_meshes(dataclasses.replace(model, name='somebody_s_own')) is None


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


def volume(mesh: Mesh) -> float:
    """Return the volume of a closed surface, m³; below 0 if its faces look inwards."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize('name', ['c3_a601s', 'gx4_c251s'])
def test_a_model_without_meshes_is_a_drum_at_each_joint_and_a_rod_to_the_next(name: str) -> None:
    model = dataclasses.replace(load_robot_model(name), name='somebody_s_own')
    shape = _sticks(model)
    assert len(shape) == len(model.joint_names) + 1
    ends = [*model.chain.origins, model.tool0.xyz]
    for link, meshes in enumerate(shape):
        drum, length = meshes[:1] if link else [], np.linalg.norm(ends[link])
        for mesh in drum:
            along = mesh.vertices @ model.chain.axes[link - 1]
            assert_allclose([along.min(), along.max()], [-JOINT_RADIUS_M, JOINT_RADIUS_M], 1e-5)
            assert volume(mesh) == pytest.approx(2 * np.pi * JOINT_RADIUS_M**3, rel=0.02)
        rods = meshes[len(drum) :]
        assert len(rods) == (length > 1e-6)
        for mesh in rods:
            assert_allclose(mesh.vertices[-2:], [np.zeros(3), ends[link]], atol=1e-6)
            assert volume(mesh) == pytest.approx(np.pi * LINK_RADIUS_M**2 * length, rel=0.02)


def lines(server: WebServer) -> set[str]:
    """Return the paths that are drawn."""
    held = server.viser.scene._handle_from_node_name
    return {path.rpartition('/')[2] for path in held if path.endswith(('driven', 'planned'))}


def test_the_way_of_a_plan_that_is_not_known_is_drawn_as_it_goes(server: WebServer) -> None:
    model = dataclasses.replace(load_robot_model('c3_a601s'), name='somebody_s_own')
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
