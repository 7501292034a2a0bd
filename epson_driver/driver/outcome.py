# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The end of a goal: its outcome, its result code, and the error of a rejected goal."""

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
    SUCCEEDED = 'succeeded'
    CANCELED = 'canceled'
    ABORTED = 'aborted'


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a goal. `unexplained`: the controller has not reported the cause yet."""

    end: End
    code: ErrorCode
    text: str
    unexplained: bool = False
    remedy: Remedy = Remedy.NONE


class GoalRejectedError(ValueError):
    def __init__(self, code: ErrorCode, text: str, remedy: Remedy = Remedy.NONE) -> None:
        super().__init__(text)
        self.code = code
        self.remedy = remedy

    @property
    def outcome(self) -> Outcome:
        return Outcome(End.ABORTED, self.code, str(self), remedy=self.remedy)
