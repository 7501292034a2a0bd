# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tools of `~/set_tool` and of parameters, and the errors of invalid ones."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from support.examples import one_in

from epson_driver import aio
from epson_driver.node.tool_interface import (
    link_prefix,
    links,
    named_tool,
)
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.urdf import urdf

MODEL = load_robot_model('c3_a601s')
GOOD = [0.01, 0.02, 0.1, 0.0, 0.0, 0.6, 0.8]
NAN, HUGE = float('nan'), 1e300


def test_tool_equals_the_python_api_s_tool() -> None:
    robot = aio.Robot()
    robot.set_tool(GOOD)
    tool = named_tool(MODEL, GOOD, 'gripper')
    np.testing.assert_array_equal(tool.pose, robot.tool)
    assert tool.name == 'gripper'
    assert tool.values.tolist() == pytest.approx(GOOD)


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ([NAN, *GOOD[1:]], 'pose = [nan, 0.02, 0.1, 0.0, 0.0, 0.6, 0.8]: must be finite numbers'),
        ([*GOOD[:6], float('inf')], 'must be finite numbers'),
        ([*GOOD[:3], 0.0, 0.0, 0.0, 0.0], 'the quaternion x y z w = [0.0, 0.0, 0.0, 0.0] has'),
        ([*GOOD[:3], 0.0, 0.0, 0.0, 2.0], 'has length 2: must be 1'),
        ([0.0, 0.0, 100.0, *GOOD[3:]], 'pose: the tool is 100 m from the flange: at most 10 m'),
        ([HUGE, HUGE, HUGE, *GOOD[3:]], 'at most 10 m'),
        (GOOD[:6], 'pose has 6 numbers: must have 7'),
    ],
)
@pytest.mark.filterwarnings('ignore:overflow')
def test_invalid_tool_pose_is_rejected(values: list[float], expected: str) -> None:
    with pytest.raises(ValueError, match=re.escape(expected)):
        named_tool(MODEL, values, 'tool')


@pytest.mark.parametrize('name', ['', 'a/b', '/tool', '2nd', 'my tool', 'ä', 'a' * 101, 'tool\n'])
def test_invalid_tool_name_is_rejected(name: str) -> None:
    with pytest.raises(ValueError, match=r'^name = .*must be a word of letters'):
        named_tool(MODEL, GOOD, name)


@pytest.mark.parametrize('model', one_in(5, robot_models()))
def test_link_name_of_the_urdf_is_rejected_as_tool_name(model: str) -> None:
    """A frame with two parents would break the tf tree."""
    known = load_robot_model(model)
    root = ElementTree.fromstring(urdf(model))
    names = {str(link.get('name')) for link in root.iter('link')}
    assert links(known) == names | {'world'}
    for name in links(known):
        with pytest.raises(ValueError, match='must not be the name of a frame'):
            named_tool(known, GOOD, name)


def test_payload_above_the_arm_s_maximum_is_rejected() -> None:
    assert MODEL.payload is not None
    assert MODEL.checked_payload(MODEL.payload) == MODEL.payload
    assert replace(MODEL, payload=None).checked_payload(900.0) == 900.0
    for payload in (-0.1, NAN, MODEL.payload + 0.1):
        with pytest.raises(ValueError, match=rf'^payload = .* from 0 to {MODEL.payload:g} kg$'):
            MODEL.checked_payload(payload)


@pytest.mark.parametrize(
    ('frame', 'prefix'),
    [('base_link', ''), ('left_base_link', 'left_'), ('left/base_link', 'left/'), ('world', '')],
)
def test_frames_have_the_prefix_of_the_base_link(frame: str, prefix: str) -> None:
    assert link_prefix(frame) == prefix
