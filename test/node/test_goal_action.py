# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the log says of how a goal ended."""

import pytest

from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.node.goal_action import CANCELED, outcome_line

CODE = ErrorCode.SUCCESSFUL


@pytest.mark.parametrize(
    ('outcome', 'line'),
    [
        (
            Outcome(End.SUCCEEDED, CODE, 'at the goal after 1.00 s'),
            'goal succeeded: at the goal after 1.00 s',
        ),
        (
            Outcome(End.CANCELED, CODE, 'canceled; the arm stands'),
            'goal canceled; the arm stands',
        ),
        (CANCELED, 'goal canceled before it could start'),
        (
            Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'the arm is not enabled'),
            'goal aborted: the arm is not enabled',
        ),
    ],
)
def test_a_line_says_once_how_a_goal_ended(outcome: Outcome, line: str) -> None:
    assert outcome_line(outcome) == line
