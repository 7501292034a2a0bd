# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the Python API raises, besides ValueError for arguments that cannot be used."""

import contextlib
import re
from collections.abc import Iterator

from epson_driver.driver.goal.goal_plan import PlanEndedError
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome

_NAMES = {
    '~/enable': 'enable()',
    '~/disable': 'disable()',
    '~/reset_error': 'reset()',
    '~/stop': 'stop()',
    'robot_ip': 'host',
    'the parameter io_port': 'io_port',
    'the parameter remote_port': 'remote_port',
    ' (or set allow_nonzero_velocity_at_trajectory_end)': '',
}

_NAME = re.compile('|'.join(re.escape(name) + r'(?!\w)' for name in _NAMES))


def in_python(sentence: str) -> str:
    """Return a sentence of the driver with the names of this API in place of those in ROS."""
    return _NAME.sub(lambda found: _NAMES[found[0]], sentence)


class RobotError(RuntimeError):
    """What was asked for could not be done; the text says why and what to do."""

    def __init__(self, sentence: str) -> None:
        super().__init__(in_python(sentence))


class MotionError(RobotError):
    """A motion was not begun, or did not reach its end. The arm is not where it was to go.

    end: CANCELED or ABORTED. code: that of the action FollowJointTrajectory for the same case.
    """

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.text)
        self.end: End = outcome.end
        self.code: ErrorCode = outcome.code


def not_begun(sentence: str) -> MotionError:
    """Return the error for a motion that was not begun."""
    return MotionError(Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, sentence))


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Raise a MotionError for what the driver refuses, or ended before it could start."""
    try:
        yield
    except PlanEndedError as ended:
        raise not_begun(str(ended)) from ended
    except GoalRejectedError as rejection:
        raise MotionError(rejection.outcome) from rejection
