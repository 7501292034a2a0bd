# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every field of a goal has an effect or an error: cases for each row in docs/goals.md."""

import importlib
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import (
    ExecuteMotionPrimitiveSequence,
    FollowJointTrajectory,
    GripperCommand,
)
from control_msgs.msg import JointComponentTolerance, JointTolerance, MotionArgument
from control_msgs.msg import MotionPrimitive as Motion
from geometry_msgs.msg import PoseStamped
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from epson_driver.driver.goal.goal import checked_goal
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.node.io_interface import refusal
from epson_driver.node.motion_primitives import primitives_from_message
from epson_driver.node.trajectory_messages import GoalRequests
from epson_driver.robots import load_robot_model
from epson_driver.setup.setup import make_setup

PAGE = Path(__file__).parents[2] / 'docs' / 'goals.md'
LIMITS = load_robot_model('c3_a601s').limits
NAN = float('nan')
NOW, LOOP_NOW = 1_800_000_000, 50.0
"""The node's clock and the loop's, s."""

GOALS = {
    FollowJointTrajectory.Goal: lambda request: checked_goal(
        GoalRequests(
            make_setup({}),
            SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=NOW * 10**9)),
            lambda: LOOP_NOW,
        ).checked_goal(request),
        LIMITS,
    ),
    GripperCommand.Goal: lambda request: refusal(request.command),
    ExecuteMotionPrimitiveSequence.Goal: lambda request: primitives_from_message(
        request.trajectory, LIMITS, 'base_link'
    )[0],
}


def motion_to(*joints):
    request = FollowJointTrajectory.Goal()
    request.trajectory.joint_names = list(LIMITS.names)
    request.trajectory.points = [
        JointTrajectoryPoint(positions=[joint] * 6, time_from_start=Duration(sec=index))
        for index, joint in enumerate(joints)
    ]
    return request


def sequence(kind=Motion.LINEAR_JOINT):
    motion = Motion(type=kind)
    if kind == Motion.LINEAR_JOINT:
        motion.joint_positions = [0.1] * 6
    motion.poses = [PoseStamped() for _ in range(max(kind - 49, 0))]
    return ExecuteMotionPrimitiveSequence.Goal(
        trajectory=ExecuteMotionPrimitiveSequence.Goal().trajectory.__class__(motions=[motion])
    )


def line():
    return sequence(Motion.LINEAR_CARTESIAN)


def grip():
    return GripperCommand.Goal()


def turned():
    return motion_to(0.0, 0.1)


def set_to(value):
    """Return a function that sets a row's field in the last element of each sequence."""

    def change(request, row):
        *path, last = row.split('.')
        for name in path:
            request = getattr(request, name)
            if isinstance(request, list):
                request = request[-1]
        setattr(request, last, value)

    return change


def joint_2_to(value):
    """Return a function that sets the row's tolerance of the second joint."""

    def change(request, row):
        field, name = row.split('.')
        tolerance = JointTolerance(name=LIMITS.names[1])
        setattr(tolerance, name, value)
        getattr(request, field).append(tolerance)

    return change


def twice(request, row):
    tolerance = JointTolerance(name=LIMITS.names[0], position=0.1)
    setattr(request, row.split('.')[0], [tolerance, tolerance])


def argument(name, value):
    argument = MotionArgument(argument_name=name, argument_value=value)
    return lambda request, _: request.trajectory.motions[0].additional_arguments.append(argument)


def seconds(value, kind=Time):
    sec, nanosec = divmod(round(value * 1e9), 10**9)
    return kind(sec=sec, nanosec=nanosec)


def last(array):
    return lambda goal: getattr(goal.trajectory, array)[-1].tolist() == [0.01] * 6


def no_effect(goal):
    return np.array_equal(goal.trajectory.positions[-1], [0.1] * 6) and goal.start == 0.0


def read(field, value):
    return lambda goal: np.array_equal(np.array(getattr(goal, field)), np.array(value))


def tolerated(field, quantity, value):
    """Return a check that a goal has this tolerance of joint_2."""
    if field == 'path_tolerance':
        return lambda goal: getattr(goal.path_tolerance, quantity)[1] == value
    name = {'position': 'goal_tolerance', 'velocity': 'goal_velocity'}[quantity]
    return lambda goal: getattr(goal, name)[1] == value


CASES = [
    (turned, 'trajectory.header.stamp', set_to(Time()), no_effect),
    (turned, 'trajectory.header.stamp', set_to(seconds(NOW + 0.9)), read('start', LOOP_NOW + 0.9)),
    (turned, 'trajectory.header.stamp', set_to(seconds(NOW - 0.9)), read('start', LOOP_NOW - 0.9)),
    (turned, 'trajectory.header.stamp', set_to(seconds(NOW + 1.1)), '1.1 s in the future'),
    (
        turned,
        'trajectory.header.stamp',
        set_to(seconds(NOW - 1.1)),
        '1.1 s ago: must be at most 1 s',
    ),
    (turned, 'trajectory.header.stamp', set_to(seconds(1.0)), '1.8e+09 s ago'),
    (turned, 'trajectory.header.frame_id', set_to('world'), no_effect),
    (turned, 'trajectory.joint_names', set_to(['joint_1'] * 6), 'joint_names has joint_1 twice'),
    (turned, 'trajectory.joint_names', set_to([f'j{i}' for i in range(6)]), 'lacks joint_1'),
    (turned, 'trajectory.points.positions', set_to([0.01] * 6), last('positions')),
    (turned, 'trajectory.points.positions', set_to([]), 'point 1: 0 positions for 6 joints'),
    (
        turned,
        'trajectory.points.positions',
        set_to([NAN] * 6),
        'positions = nan rad is not finite',
    ),
    (turned, 'trajectory.points.positions', set_to([9.0] * 6), 'outside the limits'),
    (lambda: motion_to(0.1), 'trajectory.points.velocities', set_to([0.0] * 6), no_effect),
    (
        turned,
        'trajectory.points.velocities',
        set_to([0.0] * 6),
        'point 0: 0 velocities for 6 joints',
    ),
    (lambda: motion_to(0.1), 'trajectory.points.velocities', set_to([1.0] * 6), 'must be 0'),
    (
        lambda: motion_to(0.1),
        'trajectory.points.accelerations',
        set_to([0.01] * 6),
        last('accelerations'),
    ),
    (turned, 'trajectory.points.accelerations', set_to([1.0]), 'point 0: 0 accelerations for 6'),
    (turned, 'trajectory.points.effort', set_to([0.0] * 6), no_effect),
    (
        turned,
        'trajectory.points.effort',
        set_to([0.0] * 5 + [1.0]),
        'point 1: effort must be empty',
    ),
    (turned, 'trajectory.points.effort', set_to([NAN]), 'point 1: effort must be empty'),
    (
        turned,
        'trajectory.points.time_from_start',
        set_to(Duration(sec=7)),
        lambda goal: goal.trajectory.duration == 7.0,
    ),
    (
        turned,
        'trajectory.points.time_from_start',
        set_to(Duration(sec=-1)),
        'must strictly increase',
    ),
    *[
        (turned, f'{field}.{name}', change, expected)
        for field in ('path_tolerance', 'goal_tolerance')
        for name, change, expected in (
            ('name', joint_2_to('elbow'), f"{field} names the unknown joint 'elbow'"),
            ('name', twice, f'{field} has joint_1 twice'),
            ('position', joint_2_to(0.5), tolerated(field, 'position', 0.5)),
            ('position', joint_2_to(-1.0), no_effect),
            ('position', joint_2_to(NAN), f'{field}, joint_2: position = nan is not finite'),
            ('velocity', joint_2_to(0.5), tolerated(field, 'velocity', 0.5)),
            ('velocity', joint_2_to(NAN), f'{field}, joint_2: velocity = nan is not finite'),
            ('acceleration', joint_2_to(-1.0), no_effect),
            ('acceleration', joint_2_to(0.5), 'acceleration = 0.5 must be 0'),
        )
    ],
    (turned, 'goal_time_tolerance', set_to(seconds(2.5, Duration)), read('goal_time', 2.5)),
    (turned, 'goal_time_tolerance', set_to(Duration(sec=-1)), read('goal_time', 0.0)),
    *[
        (
            turned,
            field,
            set_to([JointComponentTolerance(joint_name='joint_1')]),
            f'{field} must be',
        )
        for field in ('component_path_tolerance', 'component_goal_tolerance')
    ],
    *[
        (
            turned,
            'multi_dof_trajectory',
            lambda request, _, name=name, value=value: setattr(
                request.multi_dof_trajectory, name, value
            ),
            'multi_dof_trajectory must be empty',
        )
        for name, value in {
            'joint_names': ['base'],
            'points': [MultiDOFJointTrajectoryPoint()],
        }.items()
    ],
    (grip, 'command.position', set_to(0.04), lambda refusal_text: refusal_text == ''),
    (grip, 'command.position', set_to(NAN), 'position = nan: must be finite'),
    (grip, 'command.max_effort', set_to(-1.0), lambda refusal_text: refusal_text == ''),
    (grip, 'command.max_effort', set_to(20.0), 'max_effort = 20: must be 0 (no limit)'),
    (grip, 'command.max_effort', set_to(NAN), 'max_effort = nan: must be 0 (no limit)'),
    (sequence, 'trajectory.motions.type', set_to(Motion.LINEAR_JOINT), read('kind', 0)),
    (sequence, 'trajectory.motions.type', set_to(7), 'motions[0]: type = 7: must be one of'),
    (sequence, 'trajectory.motions.blend_radius', set_to(0.05), read('blend_radius', 0.05)),
    (sequence, 'trajectory.motions.blend_radius', set_to(-0.1), 'blend_radius = -0.1: must be 0'),
    (
        sequence,
        'trajectory.motions.additional_arguments.argument_name',
        argument('velocity', 0.5),
        read('velocity', 0.5),
    ),
    (
        sequence,
        'trajectory.motions.additional_arguments.argument_name',
        argument('force', 0.5),
        "unknown name 'force', must be one of velocity, acceleration, move_time",
    ),
    (
        sequence,
        'trajectory.motions.additional_arguments.argument_value',
        argument('velocity', NAN),
        'motions[0]: velocity = nan',
    ),
    (line, 'trajectory.motions.poses.header.stamp', set_to(Time(sec=1)), read('kind', 50)),
    (line, 'trajectory.motions.poses.header.frame_id', set_to('base_link'), read('kind', 50)),
    (line, 'trajectory.motions.poses.header.frame_id', set_to('world'), 'must be in base_link'),
    (line, 'trajectory.motions.poses.pose', set_to(PoseStamped().pose), read('target', np.eye(4))),
    (sequence, 'trajectory.motions.poses', set_to([PoseStamped()]), 'has 1 poses: must have 0'),
    (sequence, 'trajectory.motions.joint_positions', set_to([0.2] * 6), read('target', [0.2] * 6)),
    (sequence, 'trajectory.motions.joint_positions', set_to([0.2]), 'has 1 values: must have 6'),
    (line, 'trajectory.motions.joint_positions', set_to([0.2] * 6), 'must be empty'),
]


@pytest.mark.invariant(5)
@pytest.mark.parametrize(
    ('goal', 'row', 'change', 'expected'),
    CASES,
    ids=[f'{row}-{index}' for index, (_, row, *_) in enumerate(CASES)],
)
def test_each_field_of_a_goal_has_an_effect_or_is_rejected(goal, row, change, expected):
    request = goal()
    change(request, row)
    check = GOALS[type(request)]
    if not isinstance(expected, str):
        assert expected(check(request))
        return
    try:
        refusal_text = check(request)
    except GoalRejectedError as rejection:
        refusal_text = str(rejection)
    assert expected in refusal_text


def fields(kind, rows, path=''):
    """Yield the fields of a message down to rows of the table."""
    for name, field_type in kind.get_fields_and_field_types().items():
        here = f'{path}{name}'
        package, _, inner = field_type.removeprefix('sequence<').removesuffix('>').partition('/')
        if here in rows or not inner:
            yield here
        else:
            below = getattr(importlib.import_module(f'{package}.msg'), inner)
            yield from fields(below, rows, f'{here}.')


def test_docs_table_has_every_field_and_each_row_has_cases():
    table = PAGE.read_text(encoding='utf-8').partition('### Every field of a goal')[2]
    table = table.partition('\n## ')[0]
    cells = re.findall(r'(?m)^\| (`[\w.`, ]+`) \|', table)
    rows = re.findall(r'`([\w.]+)`', ' '.join(cells))
    assert len({*rows}) == len(rows)
    assert {*rows} == {field for goal in GOALS for field in fields(goal, rows)}
    assert {*rows} == {row for _, row, *_ in CASES if row != 'trajectory.motions.poses'}


@pytest.mark.invariant(10)
@pytest.mark.parametrize(
    ('settings', 'bounded'),
    [
        ({}, False),
        ({'timing': 'time_optimal'}, True),
        ({'timing': 'time_optimal', 'plan_scaling': False}, False),
    ],
)
def test_inv10_time_optimal_goal_keeps_the_plan_that_bounds_it(settings, bounded):
    requests = GoalRequests(make_setup(settings), None, lambda: LOOP_NOW)
    planned = requests.checked_goal(motion_to(0.0, 0.3)).planned
    assert (planned is not None) == bounded
    if planned is not None:
        assert planned.times.tolist() == [0.0, 1.0]
