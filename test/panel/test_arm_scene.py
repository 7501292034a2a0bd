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

from epson_driver.panel.scene import ArmScene
from epson_driver.panel.smooth_mesh import _smoothed, arm_meshes, quaternion
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
