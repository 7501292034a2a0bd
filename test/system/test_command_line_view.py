# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver as seen by other processes: quality of service, parameters, types."""

import os
import sys
from pathlib import Path

import pytest
from ament_index_python import get_package_share_directory, get_resource
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_profile_sensor_data,
)
from support.cell import Cell
from support.ros_peer import JOINTS, PATIENCE

from epson_driver.setup.table import TABLE, joint_rows

NODE = 'epson_driver'
LATCHED = {
    *(f'/{NODE}/{name}' for name in ('link_state', 'speed_scaling', 'io_states')),
    '/tf_static',
}
ROWS = {row.name: row for row in (*TABLE, *(row for name in JOINTS for row in joint_rows(name)))}
NODE_DEFAULTS = {'use_sim_time', 'start_type_description_service'}


def test_every_topic_is_compatible_with_default_and_sensor_subscribers(
    shared_cell: Cell,
) -> None:
    node = shared_cell.peer.node
    topics = node.get_publisher_names_and_types_by_node(NODE, '/')
    assert {'/joint_states', '/robot_status', '/diagnostics', *LATCHED} <= {*dict(topics)}
    for topic, _ in topics:
        if topic.endswith(('rosout', 'parameter_events')) or '/_action/' in topic:
            continue
        all_infos = node.get_publishers_info_by_topic(topic)
        (info,) = [info for info in all_infos if info.node_name == NODE]
        assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        latched = info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert latched == (topic in LATCHED), topic
        for subscriber in (QoSProfile(depth=10), qos_profile_sensor_data):
            compatible, why = qos_check_compatible(info.qos_profile, subscriber)
            assert compatible != QoSCompatibility.ERROR, f'{topic}: {why}'


def test_parameters_are_listed_described_and_set_by_services(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    client = AsyncParameterClient(peer.node, NODE)
    assert client.wait_for_services(PATIENCE)
    names = set(peer.complete(client.list_parameters()).result.names)
    assert names == set(ROWS) | NODE_DEFAULTS
    for descriptor in peer.complete(client.describe_parameters([*ROWS])).descriptors:
        row = ROWS[descriptor.name]
        assert descriptor.description.startswith(row.description)
        assert descriptor.read_only == (not row.now)
        assert all(choice in descriptor.additional_constraints for choice in row.choices)
    for name, value, words in (
        ('reply_timeout', 6.0, ()),
        ('reply_timeout', 5.0, ()),
        ('reply_timeout', 1e6, ('reply_timeout', '600')),
        ('state_timeout', 2.0, ('state_timeout', 'read-only')),
        ('reply_timeout', True, ('type',)),
    ):
        message = Parameter(name, value=value).to_parameter_msg()
        (result,) = peer.complete(client.set_parameters([message])).results
        assert result.successful == (not words), result.reason
        assert all(word in result.reason for word in words)


def test_definition_of_every_interface_type_is_installed(
    shared_cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not os.environ.get('AMENT_PREFIX_PATH'):  # in a pip environment
        monkeypatch.setenv('AMENT_PREFIX_PATH', sys.prefix)
    node = shared_cell.peer.node
    types = {'control_msgs/action/FollowJointTrajectory'}
    for pairs in (
        node.get_publisher_names_and_types_by_node(NODE, '/'),
        node.get_subscriber_names_and_types_by_node(NODE, '/'),
        node.get_service_names_and_types_by_node(NODE, '/'),
    ):
        types |= {kinds[0] for name, kinds in pairs if '/_action/' not in name}
    for kind in types:
        package, place, name = kind.split('/')
        file = f'{place}/{name}.{place}'
        assert file in get_resource('rosidl_interfaces', package)[0].split(), kind
        assert (Path(get_package_share_directory(package)) / file).is_file(), kind
