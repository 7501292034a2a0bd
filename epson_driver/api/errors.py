# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Exceptions of the Python API, and checks of its arguments."""

import contextlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache, wraps
from os import PathLike
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, get_args, get_origin

from epson_driver.driver.goal.planning_cancellation import PlanningEndedError
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.inputs import ArgumentError as ArgumentError
from epson_driver.inputs import RobotError as RobotError
from epson_driver.inputs import Rule, number
from epson_driver.taught_points import plain
from epson_driver.tool_motion.joint_path import PathError as NoPathError
from epson_driver.tool_motion.pose_path import BlendError

WORDS = {
    Remedy.CONNECT: 'start the controller, or check host and ports',
    Remedy.RELEASE_ESTOP: 'release it, call reset() (or reset at the controller), then enable()',
    Remedy.RESET: 'call reset(), then enable()',
    Remedy.BOOT: 'switch the controller off and on again, then call enable()',
    Remedy.CLOSE_SAFEGUARD: 'close it, continue at the controller if paused, then call enable()',
    Remedy.START_MAIN: 'start main, or call enable()',
    Remedy.TURN_TO_AUTO: 'turn it to AUTO, then call enable()',
    Remedy.ENABLE: 'call enable()',
    Remedy.END_STREAM: 'end it, let it hold still for a second, or call stop()',
    Remedy.ALLOW_END_VELOCITY: '',
    Remedy.ALLOW_OTHER_SPEED: 'or set require_planned_speed=False in Settings',
}
"""Remedies in terms of this API's methods."""

TIMEOUT = number(0.0, 1e7, 's')


class MotionError(RobotError):
    """A motion was rejected, canceled or aborted.

    * end: CANCELED or ABORTED.
    * code: the error code of FollowJointTrajectory that corresponds to this case.
    """

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(with_remedy(outcome.text, outcome.remedy, WORDS))
        self.end: End = outcome.end
        self.code: ErrorCode = outcome.code


class PathError(ArgumentError):
    """The tool cannot reach a pose or follow a path.

    A pose is out of reach, or the path passes a singularity. The text names the pose, the joint
    and the limit. Nothing was sent to the controller.
    """


def not_started(sentence: str) -> MotionError:
    """Return the error for a motion that did not start. `sentence`: the reason."""
    return MotionError(Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, sentence))


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Convert a rejection by the driver, or the cancellation of planning, to MotionError."""
    try:
        yield
    except PlanningEndedError as ended:
        raise not_started(str(ended)) from ended
    except GoalRejectedError as rejection:
        raise MotionError(rejection.outcome) from rejection


@contextlib.contextmanager
def argument_errors() -> Iterator[None]:
    """Convert ValueErrors to ArgumentError, or to PathError if the tool cannot follow a path."""
    try:
        yield
    except RobotError:
        raise
    except (NoPathError, BlendError) as error:
        raise PathError(str(error)) from error
    except ValueError as error:
        raise ArgumentError(str(error)) from error


def checked_timeout(timeout: float | None) -> float | None:
    """Return `timeout`, s (None: no timeout). Raises ArgumentError if the timeout is invalid."""
    with argument_errors():
        return None if timeout is None else float(TIMEOUT.checked(timeout, 'timeout'))


P = ParamSpec('P')
T = TypeVar('T')

_EXPECTED: dict[Any, str] = {
    bool: 'True or False',
    str: 'the path of a file',
    PathLike: 'the path of a file',
    Callable: 'a function',
    NoneType: 'None',
}


def checked_arguments(method: Callable[P, T]) -> Callable[P, T]:
    """Decorate a method or coroutine method so that it raises ArgumentError for invalid arguments.

    This checks flags, functions, paths and objects of this package against their annotations, and
    converts numpy numbers to Python numbers. The method itself must check numbers, names and
    shapes.
    """
    call: Any = method
    code = call.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]

    @cache
    def rules() -> dict[str, Rule | None]:
        return {name: _rule(item) for name, item in call.__annotations__.items()}

    def check(args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        values, named = [plain(arg) for arg in args], {k: plain(v) for k, v in kwargs.items()}
        for name, value in [*zip(names, values, strict=False), *named.items()]:
            if (rule := rules().get(name)) is not None:
                rule.checked(value, name)
        return values, named

    @wraps(method)
    def run(*args: Any, **kwargs: Any) -> Any:
        with argument_errors():
            values, named = check(args, kwargs)
            return call(*values, **named)

    @wraps(method)
    async def run_awaited(*args: Any, **kwargs: Any) -> Any:
        with argument_errors():
            values, named = check(args, kwargs)
            return await call(*values, **named)

    return run_awaited if inspect.iscoroutinefunction(method) else run  # type: ignore[return-value]


def _rule(annotation: Any) -> Rule | None:
    kinds = get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
    kinds = tuple(get_origin(kind) or kind for kind in kinds)
    classes = [kind for kind in kinds if isinstance(kind, type)]
    own_classes = [kind for kind in classes if kind.__module__.startswith('epson_driver.')]
    if len(classes) < len(kinds) or not all(
        kind in _EXPECTED or kind in own_classes for kind in kinds
    ):
        return None
    if kinds in ((str,), (str, NoneType)):  # a name: the method checks it
        return None
    message = [_EXPECTED.get(kind, kind.__name__) for kind in classes]

    def read(value: Any) -> Any:
        if not isinstance(value, kinds):
            raise TypeError
        return value

    return Rule(read, f'must be {" or ".join(dict.fromkeys(message))}')
