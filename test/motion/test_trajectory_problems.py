# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Problems of a trajectory are named with point, joint, value and limit."""

from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from support.examples import one_in

from epson_driver.motion import JointLimits, Trajectory, problems
from epson_driver.motion.trajectory import BLOCK_POINTS
from epson_driver.robots import load_robot_model

NAMES = ('shoulder', 'elbow', 'wrist')
LIMITS = JointLimits(
    NAMES,
    position_min=np.array([-1.0, -2.0, -3.0]),
    position_max=np.array([1.0, 2.0, 0.5]),
    velocity=np.array([1.0, 2.0, 4.0]),
    acceleration=np.array([10.0, 20.0, 40.0]),
    jerk=np.array([100.0, 200.0, 400.0]),
)
NAN = float('nan')
INF = float('inf')
PLANS = sorted((Path(__file__).parents[2] / 'config' / 'trajectories').glob('*.yaml'))


def trajectory(*changes: tuple[str, Any, float]) -> Trajectory:
    """Return a valid trajectory of four points with changed numbers (quantity, index)."""
    columns = {
        'times': np.array([0.0, 1.0, 2.0, 3.0]),
        'positions': np.array([[0.0, 0.0, 0.0], [0.5, 1.0, -1.0], [0.9, 1.9, -2.9], [0.0] * 3]),
        'velocities': np.zeros((4, 3)),
        'accelerations': np.zeros((4, 3)),
    }
    for quantity, index, value in changes:
        columns[quantity][index] = value
    return Trajectory(NAMES, **columns)


def test_valid_trajectory_has_no_problems() -> None:
    assert list(problems(trajectory(), LIMITS)) == []
    bare = Trajectory(NAMES, trajectory().times, trajectory().positions)
    assert list(problems(bare, LIMITS)) == []
    assert bare.duration == 3.0


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('changes', 'sentences'),
    [
        (
            [('times', 2, NAN)],
            ['point 2: time_from_start = nan is not finite'],
        ),
        (
            [('positions', (1, 2), NAN)],
            ['point 1, wrist: positions = nan rad is not finite'],
        ),
        (
            [('velocities', (3, 0), INF)],
            ['point 3, shoulder: velocities = inf rad/s is not finite'],
        ),
        (
            [('positions', (0, 0), NAN), ('positions', (2, 1), INF), ('velocities', (1, 1), 99.0)],
            [
                'point 0, shoulder: positions = nan rad is not finite',
                'point 2, elbow: positions = inf rad is not finite',
            ],
        ),
        (
            [('times', 0, -0.5)],
            ['point 0: time_from_start = -0.5 s is negative'],
        ),
        (
            [('times', 2, 1.0)],
            [
                'point 2: time_from_start = 1 s is not after the 1 s of the point before: '
                'times must strictly increase'
            ],
        ),
        (
            [('positions', (1, 0), 1.25), ('positions', (2, 2), -3.5)],
            [
                'point 1, shoulder: position 1.25 rad is outside the limits -1 … 1 rad',
                'point 2, wrist: position -3.5 rad is outside the limits -3 … 0.5 rad',
                'points 0 to 1, shoulder: 1.25 rad/s would be needed, '
                'the velocity limit is 1 rad/s',
            ],
        ),
        (
            [('velocities', (1, 1), 2.5), ('velocities', (2, 0), -1.5)],
            [
                'point 1, elbow: velocity 2.5 rad/s is outside the limits -2 … 2 rad/s',
                'point 2, shoulder: velocity -1.5 rad/s is outside the limits -1 … 1 rad/s',
            ],
        ),
        (
            [('times', 1, 0.25)],
            [
                'points 0 to 1, shoulder: 2 rad/s would be needed, the velocity limit is 1 rad/s',
                'points 0 to 1, elbow: 4 rad/s would be needed, the velocity limit is 2 rad/s',
            ],
        ),
        ([('accelerations', (1, 1), 1e6)], []),
    ],
    ids=lambda x: str(x)[:60],
)
def test_inv2_problem_names_point_joint_value_and_limit(
    changes: list[tuple[str, Any, float]], sentences: list[str]
) -> None:
    assert list(problems(trajectory(*changes), LIMITS)) == sentences


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    'point', [1, BLOCK_POINTS - 1, BLOCK_POINTS, BLOCK_POINTS + 1, 2 * BLOCK_POINTS + 9]
)
@pytest.mark.parametrize(
    ('quantity', 'value', 'words'),
    [
        ('positions', NAN, 'positions = nan rad is not finite'),
        ('positions', 2.5, 'position 2.5 rad is outside'),
        ('velocities', -9.0, 'velocity -9 rad/s is outside'),
        ('positions', 1.5, 'rad/s would be needed'),
    ],
)
def test_inv2_problem_in_any_block_of_a_long_trajectory_is_found(
    point: int, quantity: str, value: float, words: str
) -> None:
    """Long trajectories are checked in blocks, so the points include block boundaries."""
    count = 2 * BLOCK_POINTS + 10
    columns = {
        'times': 0.1 * np.arange(count),
        'positions': np.zeros((count, 3)),
        'velocities': np.zeros((count, 3)),
    }
    assert list(problems(Trajectory(NAMES, **columns), LIMITS)) == []
    columns[quantity][point, 1] = value
    result = list(problems(Trajectory(NAMES, **columns), LIMITS))
    assert any(words in text for text in result)
    named = (
        f'points {point - 1} to {point}, elbow' if 'needed' in words else f'point {point}, elbow'
    )
    assert any(text.startswith(named) for text in result)


def test_trajectory_without_points_is_a_problem() -> None:
    empty = Trajectory(NAMES, np.empty(0), np.empty((0, 3)))
    assert list(problems(empty, LIMITS)) == ['the trajectory has no points']


@pytest.mark.invariant(2)
@pytest.mark.parametrize(('excess', 'count'), [(0.0, 0), (1e-7, 0), (1e-4, 1)])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_inv2_limits_are_checked_up_to_rounding(sign: float, excess: float, count: int) -> None:
    fast = trajectory(('velocities', (1, 0), sign * (1.0 + excess)))
    far = trajectory(('positions', (1, 1), sign * 2.0 * (1.0 + excess)))
    steep = trajectory(('positions', (1, 0), sign * 0.25), ('times', 1, 0.25 / (1.0 + excess)))
    steep.positions[2] = steep.positions[1]
    assert len(list(problems(fast, LIMITS))) == count
    assert len([text for text in problems(far, LIMITS) if 'position' in text]) == count
    assert len([text for text in problems(steep, LIMITS) if 'shoulder' in text]) == count


@pytest.mark.parametrize('order', [*permutations(range(3))], ids=str)
def test_in_order_reorders_every_column(order: tuple[int, ...]) -> None:
    columns = np.arange(12.0).reshape(4, 3)
    given = Trajectory(NAMES, np.arange(4.0), columns, columns + 100.0, columns + 200.0)
    names = tuple(NAMES[index] for index in order)
    ordered = given.in_order(names)
    assert ordered.joint_names == names
    assert ordered.times is given.times
    for quantity in ('positions', 'velocities', 'accelerations'):
        for column, name in enumerate(names):
            expected = getattr(given, quantity)[:, NAMES.index(name)]
            np.testing.assert_array_equal(getattr(ordered, quantity)[:, column], expected)


def test_in_order_keeps_missing_columns_and_rejects_an_unknown_joint() -> None:
    bare = Trajectory(NAMES, trajectory().times, trajectory().positions)
    ordered = bare.in_order(NAMES[::-1])
    assert (ordered.velocities, ordered.accelerations) == (None, None)
    with pytest.raises(ValueError, match='not in tuple'):
        bare.in_order(('shoulder', 'elbow', 'tool'))


@pytest.mark.invariant(2)
@pytest.mark.parametrize('path', one_in(3, PLANS), ids=[path.stem for path in PLANS])
def test_inv2_trajectories_of_this_package_have_no_problems(
    path: Path,
) -> None:
    plan = yaml.safe_load(path.read_text(encoding='utf-8'))
    points = plan['points']
    model = 'gx8_c652s' if path.stem.startswith('scara') else 'c3_a601s'
    limits = load_robot_model(model).limits

    def table(quantity: str) -> Any:
        rows = [point[quantity] for point in points]
        return np.array(rows) if any(rows) else None

    stamps = [point['time_from_start'] for point in points]
    planned = Trajectory(
        tuple(plan['joint_names']),
        np.array([stamp['sec'] + stamp['nanosec'] * 1e-9 for stamp in stamps]),
        table('positions'),
        table('velocities'),
        table('accelerations'),
    )
    assert planned.joint_names == limits.names
    assert len(points) >= 10
    assert list(problems(planned, limits)) == []
