# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Exceptions of the Python API. A motion raises only RobotErrors."""

import contextlib
from collections.abc import Iterator

from epson_driver.driver.goal.planning_scope import PlanningEndedError
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.inputs import number
from epson_driver.tool_motion.joint_path import PathError as NoPathError
from epson_driver.tool_motion.pose_path import BlendError

WORDS = {
    Remedy.CONNECT: 'start the controller, or check host and ports',
    Remedy.RELEASE_ESTOP: 'release it, call reset() (or reset at the controller), then enable()',
    Remedy.RESET: 'call reset(), then enable()',
    Remedy.BOOT: 'switch the controller off and on again, then call enable()',
    Remedy.CLOSE_SAFEGUARD: 'close it, reset or continue at the controller, then call enable()',
    Remedy.START_MAIN: 'start main, or call enable()',
    Remedy.TURN_TO_AUTO: 'turn it to AUTO, then call enable()',
    Remedy.ENABLE: 'call enable()',
    Remedy.END_STREAM: 'end that, or call stop()',
    Remedy.ALLOW_END_VELOCITY: '',
    Remedy.ALLOW_OTHER_SPEED: 'or set require_planned_speed=False in Settings',
}
"""Remedies in the names of this API."""


TIMEOUT = number(0.0, 1e7, 's')


class RobotError(RuntimeError):
    """A request failed. The text contains the reason and the remedy."""

    def __init__(self, text: str, remedy: Remedy = Remedy.NONE) -> None:
        super().__init__(with_remedy(text, remedy, WORDS))


class MotionError(RobotError):
    """A motion was rejected, or did not reach its end. The arm is not at the target.

    end: CANCELED or ABORTED. code: the error code of FollowJointTrajectory for the same case.
    """

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.text, outcome.remedy)
        self.end: End = outcome.end
        self.code: ErrorCode = outcome.code


class ArgumentError(RobotError, ValueError):
    """A motion was requested with an invalid argument. Nothing was sent."""


class PathError(ArgumentError):
    """The tool cannot follow a path from the current position: out of reach, or singular.

    The text contains place, joint and limit. Nothing was sent.
    """


def not_begun(sentence: str) -> MotionError:
    """Return the error for a motion that was not started."""
    return MotionError(Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, sentence))


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Convert rejections by the driver, and canceled planning, to MotionError."""
    try:
        yield
    except PlanningEndedError as ended:
        raise not_begun(str(ended)) from ended
    except GoalRejectedError as rejection:
        raise MotionError(rejection.outcome) from rejection


@contextlib.contextmanager
def argument_errors() -> Iterator[None]:
    """Convert ValueErrors to ArgumentError."""
    try:
        yield
    except RobotError:
        raise
    except (NoPathError, BlendError) as error:
        raise PathError(str(error)) from error
    except ValueError as error:
        raise ArgumentError(str(error)) from error


def checked_timeout(timeout: float | None) -> float | None:
    """Return a timeout, s, or None for no timeout. Raises ArgumentError."""
    with argument_errors():
        return None if timeout is None else float(TIMEOUT.checked(timeout, 'timeout'))
