# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm gate: after any stop for safety the arm stays still until it is enabled."""

import contextlib
from collections.abc import Callable, Iterator

DISABLED = 'disabled on request'
"""The reason of a gate that was closed by a request."""


class GateError(RuntimeError):
    """The gate stays closed because it was closed again after the request to open it."""


class EnableRequest:
    """A pending request to open the gate.

    `canceled`: the reason that closed the gate since the request started, or would have closed an
    open one. None if the request is still valid.
    `motors_on`: the motors have been seen on since the request started, so they must stay on.
    """

    def __init__(self, motors_on: bool) -> None:
        self.canceled: str | None = None
        self.motors_on = motors_on
        self.on_cancel: Callable[[], object] = lambda: None
        """Called when the request is canceled."""

    def cancel(self, why: str) -> None:
        """Cancel this request because the gate was closed."""
        if self.canceled is None:
            self.canceled = why
            self.on_cancel()


class ArmGate:
    """The gate, open or closed with a reason. It starts closed, and only `open` opens it.

    docs/invariants.md, 4: a restored link, a released E-stop or motors switched on again do not
    open it. A pending request does not open it either if the gate was closed since the request
    started, or would have been closed if it had been open.
    """

    def __init__(self) -> None:
        self._reason: str | None = 'not enabled since the driver started'
        self._unexplained = False
        self._under_way: list[EnableRequest] = []

    @property
    def reason(self) -> str | None:
        """Why the gate is closed, or None while it is open."""
        return self._reason

    @contextlib.contextmanager
    def enabling(self, *, motors_on: bool = False) -> Iterator[EnableRequest]:
        """Register a request to open the gate for the duration of the `with` block.

        Motors that are off cancel the request only after they have been seen on (`motors_on`: they
        already were). Before that, this request is expected to switch them on.
        """
        enabling = EnableRequest(motors_on)
        self._under_way.append(enabling)
        try:
            yield enabling
        finally:
            self._under_way.remove(enabling)

    def open(self, enabling: EnableRequest) -> None:
        """Open the gate for a pending request. Raises GateError if it is canceled or over."""
        if enabling.canceled is not None:
            raise GateError(enabling.canceled)
        if enabling not in self._under_way:
            raise GateError('the request to enable the arm has ended')
        self._reason = None
        self._unexplained = False

    def close(self, reason: str, *, motors_off: bool = False, unexplained: bool = False) -> bool:
        """Close the gate and return True if it was open. A closed gate keeps its first reason.

        Pending requests to open it are canceled in both cases. `motors_off`: the only reason is
        that the motors are off, which cancels only requests that have seen them on.
        `unexplained`: the controller has not reported a cause yet, so the next reason is appended
        to this one.
        """
        for enabling in list(self._under_way):
            if enabling.motors_on or not motors_off:
                enabling.cancel(reason)
        if self._reason is not None:
            if self._unexplained and not unexplained:
                self._reason = f'{self._reason}; then: {reason}'
                self._unexplained = False
            return False
        self._reason = reason
        self._unexplained = unexplained
        return True

    def see_motors_on(self) -> None:
        """Record for all pending requests that the motors are on and must stay on."""
        for enabling in self._under_way:
            enabling.motors_on = True
