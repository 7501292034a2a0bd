# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How a goal ends: its outcome, its result code, and the error of a goal that is not executed."""

from dataclasses import dataclass
from enum import Enum, IntEnum

from epson_driver.driver.remedy import Remedy


class ErrorCode(IntEnum):
    """Result codes of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class End(Enum):
    """How a goal ends, once (docs/invariants.md, 5)."""

    SUCCEEDED = 'succeeded'
    CANCELED = 'canceled'
    ABORTED = 'aborted'


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a goal ended: result code, reason and remedy.

    `unexplained`: the controller did not say why, so far.
    """

    end: End
    code: ErrorCode
    text: str
    unexplained: bool = False
    remedy: Remedy = Remedy.NONE


class GoalRejectedError(ValueError):
    """A goal that is not executed: result code, the reason as text, and the remedy."""

    def __init__(self, code: ErrorCode, text: str, remedy: Remedy = Remedy.NONE) -> None:
        super().__init__(text)
        self.code = code
        self.remedy = remedy

    @property
    def outcome(self) -> Outcome:
        """The goal's end."""
        return Outcome(End.ABORTED, self.code, str(self), remedy=self.remedy)
