# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint limits of a URDF, of MoveIt's joint_limits.yaml, and of this package's models."""

from pathlib import Path

import numpy as np
import pytest

from epson_driver.bringup.moveit import joint_limits, robot_description
from epson_driver.inputs import InputError
from epson_driver.robots import load_robot_model
from epson_driver.robots.limit_files import ENDLESS, file_limits, limits_of, urdf_limits

RATIOS = (5.0, 10.0)
URDF = """<robot name="arm">
  <joint name="turn" type="revolute"><limit lower="-1" upper="2" velocity="3" effort="1"/></joint>
  <joint name="lift" type="prismatic"><limit lower="0" upper="0.4" velocity="0.5"/></joint>
  <joint name="spin" type="continuous"><limit velocity="6"/></joint>
  <joint name="copy" type="revolute"><limit velocity="6"/><mimic joint="turn"/></joint>
  <joint name="mount" type="fixed"/>
</robot>"""


def test_urdf_limits_are_read_and_defaults_assumed() -> None:
    rows = urdf_limits(URDF)
    assert set(rows) == {'turn', 'lift', 'spin'}
    limits, assumed = limits_of(['spin', 'lift', 'turn'], rows, RATIOS)
    assert limits.names == ('spin', 'lift', 'turn')
    assert limits.units == ('rad', 'm', 'rad')
    assert limits.position_max.tolist() == [ENDLESS, 0.4, 2.0]
    assert limits.velocity.tolist() == [6.0, 0.5, 3.0]
    assert limits.acceleration.tolist() == [30.0, 2.5, 15.0]
    assert limits.jerk.tolist() == [300.0, 25.0, 150.0]
    assert assumed[0] == 'spin: acceleration 30, 5 times its velocity'
    assert len(assumed) == 6


def test_moveit_file_overrides_the_urdf(tmp_path: Path) -> None:
    file = tmp_path / 'joint_limits.yaml'
    file.write_text(
        'default_velocity_scaling_factor: 0.1\n'
        'joint_limits:\n'
        '  turn: {has_velocity_limits: true, max_velocity: 1, has_acceleration_limits: true,\n'
        '    max_acceleration: 8, has_deceleration_limits: true, max_deceleration: -6,\n'
        '    has_jerk_limits: false, max_jerk: 7, has_position_limits: true, max_position: 1.5}\n',
        encoding='utf-8',
    )
    known = urdf_limits(URDF)['turn'] | file_limits(str(file))['turn']
    limits, assumed = limits_of(['turn'], {'turn': known}, RATIOS)
    result = [float(getattr(limits, name)[0]) for name in ('velocity', 'acceleration', 'jerk')]
    assert result == [1.0, 6.0, 60.0]
    assert (limits.position_min[0], limits.position_max[0]) == (-1.0, 1.5)
    assert assumed == ['turn: jerk 60, 10 times its acceleration']


@pytest.mark.parametrize('model', ['c3_a601s', 'gx4_c251s'])
def test_model_limits_survive_each_file_format(model: str, tmp_path: Path) -> None:
    import yaml

    robot = load_robot_model(model)
    file = tmp_path / 'joint_limits.yaml'
    file.write_text(yaml.safe_dump(joint_limits(robot)), encoding='utf-8')
    described = urdf_limits(robot_description(model))
    names = robot.joint_names
    ways = (
        file_limits(model),
        {name: described[name] | file_limits(str(file))[name] for name in names},
    )
    for rows in ways:
        limits, assumed = limits_of(names, rows, RATIOS)
        assert not assumed
        assert limits.units == robot.limits.units
        for name in ('velocity', 'acceleration', 'jerk'):
            assert np.array_equal(getattr(limits, name), getattr(robot.limits, name))
        assert limits.position_max == pytest.approx(robot.limits.position_max, abs=1e-4)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('joint_limits: [1]', 'joint_limits = [1]: must be a mapping of joints'),
        ('joint_limits: {a: 3}', 'a = 3: must be a mapping of limits'),
        (
            'joint_limits: {a: {has_velocity_limits: true, max_velocity: fast}}',
            "a: max_velocity = 'fast': must be a number",
        ),
        ('joint_limits: {a: {has_velocity_limits: true, max_velocity: .nan}}', 'must be a number'),
    ],
)
def test_invalid_limit_file_is_refused(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / 'joint_limits.yaml'
    file.write_text(text, encoding='utf-8')
    with pytest.raises(InputError) as refused:
        file_limits(str(file))
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ({}, 'a: no position min limit: publish the URDF'),
        (
            {'a': {'position_min': 1.0, 'position_max': 0.0, 'velocity': 1.0}},
            'a: position range 1.0 … 0.0 is empty',
        ),
        (
            {'a': {'position_min': 0.0, 'position_max': 1.0, 'velocity': 0.0}},
            'a: velocity = 0.0 must be positive',
        ),
    ],
)
def test_impossible_limits_are_refused(rows: dict[str, dict[str, float]], message: str) -> None:
    with pytest.raises(InputError) as refused:
        limits_of(['a'], rows, RATIOS)
    assert message in str(refused.value)


def test_description_that_is_not_xml_is_refused() -> None:
    with pytest.raises(InputError, match='the robot description is not XML'):
        urdf_limits('<robot>')
