# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/ros_interface.md lists exactly the interface of a running node."""

import asyncio
import contextlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import rclpy
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.node import Node
from rclpy.parameter import Parameter
from support.driver_harness import Harness, pose, simulated
from support.event_loop import now, until
from support.event_loop import run as run_scenario
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.goal.reference import Timing
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.node.node import ClientNode
from epson_driver.node.parameters import rejection
from epson_driver.processes.processes import free_ros_domain
from epson_driver.setup.table import TABLE, joint_rows
from epson_driver.share import share_path
from epson_driver.simple_message import Status
from epson_driver.trace.trace import MEGABYTE

DOCS = Path(__file__).parents[2] / 'docs'
PAGE = (DOCS / 'ros_interface.md').read_text(encoding='utf-8')
NODE = '/epson_driver'
NODE_DEFAULTS = ('/rosout', '/parameter_events', '/get_type_description')
CHANGEABLE = [row.name for row in (*TABLE, *joint_rows('joint_1')) if row.now]


def section(title):
    """Return the text of one section of the page."""
    return PAGE.split(f'\n## {title}\n')[1].split('\n## ')[0]


def written(title):
    """Return the name and the type of each item of a section."""
    rows = re.findall(r'^\* `([\w/~]+)` \((\w+/\w+/\w+)[;)]', section(title), re.MULTILINE)
    return {resolved(name): kind for name, kind in rows}


def resolved(name):
    return name.replace('~', NODE) if name.startswith('~') else f'/{name.lstrip("/")}'


@dataclass
class Made:
    node: Any
    client: ClientNode
    settle: Callable[[], None]

    def __post_init__(self):
        self.defaults = {row.name: row.default for row in (*TABLE, *joint_rows('joint_1'))}

    @property
    def driver(self):
        return self.client.driver


@pytest.fixture(scope='module')
def made():
    """Return the ROS side of a driver that does not run. `settle` runs its loop once."""
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=free_ros_domain())
        stack.callback(context.try_shutdown)
        node = Node('epson_driver', context=context)
        stack.callback(node.destroy_node)

        async def make():
            return ClientNode(node)

        runner = stack.enter_context(asyncio.Runner())
        yield Made(node, runner.run(make()), lambda: runner.run(asyncio.sleep(0)))


def offered(pairs):
    """Return a node's names and types, except standard ones."""
    types_by_name = {}
    for name, types in pairs:
        if '/_action/' in name or '_parameter' in name or name.endswith(NODE_DEFAULTS):
            continue
        types_by_name[name] = types[0]
    return types_by_name


@pytest.mark.parametrize(
    ('title', 'method'),
    [
        ('Published topics', Node.get_publisher_names_and_types_by_node),
        ('Subscribed topics', Node.get_subscriber_names_and_types_by_node),
        ('Services', Node.get_service_names_and_types_by_node),
        ('Actions', get_action_server_names_and_types_by_node),
    ],
)
def test_documented_names_and_types_equal_the_node_s(made, title, method):
    assert offered(method(made.node, 'epson_driver', '/')) == written(title)


def allowed(enclave, kind, right):
    """Return the names that the SROS 2 policy allows an enclave to use."""
    policy = ElementTree.parse(share_path('config', 'sros2', 'epson_driver.policy.xml'))
    (profile,) = policy.findall(f'enclaves/enclave[@path="{enclave}"]/profiles/profile')
    return {resolved(name.text) for name in profile.findall(f'{kind}[@{right}="ALLOW"]/*')}


@pytest.mark.parametrize(
    ('kind', 'right', 'method'),
    [
        ('topics', 'publish', Node.get_publisher_names_and_types_by_node),
        ('topics', 'subscribe', Node.get_subscriber_names_and_types_by_node),
        ('services', 'reply', Node.get_service_names_and_types_by_node),
        ('actions', 'execute', get_action_server_names_and_types_by_node),
    ],
)
def test_sros2_policy_allows_exactly_the_driver_s_interface(made, kind, right, method):
    used = {name for name, _ in method(made.node, 'epson_driver', '/') if '/_action/' not in name}
    of_a_gripper = {f'{NODE}/gripper_cmd'} if kind == 'actions' else set()
    assert allowed(NODE, kind, right) == used | of_a_gripper


def test_sros2_policy_lets_an_observer_stop_but_not_move_the_arm():
    of_every_node = {'/rosout', '/parameter_events'}
    published = allowed(NODE, 'topics', 'publish') - of_every_node
    for enclave in ('/epson_operator', '/epson_observer'):
        assert allowed(enclave, 'topics', 'subscribe') == published
    mover = allowed('/epson_operator', 'topics', 'publish') - of_every_node
    assert mover == allowed(NODE, 'topics', 'subscribe')
    assert allowed('/epson_operator', 'actions', 'call') == allowed(NODE, 'actions', 'execute')
    assert set(written('Services')) < allowed('/epson_operator', 'services', 'request')
    assert allowed('/epson_observer', 'topics', 'publish') == of_every_node
    requests = {f'{NODE}/{name}' for name in ('stop', 'disable', 'read_io')}
    assert allowed('/epson_observer', 'services', 'request') == requests
    assert not allowed('/epson_observer', 'actions', 'call')


def test_every_declared_parameter_is_described(made):
    described = {row.name for row in (*TABLE, *joint_rows('<joint>'))}
    joints = made.driver.configuration.limits.names
    declared = set()
    for name in made.node.get_parameters_by_prefix(''):
        for joint in joints:
            name = name.replace(f'.{joint}.', '.<joint>.')
        declared.add(name)
    of_every_node = {'use_sim_time', 'start_type_description_service'}
    assert declared - of_every_node == described


ONLY_AFTER_A_STOP = {'STOP did not work', 'stream to release: <topic>'}


def test_every_diagnostics_key_is_described():
    described = set()
    for cell in re.findall(r'^\* (`.*?`): ', section('Diagnostics'), re.MULTILINE):
        described |= set(re.findall(r'`([^`]+)`', cell))

    async def scenario():
        async with simulated() as (_, ports), Harness(ports, client_timeout=0.5) as harness:
            await harness.ready()
            await harness.commands.stop()  # a reply, for the latency
            harness.driver.goal_queue.last_timing = Timing(1.0, 1.0)
            diagnostics = Diagnostics(harness.driver, 'x', lambda _: 1)
            harness.driver.state_link.statistics.bad_frames['body'] += 1
            diagnostics.build(Time(), now())
            seen = len(harness.events.samples)
            await until(lambda: len(harness.events.samples) >= seen + 5)
            harness.driver.robot.on_status(Status(1, 0, 4031, 1, 0, 2, 0), now())
            message = diagnostics.build(Time(), now())
            keys = {value.key for status in message.status for value in status.values}
            keys = {re.sub(r'^bad frames: .*', 'bad frames: <cause>', key) for key in keys}
            assert keys == described - ONLY_AFTER_A_STOP

    run_scenario(scenario())


def goal_of(made, last_velocity=0.0):
    """Return the checked form of a goal that arrives now."""
    message = JointTrajectory(joint_names=list(made.driver.configuration.limits.names))
    message.points = [
        JointTrajectoryPoint(
            positions=[0.0] * 6, velocities=[last_velocity] * 6, time_from_start=Duration(sec=1)
        )
    ]
    return made.client.goal_server.requests.checked_goal(
        FollowJointTrajectory.Goal(trajectory=message)
    )


def path_tolerance(made):
    tolerance = goal_of(made).path_tolerance
    return None if tolerance is None else tolerance.position[0]


def may_end_moving(made):
    return goal_of(made, last_velocity=0.1).may_end_moving


EFFECTS = {
    'reply_timeout': (7.5, lambda made: made.driver.goal_queue.settings.reply_timeout),
    'start_tolerance': (0.4, lambda made: made.driver.goal_queue.start_tolerance),
    'servo.scale': (0.5, lambda made: made.driver.servo.settings.scale),
    'servo.timeout': (0.3, lambda made: made.driver.servo.settings.timeout),
    'servo.catch_up': (2.0, lambda made: made.driver.servo.settings.catch_up),
    'servo.period': (0.1, lambda made: made.driver.servo.settings.period),
    'servo.start_tolerance': (0.2, lambda made: made.driver.servo.settings.start_tolerance),
    'constraints.stopped_velocity_tolerance': (
        0.5,
        lambda made: made.driver.goal_queue.settings.stopped_velocity,
    ),
    'constraints.joint_1.trajectory': (0.2, path_tolerance),
    'require_planned_speed': (
        False,
        lambda made: made.driver.goal_queue.settings.require_planned_speed,
    ),
    'trace_size': (7.0, lambda made: made.driver.trace.largest / MEGABYTE),
    'io_timeout': (9.0, lambda made: made.driver.io.timeout),
    'allow_nonzero_velocity_at_trajectory_end': (True, may_end_moving),
    'constraints.goal_time': (12.0, lambda made: goal_of(made).goal_time),
    'constraints.joint_1.goal': (0.3, lambda made: goal_of(made).goal_tolerance[0]),
}
"""A new value of each parameter, and a function that reads the effect."""


@pytest.mark.parametrize('name', EFFECTS)
def test_parameter_change_takes_effect_immediately(made, name):
    value, read = EFFECTS[name]
    before = read(made)
    assert before != value
    assert made.node.set_parameters([Parameter(name, value=value)])[0].successful
    made.settle()
    assert read(made) == value
    first = made.defaults[name]
    assert made.node.set_parameters([Parameter(name, value=first)])[0].successful
    made.settle()
    assert read(made) == before


def test_changed_settings_apply_to_the_running_goal():
    async def scenario():
        async with simulated() as (_, ports), Harness(ports) as harness:
            await harness.ready()
            await harness.commands.enable()
            goal = harness.submit(pose(0.3))
            changed = harness.driver.goal_queue.settings = GoalSettings(reply_timeout=123.0)
            assert goal.handle.execution.settings is changed
            harness.driver.goal_queue.cancel(goal.handle)
            await goal.end()

    run_scenario(scenario())


def test_changes_are_rejected_together_if_one_choice_is_unknown():
    assert rejection([Parameter('timing', value='as_planned')]) == ''
    assert rejection([Parameter('start_tolerance', value=0.1)]) == ''
    why = rejection([Parameter('start_tolerance', value=0.1), Parameter('timing', value='soon')])
    assert why == "parameter timing = 'soon': must be one of as_planned, time_optimal"


def test_every_changeable_parameter_has_an_effect_test():
    tested_elsewhere = {'trace_file', 'action_monitor_rate'}
    assert set(CHANGEABLE) == set(EFFECTS) | tested_elsewhere
