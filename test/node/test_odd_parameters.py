# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every parameter with odd values at the start: used, or rejected in one sentence."""

import asyncio
import math

import pytest
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from support.examples import quickly

from epson_driver.inputs import InputError
from epson_driver.node.node import ClientNode
from epson_driver.processes.processes import free_ros_domain
from epson_driver.setup.table import TABLE, joint_rows

TRACE_PARAMETERS = ('trace_file', 'trace_size')  # a file name would create a file
ROWS = {
    row.name: row for row in (*TABLE, *joint_rows('joint_1')) if row.name not in TRACE_PARAMETERS
}

ODD = (
    "''",
    "' '",
    'a..b',
    'x' * 64,
    'x' * 5000,
    '"a\\nb"',
    '"a\\0b"',
    'ä',
    '🤖',
    '999.1.1.1',
    '1.2.3.4.5',
    'fe80::xyz',
    '.nan',
    '.inf',
    '-.inf',
    '1e300',
    '-1e300',
    '1e-300',
    '5e-324',
    '-0.0',
    '9223372036854775807',
    '-9223372036854775808',
    '9' * 400,
    'true',
    '[]',
    '[1, 2]',
    '[1.5]',
    '[.nan]',
    '[1e300]',
    '[9223372036854775807]',
    '[a, a, c, d, e, f]',
    "['', b, c, d, e, f]",
    '["a b", b, c, d, e, f]',
    '["a\\n", b, c, d, e, f]',
    '[true]',
    '/tmp',
    '/tmp/',
    '../robots/c3_a601s',
    '/dev/zero',
    '/dev/zero.yaml',
    '~',
    '{a: 1}',
    '[[1]]',
    '2026-99-99',
)


@pytest.fixture(scope='module')
def context():
    """Yield one context for all nodes.

    Fast DDS can deadlock when one of two participants in a domain and process ends.
    """
    context = rclpy.Context()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        rclpy.init(args=[], context=context, domain_id=free_ros_domain())
    yield context
    context.try_shutdown()


def started(name, literal, context):
    """Return the client's value of a parameter, or the error."""

    async def make(node):
        return ClientNode(node)._parameters[name]

    arguments = ['--ros-args', '-p', f'{name}:={literal}']
    try:
        node = Node('epson_driver', context=context, cli_args=arguments)
    except RuntimeError as error:  # rcl cannot read it
        return None, str(error)
    try:
        return asyncio.run(make(node)), None
    except (ParameterException, InputError, ValueError) as error:
        return None, str(error)
    finally:
        node.destroy_node()


PARTS = 4
"""`make test` and `make test-all` try one part of ODD per parameter, and `make soak-tests` all."""


@pytest.mark.parametrize(
    'part', [0, *(pytest.param(part, marks=pytest.mark.soak) for part in range(1, PARTS))]
)
@pytest.mark.parametrize('name', quickly(['remote_port'], ROWS, several=False))
def test_odd_value_is_used_or_rejected_by_the_parameter_s_name(name, part, context):
    row = ROWS[name]
    refused = 0
    literals = ODD[(part + list(ROWS).index(name)) % PARTS :: PARTS]
    for literal in literals:
        value, sentence = started(name, literal, context)
        if sentence is not None:
            assert name in sentence, literal
            refused += 1
        elif isinstance(row.default, list):
            assert value, literal
            assert all(isinstance(item, type(row.default[0])) for item in value), literal
        else:
            assert isinstance(value, type(row.default)), literal
            if row.low is not None:
                assert row.low <= value <= row.high, literal
            if row.choices:
                assert value in row.choices, literal
        if isinstance(value, float):
            assert math.isfinite(value), literal
    assert refused > len(literals) / 3
