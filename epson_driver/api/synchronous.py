# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The synchronous classes of the Python API, derived from the asynchronous ones.

Each function below takes a member of an asynchronous class, and returns the corresponding member
of a synchronous class. Both have the same arguments, types and docstring. The synchronous member
runs the asynchronous one in the thread of the event loop.
"""

import inspect
from collections.abc import Callable, Coroutine
from functools import partial, update_wrapper
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar, overload

from epson_driver.api.io import Gripper as AwaitedGripper
from epson_driver.api.io import Io as AwaitedIo
from epson_driver.api.motion import Motion as AwaitedMotion
from epson_driver.api.ownership import Unique
from epson_driver.api.points import Points as AwaitedPoints
from epson_driver.api.simulation import Simulation as AwaitedSimulation
from epson_driver.api.threads import Session

A_co = TypeVar('A_co', covariant=True)
P = ParamSpec('P')
S = TypeVar('S')
T = TypeVar('T')


class Synchronous(Unique, Generic[A_co]):
    """Base class of synchronous objects: an asynchronous object and the session that runs it."""

    def __init__(self, awaited: A_co, session: Session) -> None:
        self._awaited = awaited
        self._session = session

    def __repr__(self) -> str:
        return repr(self._awaited)


Via = Callable[[Synchronous[Any], Callable[[], Any]], Any]
"""Function that calls a function of the asynchronous object and returns its result."""


def now(self: Synchronous[Any], ask: Callable[[], T]) -> T:
    """Call a function immediately, in the event loop if connected, or else in this thread."""
    return self._session.call(ask)


def measured(self: Synchronous[Any], ask: Callable[[], T]) -> T:
    """Call a function in the event loop after all received messages have been processed."""
    result: T = self._session.run(partial(self._awaited.measured, ask))
    return result


def waits(
    method: Callable[Concatenate[A_co, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[Synchronous[A_co], P], T]:
    """Derive a method that waits for the result of a coroutine method."""

    def run(self: Synchronous[A_co], /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._session.run(partial(method, self._awaited, *args, **kwargs))

    return _described(run, method)


def moves(
    method: Callable[Concatenate[A_co, P], Coroutine[Any, Any, AwaitedMotion]],
) -> Callable[Concatenate[Synchronous[A_co], P], 'Motion']:
    """Derive a method from a coroutine method that returns a motion."""

    def run(self: Synchronous[A_co], /, *args: P.args, **kwargs: P.kwargs) -> Motion:
        start = partial(method, self._awaited, *args, **kwargs)
        return Motion(self._session.run(start), self._session)

    return _described(run, method, Motion)


def calls(
    method: Callable[Concatenate[A_co, P], T], via: Via = now
) -> Callable[Concatenate[Synchronous[A_co], P], T]:
    """Derive a method from a method that is not a coroutine."""

    def run(self: Synchronous[A_co], /, *args: P.args, **kwargs: P.kwargs) -> T:
        result: T = via(self, partial(method, self._awaited, *args, **kwargs))
        return result

    return _described(run, method)


def registers(
    method: Callable[Concatenate[A_co, P], T],
) -> Callable[Concatenate[Synchronous[A_co], P], T]:
    """Derive a method that registers a callback, which then runs in a separate thread."""

    def run(self: Synchronous[A_co], /, *args: P.args, **kwargs: P.kwargs) -> T:
        add: Callable[..., T] = method

        def wrap(argument: object) -> object:  # the method rejects other objects
            return self._session.callbacks.wrap(argument) if callable(argument) else argument

        named = {name: wrap(argument) for name, argument in kwargs.items()}
        return add(self._awaited, *map(wrap, args), **named)

    return _described(run, method)


class Reading(property, Generic[T]):
    """A property with a declared type, for type checkers."""

    @overload
    def __get__(self, instance: None, owner: type | None = None) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type | None = None) -> T: ...
    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        """Return the property's value, or the property itself when accessed on the class."""
        return super().__get__(instance, owner)


def reads(kind: type[A_co], read: Callable[[A_co], T], via: Via = now) -> Reading[T]:
    """Derive a property from a property of an asynchronous class.

    * kind: the asynchronous class.
    * read: function that reads the property from an object of this class.
    """
    (name,) = read.__code__.co_names

    def get(self: Synchronous[A_co]) -> T:
        result: T = via(self, partial(read, self._awaited))
        return result

    return Reading(_described(get, getattr(kind, name).fget))


def makes(
    make: Callable[P, A_co],
) -> Callable[[Callable[[S, A_co], T]], Callable[Concatenate[S, P], T]]:
    """Return a decorator for a method whose parameter is an asynchronous object.

    The decorated method has the parameters of `make` instead, and calls `make` for the object.
    """

    def decorate(function: Callable[[S, A_co], T]) -> Callable[Concatenate[S, P], T]:
        def run(first: S, /, *args: P.args, **kwargs: P.kwargs) -> T:
            return function(first, make(*args, **kwargs))

        signature = inspect.signature(function)
        (first, _), own = signature.parameters.values(), inspect.signature(make).parameters
        update_wrapper(run, function)
        run.__signature__ = signature.replace(parameters=[first, *own.values()])  # type: ignore[attr-defined]
        return run

    return decorate


def _described(
    run: Callable[P, T], method: Callable[..., object], returned: object = None
) -> Callable[P, T]:
    """Return `run` with the name, arguments and docstring of `method`.

    `returned`: another annotation of the result, or None for the same annotation.
    """
    update_wrapper(run, method)
    if returned is not None:
        signature = inspect.signature(method).replace(return_annotation=returned)
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__annotations__ = run.__annotations__ | {'return': returned}
    return run


class Motion(Synchronous[AwaitedMotion]):
    """A motion of the arm. It ends exactly once: succeeded, canceled or aborted."""

    done = reads(AwaitedMotion, lambda motion: motion.done)
    text = reads(AwaitedMotion, lambda motion: motion.text)
    duration = reads(AwaitedMotion, lambda motion: motion.duration)
    progress = reads(AwaitedMotion, lambda motion: motion.progress)

    def wait(self, timeout: float | None = None) -> str:
        """Wait until the motion ends, and return its text.

        Raises MotionError unless the motion succeeded, and TimeoutError after `timeout` s. The
        motion continues after a timeout. Ctrl-C during the wait stops the arm.
        """
        return self._session.run(partial(self._awaited.finish, timeout))

    cancel = waits(AwaitedMotion.cancel)


class Io(Synchronous[AwaitedIo]):
    """Reads and writes single I/O points.

    The methods raise RobotError if the controller has no I/O, or refuses a request.
    """

    read = waits(AwaitedIo.read)
    write = waits(AwaitedIo.write)
    wait = waits(AwaitedIo.wait)


class Gripper(Synchronous[AwaitedGripper]):
    """Opens and closes the gripper of `Settings(gripper=GripperWiring(...))`.

    Without this setting, each method raises RobotError. The arm need not be enabled.
    """

    open = waits(AwaitedGripper.open)
    close = waits(AwaitedGripper.close)
    state = waits(AwaitedGripper.state)


class Simulation(Synchronous[AwaitedSimulation]):
    """Operator actions at a simulated controller. At a real one, they raise RobotError."""

    estop = waits(AwaitedSimulation.estop)
    door = waits(AwaitedSimulation.door)
    go_on = waits(AwaitedSimulation.go_on)
    input = waits(AwaitedSimulation.input)
    fault = waits(AwaitedSimulation.fault)


class Points(Synchronous[AwaitedPoints]):
    """Taught points: a mapping from names, such as pick or P3, to EpsonPoints. Case is ignored.

    A motion to a point uses the arm configuration nearest to the current one, and not the posture
    that is saved with the point.
    """

    __getitem__ = calls(AwaitedPoints.__getitem__)
    __setitem__ = calls(AwaitedPoints.__setitem__)
    __delitem__ = calls(AwaitedPoints.__delitem__)
    __iter__ = calls(AwaitedPoints.__iter__)
    __len__ = calls(AwaitedPoints.__len__)
    __contains__ = calls(AwaitedPoints.__contains__)
    teach = calls(AwaitedPoints.teach, measured)
    load = calls(AwaitedPoints.load)
    save = calls(AwaitedPoints.save)
