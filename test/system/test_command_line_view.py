# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What ROS's command line tools see of the running driver.

`ros2 topic`, `action`, `service`, `param`, `node` and `interface` ask the graph, the driver's
parameter services and the ament index; the same questions are asked here from another process.
"""

import importlib
import math
import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ament_index_python import get_package_share_directory, get_resource
from control_msgs.action import FollowJointTrajectory
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
)
from rclpy.action import (
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_profile_sensor_data,
    qos_profile_system_default,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from support.cell import START, Cell
from support.ros_peer import JOINTS, PATIENCE, trajectory

from epson_driver.node.parameters import TABLE, joint_rows

NODE = 'epson_driver'
ACTION = '/epson_driver/follow_joint_trajectory'
PRIMITIVES = '/epson_driver/execute_motion_primitive_sequence'
LATCHED = {
    *('/epson_driver/link_state', '/epson_driver/speed_scaling', '/epson_driver/io_states'),
    '/tf_static',
}
SERVICES = (
    *('stop', 'enable', 'disable', 'reset_error', 'set_speed_scaling', 'set_tool', 'read_io'),
    'write_io',
)
STREAMS = ('servo', 'joint_commands', 'position_commands', 'velocity_commands', 'joint_jog')
WANTED = {
    *('/joint_states', '/robot_status', '/diagnostics', *LATCHED),
    *(f'/{NODE}/controller_state', f'/{NODE}/joint_trajectory', '/joint_path_command'),
    *(f'/{NODE}/{name}' for name in STREAMS),
    *('/rosout', '/parameter_events'),
    *(f'{ACTION}/_action/{name}' for name in ('feedback', 'status', 'send_goal', 'get_result')),
    f'{ACTION}/_action/cancel_goal',
    *(f'/{NODE}/{name}' for name in SERVICES),
    *(f'/{NODE}/{name}_parameters' for name in ('list', 'describe', 'get', 'set')),
    *(f'/{NODE}/get_parameter_types', f'/{NODE}/set_parameters_atomically'),
}
SUBSCRIBERS = {
    'default': QoSProfile(depth=10),
    'sensor data': qos_profile_sensor_data,
    'system default': qos_profile_system_default,
    'latched': QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}
ROWS = {row.name: row for row in (*TABLE, *(row for name in JOINTS for row in joint_rows(name)))}
OF_EVERY_NODE = {'use_sim_time', 'start_type_description_service'}
TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
}
ARRAYS = {
    int: ParameterType.PARAMETER_INTEGER_ARRAY,
    float: ParameterType.PARAMETER_DOUBLE_ARRAY,
    str: ParameterType.PARAMETER_STRING_ARRAY,
}


class Tool:
    """A node as a command line tool makes it, in a context of its own."""

    def __init__(self, domain: int) -> None:
        context = self._context = Context()
        context.init(domain_id=domain)
        self.node = Node('_ros2cli', context=context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def discover(self) -> 'Tool':
        """Wait until all of the driver is there."""
        end = time.monotonic() + PATIENCE
        while missing := self._missing():
            assert time.monotonic() < end, f'the driver is not discovered: {missing}'
            time.sleep(0.05)
        return self

    def _missing(self) -> set[str]:
        if (NODE, '/') not in self.node.get_node_names_and_namespaces():
            return {NODE}
        ask = self.node
        found = (
            *ask.get_publisher_names_and_types_by_node(NODE, '/'),
            *ask.get_subscriber_names_and_types_by_node(NODE, '/'),
            *ask.get_service_names_and_types_by_node(NODE, '/'),
        )
        return WANTED - {name for name, _ in found}

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join(PATIENCE)
        self.node.destroy_node()
        self._context.shutdown()

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Do what `ros2 service call` does."""
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(PATIENCE), name
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _future: done.set())
        assert done.wait(PATIENCE), name
        self.node.destroy_client(client)
        return future.result()

    def echo(self, kind: Any, topic: str, qos: QoSProfile, count: int = 1) -> list[Any]:
        """Do what `ros2 topic echo` does, until `count` messages came."""
        came: list[Any] = []
        enough = threading.Event()

        def take(message: Any) -> None:
            came.append(message)
            if len(came) >= count:
                enough.set()

        subscription = self.node.create_subscription(kind, topic, take, qos)
        assert enough.wait(PATIENCE), f'{topic}: {len(came)} messages'
        self.node.destroy_subscription(subscription)
        return came

    def names(self) -> list[str]:
        return sorted(
            self.call(ListParameters, f'{NODE}/list_parameters', all_names()).result.names
        )


def all_names() -> Any:
    return ListParameters.Request(depth=ListParameters.Request.DEPTH_RECURSIVE)


@pytest.fixture(scope='module')
def tool(shared_cell: Cell) -> Iterator[Tool]:
    made = Tool(shared_cell.domain)
    yield made.discover()
    made.close()


# --- ros2 topic -------------------------------------------------------------------------------


def published(tool: Tool) -> dict[str, str]:
    pairs = tool.node.get_publisher_names_and_types_by_node(NODE, '/')
    return {name: types[0] for name, types in pairs}


def test_topic_info_shows_one_publisher_and_a_qos_that_default_and_sensor_subscribers_take(
    tool: Tool,
) -> None:
    topics = published(tool)
    assert {'/joint_states', '/robot_status', '/diagnostics', *LATCHED} <= set(topics)
    for topic, kind in topics.items():
        if '/_action/' in topic:
            continue
        ours = [
            info
            for info in tool.node.get_publishers_info_by_topic(topic)
            if info.node_name == NODE
        ]
        assert len(ours) == 1, topic
        (info,) = ours
        assert (info.node_namespace, info.topic_type) == ('/', kind)
        assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        if not topic.endswith(('rosout', 'parameter_events')):
            latched = info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert latched == (topic in LATCHED), topic
        for name, subscriber in SUBSCRIBERS.items():
            if name == 'latched' and topic not in LATCHED:
                continue
            compatible, why = qos_check_compatible(info.qos_profile, subscriber)
            assert compatible != QoSCompatibility.ERROR, f'{topic}, {name}: {why}'


@pytest.mark.parametrize('name', ['default', 'sensor data', 'system default'])
def test_topic_echo_gets_joint_states_with_the_qos_of_every_usual_subscriber(
    tool: Tool, name: str
) -> None:
    for message in tool.echo(JointState, '/joint_states', SUBSCRIBERS[name], count=5):
        assert list(message.name) == JOINTS
        assert len(message.position) == len(message.velocity) == len(JOINTS)
        assert all(map(math.isfinite, (*message.position, *message.velocity)))


def test_topic_hz_of_joint_states_is_above_one(tool: Tool) -> None:
    """`ros2 topic hz` counts what comes; here by the stamps, which are the times of arrival."""
    came = tool.echo(JointState, '/joint_states', qos_profile_sensor_data, count=50)
    stamps = [message.header.stamp.sec + message.header.stamp.nanosec * 1e-9 for message in came]
    assert (len(stamps) - 1) / (stamps[-1] - stamps[0]) > 1.0


def test_a_late_echo_of_a_latched_topic_gets_its_value_at_once(tool: Tool) -> None:
    (message,) = tool.echo(String, f'{NODE}/link_state', SUBSCRIBERS['latched'])
    assert message.data == 'connected'


# --- ros2 action ------------------------------------------------------------------------------


def test_action_list_and_info_show_the_server_that_moveit_calls_and_that_of_primitives(
    tool: Tool,
) -> None:
    there = dict(get_action_names_and_types(tool.node))
    assert there == {
        ACTION: ['control_msgs/action/FollowJointTrajectory'],
        PRIMITIVES: ['control_msgs/action/ExecuteMotionPrimitiveSequence'],
    }
    assert dict(get_action_server_names_and_types_by_node(tool.node, NODE, '/')) == there


def test_the_hidden_names_of_the_action_are_those_of_every_ros_2_action(tool: Tool) -> None:
    kind = 'control_msgs/action/FollowJointTrajectory'
    services = dict(tool.node.get_service_names_and_types_by_node(NODE, '/'))
    hidden = {name: types for name, types in services.items() if f'{ACTION}/_action/' in name}
    assert hidden == {
        f'{ACTION}/_action/send_goal': [f'{kind}_SendGoal'],
        f'{ACTION}/_action/get_result': [f'{kind}_GetResult'],
        f'{ACTION}/_action/cancel_goal': ['action_msgs/srv/CancelGoal'],
    }
    there = published(tool).items()
    topics = {name: kind for name, kind in there if f'{ACTION}/_action/' in name}
    assert topics == {
        f'{ACTION}/_action/feedback': f'{kind}_FeedbackMessage',
        f'{ACTION}/_action/status': 'action_msgs/msg/GoalStatusArray',
    }


def test_action_send_goal_finds_the_type_by_its_name_and_gets_feedback_and_a_result(
    shared_cell: Cell, tool: Tool
) -> None:
    package, place, name = dict(get_action_names_and_types(tool.node))[ACTION][0].split('/')
    found = getattr(importlib.import_module(f'{package}.{place}'), name)
    assert found is FollowJointTrajectory
    there = [START[0] + 0.2, *START[1:]]
    for target in (there, START):
        here = shared_cell.peer.position().tolist()
        goal = shared_cell.peer.goal(trajectory((0.0, here), (1.0, target)))
        assert goal.result()[:2] == ('succeeded', 0)
        assert goal.feedback
        assert list(goal.feedback[-1].joint_names) == JOINTS


# --- ros2 service, ros2 node ------------------------------------------------------------------


def test_service_list_has_the_types_that_are_promised_and_a_call_is_answered(tool: Tool) -> None:
    services = dict(tool.node.get_service_names_and_types())
    for name in ('stop', 'enable', 'disable', 'reset_error'):
        assert services[f'/{NODE}/{name}'] == ['std_srvs/srv/Trigger']
    assert services[f'/{NODE}/set_speed_scaling'] == ['epson_msgs/srv/SetSpeedScaling']
    answer = tool.call(Trigger, f'/{NODE}/stop', Trigger.Request())
    assert answer.success
    assert answer.message == 'no motion was running; the controller acknowledged STOP'


def test_node_list_and_info_show_one_node_and_what_it_listens_to(tool: Tool) -> None:
    assert tool.node.get_node_names_and_namespaces().count((NODE, '/')) == 1
    listens = {
        name: types
        for name, types in tool.node.get_subscriber_names_and_types_by_node(NODE, '/')
        if '/_action/' not in name
    }
    kind = ['trajectory_msgs/msg/JointTrajectory']
    array = ['std_msgs/msg/Float64MultiArray']
    assert listens == {
        f'/{NODE}/joint_trajectory': kind,
        '/joint_path_command': kind,
        f'/{NODE}/servo': kind,
        f'/{NODE}/joint_commands': ['sensor_msgs/msg/JointState'],
        f'/{NODE}/position_commands': array,
        f'/{NODE}/velocity_commands': array,
        f'/{NODE}/joint_jog': ['control_msgs/msg/JointJog'],
    }
    assert tool.node.get_client_names_and_types_by_node(NODE, '/') == []


# --- ros2 param -------------------------------------------------------------------------------


def test_param_list_has_every_parameter(tool: Tool) -> None:
    assert set(tool.names()) == set(ROWS) | OF_EVERY_NODE


def test_param_describe_tells_type_meaning_range_and_what_cannot_change(tool: Tool) -> None:
    names = sorted(ROWS)
    answer = tool.call(
        DescribeParameters, f'{NODE}/describe_parameters', DescribeParameters.Request(names=names)
    )
    assert [descriptor.name for descriptor in answer.descriptors] == names
    for descriptor in answer.descriptors:
        row = ROWS[descriptor.name]
        if isinstance(row.default, list):
            assert descriptor.type == ARRAYS[type(row.default[0])], descriptor.name
        else:
            assert descriptor.type == TYPES[type(row.default)], descriptor.name
        assert descriptor.description == row.description
        assert descriptor.read_only == (not row.now)
        assert not descriptor.dynamic_typing
        ranges = [*descriptor.integer_range, *descriptor.floating_point_range]
        assert [(each.from_value, each.to_value) for each in ranges] == (
            [] if row.low is None else [(row.low, row.high)]
        )
        for choice in row.choices:
            assert choice in descriptor.additional_constraints


def test_param_dump_has_a_value_of_the_declared_type_for_every_parameter(
    shared_cell: Cell, tool: Tool
) -> None:
    names = sorted(ROWS)
    request = GetParameters.Request(names=names)
    values = tool.call(GetParameters, f'{NODE}/get_parameters', request).values
    types = tool.call(
        GetParameterTypes, f'{NODE}/get_parameter_types', GetParameterTypes.Request(names=names)
    ).types
    assert [value.type for value in values] == list(types)
    dumped = {
        name: parameter_value_to_python(value) for name, value in zip(names, values, strict=True)
    }
    assert None not in dumped.values()
    assert dumped['motion_port'] == shared_cell.ports.motion
    assert list(dumped['joint_names']) == JOINTS
    assert dumped['constraints.goal_time'] == 0.0


def double(value: float) -> ParameterValue:
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)


@pytest.mark.parametrize(
    ('name', 'value', 'words'),
    [
        ('reply_timeout', double(6.0), ()),
        ('reply_timeout', double(5.0), ()),
        ('reply_timeout', double(1e6), ('reply_timeout', '600')),
        ('state_timeout', double(2.0), ('state_timeout', 'read-only')),
        ('reply_timeout', ParameterValue(type=ParameterType.PARAMETER_BOOL), ('type',)),
    ],
)
def test_param_set_takes_what_is_in_range_and_says_why_not_otherwise(
    tool: Tool, name: str, value: ParameterValue, words: tuple[str, ...]
) -> None:
    request = SetParameters.Request(parameters=[ParameterMessage(name=name, value=value)])
    (result,) = tool.call(SetParameters, f'{NODE}/set_parameters', request).results
    assert result.successful == (not words), result.reason
    for word in words:
        assert word in result.reason


# --- ros2 interface ---------------------------------------------------------------------------


def test_interface_show_finds_the_definition_of_every_type_of_the_driver(
    tool: Tool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not os.environ.get('AMENT_PREFIX_PATH'):  # an environment made by pip is its own prefix
        monkeypatch.setenv('AMENT_PREFIX_PATH', sys.prefix)
    types = {ACTION: 'control_msgs/action/FollowJointTrajectory'}
    for pairs in (
        tool.node.get_publisher_names_and_types_by_node(NODE, '/'),
        tool.node.get_subscriber_names_and_types_by_node(NODE, '/'),
        tool.node.get_service_names_and_types_by_node(NODE, '/'),
    ):
        types |= {name: kinds[0] for name, kinds in pairs if '/_action/' not in name}
    for kind in set(types.values()):
        package, place, name = kind.split('/')
        file = f'{place}/{name}.{place}'
        listed, _ = get_resource('rosidl_interfaces', package)
        assert file in listed.split(), kind
        assert (Path(get_package_share_directory(package)) / file).is_file(), kind
