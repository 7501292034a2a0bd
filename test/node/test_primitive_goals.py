# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A tool change during a sequence, and parameters that cannot be set."""

from types import SimpleNamespace

import numpy as np
import pytest

from epson_driver.node.loop_bridge import DriverEndedError
from epson_driver.node.motion_primitives import MotionPrimitives, ToolBusyError
from epson_driver.node.node import ClientNode
from epson_driver.trace import TraceError


def test_set_tool_is_rejected_during_a_sequence():
    with pytest.raises(ToolBusyError):
        MotionPrimitives.set_tool(SimpleNamespace(busy=True), np.eye(4))


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('error', 'expected'),
    [
        (TraceError('trace_folder: No space left on device'), 'trace_folder: No space left'),
        (DriverEndedError(), 'the driver has ended'),
        (ZeroDivisionError('x'), 'setting parameters failed: x'),
    ],
)
def test_failed_parameter_change_is_reported(error, expected):
    def fails(_changes):
        raise error

    bridge = SimpleNamespace(failed=lambda what, failure: f'{what} failed: {failure}')
    node = SimpleNamespace(_set_parameters=fails, _bridge=bridge)
    result = ClientNode._on_set_parameters(node, [])
    assert not result.successful
    assert expected in result.reason
