# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every parameter with every odd value at the start: it holds, or one sentence says why not."""

import asyncio
import gc
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

OF_TRACES = ('trace_file', 'trace_size')  # a name of a file here makes a file
ROWS = {row.name: row for row in (*TABLE, *joint_rows('joint_1')) if row.name not in OF_TRACES}

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


def started(name, literal, domain):
    """Return the client's value of a parameter that is given so, or the sentence.

    Fast DDS may wait for itself when one of two participants of a domain in one process ends: that
    of the node before, which an exception's traceback may hold, is gone first.
    """
    gc.collect()

    async def make(node):
        return ClientNode(node)._parameters[name]

    context = rclpy.Context()
    arguments = ['--ros-args', '-p', f'{name}:={literal}']
    try:
        rclpy.init(args=arguments, context=context, domain_id=domain)
    except RuntimeError as error:  # rcl cannot read it
        return None, str(error)
    try:
        node = Node('epson_driver', context=context)
        try:
            return asyncio.run(make(node)), None
        except (ParameterException, InputError, ValueError) as error:
            return None, str(error)
        finally:
            node.destroy_node()
    finally:
        context.try_shutdown()


PARTS = 4
"""Each parameter is given a part of ODD in `make test`, another one each, and all in test-all."""


@pytest.mark.parametrize(
    'part', [0, *(pytest.param(part, marks=pytest.mark.slow) for part in range(1, PARTS))]
)
@pytest.mark.parametrize('name', quickly(['remote_port'], ROWS, several=False))
def test_a_value_holds_or_is_refused_in_a_sentence_that_names_the_parameter(
    name, part, monkeypatch
):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain = free_ros_domain()
    row = ROWS[name]
    refused = 0
    given = ODD[(part + list(ROWS).index(name)) % PARTS :: PARTS]
    for literal in given:
        value, sentence = started(name, literal, domain)
        if sentence is not None:
            assert name in sentence, literal
            refused += 1
        elif isinstance(row.default, list):
            assert value, literal
            assert all(isinstance(each, type(row.default[0])) for each in value), literal
        else:
            assert isinstance(value, type(row.default)), literal
            if row.low is not None:
                assert row.low <= value <= row.high, literal
            if row.choices:
                assert value in row.choices, literal
        if isinstance(value, float):
            assert math.isfinite(value), literal
    assert refused > len(given) / 3
