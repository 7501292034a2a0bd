# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Callbacks for joints, E-stop, errors and the link, called when the state has changed."""

from collections.abc import Callable
from typing import Generic, ParamSpec

from epson_driver.api.driver_status import controller_error
from epson_driver.api.status import ControllerError, Sample
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.error_texts import ErrorTexts
from epson_driver.simple_message import Status, TriState

P = ParamSpec('P')

Failed = Callable[[Exception], None]
"""Called with the exception that a callback raised."""


class Callbacks(Generic[P]):
    """Functions that are called one after the other, even if one raises an exception."""

    def __init__(self, failed: Failed) -> None:
        self._failed = failed
        self._functions: list[Callable[P, object]] = []

    @property
    def wanted(self) -> bool:
        """Whether a function is registered."""
        return bool(self._functions)

    def add(self, function: Callable[P, object]) -> Callable[[], None]:
        """Register a function. Returns a function that unregisters it."""
        self._functions.append(function)

        def remove() -> None:
            if function in self._functions:
                self._functions.remove(function)

        return remove

    def clear(self) -> None:
        """Unregister all functions."""
        self._functions.clear()

    def call(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Call all functions."""
        for function in list(self._functions):
            try:
                function(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 - it is reported, and stops the arm
                self._failed(error)


class Changes:
    """Calls the callbacks when E-stop, error or link change. Unknown values are not a change."""

    def __init__(self, failed: Failed, texts: ErrorTexts) -> None:
        self.estop: Callbacks[[bool]] = Callbacks(failed)
        self.error: Callbacks[[ControllerError | None]] = Callbacks(failed)
        self.link: Callbacks[[str, str]] = Callbacks(failed)
        self.joints: Callbacks[[Sample]] = Callbacks(failed)
        self.recorded: Callbacks[[JointSample]] = Callbacks(failed)
        self._texts = texts
        self._e_stopped = False
        self._number: int | None = None

    def see(self, status: Status) -> None:
        """Process a STATUS."""
        if status.e_stopped in (TriState.TRUE, TriState.FALSE):
            e_stopped = status.e_stopped == TriState.TRUE
            if e_stopped != self._e_stopped:
                self._e_stopped = e_stopped
                self.estop.call(e_stopped)
        error = controller_error(status, self._texts)
        number = None if error is None else error.number
        if number != self._number and (error is not None or status.in_error == TriState.FALSE):
            self._number = number
            self.error.call(error)
