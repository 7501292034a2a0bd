# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sequences that became invalid after planning, and parameters that cannot be set."""

from types import SimpleNamespace

import numpy as np
import pytest

from epson_driver.driver.goal.planning_scope import PlanningScope
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.node.loop_bridge import DriverEndedError
from epson_driver.node.motion_primitives import MotionPrimitives, ToolBusyError
from epson_driver.node.node import ClientNode
from epson_driver.trace import TraceError


class Handle:
    """A goal and its outcomes."""

    def __init__(self):
        self.outcomes = []

    def on_end(self, outcome):
        self.outcomes.append(outcome)


@pytest.mark.invariant(3, 5)
@pytest.mark.parametrize(
    ('why', 'expected'),
    [('the E-stop is pressed', 'the E-stop is pressed'), (None, None)],
    ids=['ended', 'free'],
)
def test_sequence_is_not_executed_after_a_stop_during_planning(why, expected):
    plan, handle, submitted = PlanningScope(), Handle(), []
    if why is not None:
        plan.end(why)
    queue = SimpleNamespace(submit=submitted.append)
    MotionPrimitives.submit(SimpleNamespace(_queue=queue), handle, plan)
    if expected is None:
        assert (submitted, handle.outcomes) == ([handle], [])
        assert handle.alone
        return
    (outcome,) = handle.outcomes
    assert (outcome.end, outcome.code) == (End.ABORTED, ErrorCode.INVALID_GOAL)
    assert expected in outcome.text
    assert submitted == []


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
