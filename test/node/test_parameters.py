# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters: descriptions, types, ranges, and read-only ones."""

import contextlib
import re

import numpy as np
import pytest
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from epson_driver.inputs import InputError
from epson_driver.node.parameters import declare, undeclared
from epson_driver.processes.processes import free_ros_domain
from epson_driver.setup.table import JOINTS, TABLE, joint_rows

ROWS = {row.name: row for row in (*TABLE, *joint_rows('joint_1'))}
WITH_RANGE = [row for row in ROWS.values() if row.low is not None]
READ_ONLY = [row for row in ROWS.values() if not row.now]
CHANGEABLE = [row for row in ROWS.values() if row.now]
WITH_CHOICES = [row for row in ROWS.values() if row.choices]


@pytest.fixture(scope='module')
def context():
    context = rclpy.Context()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        rclpy.init(args=[], context=context, domain_id=free_ros_domain())
    yield context
    context.try_shutdown()


@pytest.fixture
def node(context):
    """Yield a function that makes a node with parameter overrides."""
    with contextlib.ExitStack() as stack:

        def make(**overrides):
            arguments = ['--ros-args']
            for name, value in overrides.items():
                arguments += ['-p', f'{name.replace("__", ".")}:={value}']
            made = Node(
                'epson_driver',
                context=context,
                cli_args=arguments,
                start_parameter_services=False,
            )
            stack.callback(made.destroy_node)
            return made

        yield make


def dotted(name):
    return name.replace('.', '__')


def test_parameters_have_their_defaults(node):
    values = declare(node())
    assert values['robot_ip'] == '127.0.0.1'
    assert values['motion_port'] == 11000
    assert values['state_port'] == 11002
    assert values['io_port'] == 11003
    assert values['remote_port'] == 0
    assert values['joint_names'] == JOINTS == [f'joint_{number}' for number in range(1, 7)]
    assert values['robot_model'] == 'c3_a601s'
    assert values['interface'] == 'streaming'
    assert values['point_message'] == 'joint_traj_pt'
    assert values['byte_order'] == 'auto'
    assert values['state_timeout'] == 1.0
    assert values['constraints.stopped_velocity_tolerance'] == 0.01
    assert values['constraints.goal_time'] == 0.0
    for joint in JOINTS:
        assert values[f'constraints.{joint}.goal'] == 0.01
        assert values[f'constraints.{joint}.trajectory'] == 0.0


def test_scara_has_four_joints_and_the_third_is_in_metres(node):
    made = node(robot_model='gx4_c251s')
    values = declare(made)
    assert values['joint_names'] == JOINTS[:4]
    assert 'constraints.joint_5.goal' not in values
    assert [values[f'constraints.{joint}.goal'] for joint in JOINTS[:4]] == [
        0.01,
        0.01,
        0.001,
        0.01,
    ]
    for joint, unit in zip(JOINTS[:4], ('[rad]', '[rad]', '[m]', '[rad]'), strict=True):
        for name in (f'constraints.{joint}.goal', f'constraints.{joint}.trajectory'):
            assert made.describe_parameter(name).description.endswith(f'{unit}.')


def test_custom_joint_names_have_the_units_of_the_model(node):
    values = declare(node(robot_model='gx4_c251s', joint_names='[a, b, lift, spin]'))
    assert values['joint_names'] == ['a', 'b', 'lift', 'spin']
    assert values['constraints.lift.goal'] == 0.001
    assert values['constraints.spin.goal'] == 0.01


def test_every_parameter_has_description_type_and_bounds(node):
    made = node()
    for name, value in declare(made).items():
        descriptor = made.describe_parameter(name)
        assert len(descriptor.description) > 10, name
        assert descriptor.read_only == descriptor.description.endswith('Read at the start.')
        assert descriptor.type == made.get_parameter(name).type_.value
        if isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool)):
            assert descriptor.floating_point_range or descriptor.integer_range, name
        if isinstance(value, float):
            assert re.search(r'\[(rad|m|s|Hz|MB|1)\b', descriptor.description), name


@pytest.mark.parametrize('row', WITH_RANGE, ids=lambda row: row.name)
def test_values_outside_the_range_are_rejected_and_its_ends_accepted(node, row):
    for outside in (row.low - 1, row.high + 1):
        with pytest.raises(ParameterException, match=row.name) as caught:
            declare(node(**{dotted(row.name): type(row.default)(outside)}))
        assert 'range' in str(caught.value)
    for end in (row.low, row.high):
        end = int(end) if isinstance(row.default, int) else float(end)
        assert declare(node(**{dotted(row.name): end}))[row.name] == end


@pytest.mark.parametrize('row', WITH_CHOICES, ids=lambda row: row.name)
def test_unknown_choice_is_rejected_with_the_allowed_ones(node, row):
    with pytest.raises(ValueError, match=rf"parameter {row.name} = 'nonsense'") as caught:
        declare(node(**{row.name: 'nonsense'}))
    assert str(caught.value).endswith(', '.join(row.choices))
    for choice in row.choices:
        assert declare(node(**{row.name: choice}))[row.name] == choice
    made = node()
    declare(made)
    assert ', '.join(row.choices) in made.describe_parameter(row.name).additional_constraints


@pytest.mark.parametrize('row', READ_ONLY, ids=lambda row: row.name)
def test_read_only_parameter_rejects_a_change(node, row):
    made = node()
    before = declare(made)[row.name]
    result = made.set_parameters([Parameter(row.name, value=row.default)])[0]
    assert not result.successful
    assert result.reason
    kept = made.get_parameter(row.name).value
    assert (list(kept) if isinstance(before, list) else kept) == before


@pytest.mark.parametrize('row', CHANGEABLE, ids=lambda row: row.name)
def test_other_parameters_can_be_changed_within_their_range(node, row):
    made = node()
    declare(made)
    good = row.high if row.high is not None else not row.default
    if isinstance(row.default, str):
        good = f'{row.default}x'
    assert made.set_parameters([Parameter(row.name, value=good)])[0].successful
    assert made.get_parameter(row.name).value == good
    if row.high is not None:
        result = made.set_parameters([Parameter(row.name, value=row.high + 1.0)])[0]
        assert not result.successful
        assert row.name in result.reason
        kind = type(row.default)
        assert f'Min: {kind(row.low)}, Max: {kind(row.high)}' in result.reason
        assert made.get_parameter(row.name).value == good


@pytest.mark.parametrize(
    ('name', 'given', 'value'),
    [
        ('state_timeout', 2, 2.0),
        ('joint_offsets', '[0, 1, 0, 0, 0, 0]', [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_whole_number_is_accepted_for_a_double(node, name, given, value):
    made = node(**{name: given})
    values = declare(made)
    assert values[name] == value
    assert {type(item) for item in np.ravel(values[name]).tolist()} == {float}
    assert made.describe_parameter(name).type == Parameter.Type.from_parameter_value(value).value


@pytest.mark.parametrize('given', ['true', 'two', '[1, 2]'])
def test_other_types_are_refused_for_a_double(node, given):
    with pytest.raises(ParameterException, match='state_timeout'):
        declare(node(state_timeout=given))


@pytest.mark.parametrize('names', ['[a, a]', "[a, '']"])
def test_joint_names_must_be_nonempty_and_differ(node, names):
    with pytest.raises(ValueError, match='joint_names'):
        declare(node(joint_names=names))


def test_controller_profile_sets_defaults_that_parameters_override(node):
    values = declare(node(controller='motoman', state_port=5))
    assert values['controller'] == 'motoman'
    assert (values['motion_port'], values['io_port']) == (50240, 50242)
    assert values['state_port'] == 5
    assert values['point_message'] == 'joint_traj_pt_full'
    assert values['byte_order'] == 'auto'
    values = declare(node(controller='abb'))
    assert values['interface'] == 'download'
    assert declare(node(controller='abb', interface='streaming'))['interface'] == 'streaming'


def test_custom_controller_profile_is_used(node, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('{like: simulated, name: mine, description: x, ports: {motion: 7000}}')
    assert declare(node(controller=str(path)))['motion_port'] == 7000


def test_unknown_controller_lists_the_known_ones(node):
    with pytest.raises(
        InputError, match=r'^parameter controller = .rc1.: no controller profile rc1: .*simulated'
    ):
        declare(node(controller='rc1'))


def test_undeclared_parameter_is_named_with_the_nearest_match(node):
    made = node(
        robot_adress='192.168.0.1',
        robotIP='192.168.0.1',
        constraints__joint_1__gaol=0.1,
        robot_ip='127.0.0.1',
        use_sim_time='true',
        qqq=1,
    )
    declare(made)
    sentences = dict(
        re.findall(
            r'^parameter (\S+) is ignored: (.*)$', '\n'.join(undeclared(made)), re.MULTILINE
        )
    )
    none = 'it is unknown'
    assert sentences == {
        'robot_adress': f'{none}; did you mean robot_ip?',
        'robotIP': f'{none}; did you mean robot_ip?',
        'constraints.joint_1.gaol': f'{none}; did you mean constraints.joint_1.goal?',
        'qqq': none,
    }


def test_robot_file_as_a_parameter_is_refused(node):
    with pytest.raises(InputError, match=r'^parameter robot: .* client robot\.yaml$'):
        declare(node(robot='robot.yaml'))


def test_rclpy_has_the_private_list_of_parameter_overrides(node):
    """If this fails, `undeclared` needs another source of the overrides."""
    assert set(node(qqq=1)._parameter_overrides) == {'qqq'}


def test_missing_list_of_overrides_is_reported(node):
    made = node(qqq=1)
    declare(made)
    del made._parameter_overrides
    (sentence,) = undeclared(made)
    assert 'misspelled ones are ignored' in sentence
