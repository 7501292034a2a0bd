# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm gate, which inhibits motion until the arm is enabled."""

import contextlib
from collections.abc import Callable, Iterator

from epson_driver.driver.inhibit import Inhibit

DISABLED = 'disabled on request'
"""Reason for a gate that was closed by the `disable` command."""


class GateError(RuntimeError):
    """Raised if the gate stays closed, because the request to open it is no longer valid."""


class EnableRequest:
    """A pending request to open the gate.

    `canceled`: the first reason to close the gate since the request started, or None if the
    request is still valid. `motors_on`: the motors have been reported on since the request
    started. If they go off, the request is canceled.
    """

    def __init__(self, motors_on: bool) -> None:
        self.canceled: str | None = None
        self.motors_on = motors_on
        self.on_cancel: Callable[[], object] = lambda: None
        """Called when the request is canceled."""

    def cancel(self, why: str) -> None:
        """Cancel the request, for a reason to close the gate."""
        if self.canceled is None:
            self.canceled = why
            self.on_cancel()


class ArmGate:
    """The gate that inhibits motion while it is closed. It starts closed.

    Only an EnableRequest opens it (docs/invariants.md, 4). A restored link, a released E-stop or
    motors that are switched on again do not. A reason to close the gate also cancels pending
    requests, even if the gate is already closed.
    """

    def __init__(self) -> None:
        self._reason: str | None = 'not enabled since the driver started'
        self._unexplained = False
        self._requests: list[EnableRequest] = []
        self.refusal: Inhibit | None = None
        """Why the controller refused the last attempt to enable the arm, or None."""

    @property
    def reason(self) -> str | None:
        """Why the gate is closed, or None while it is open."""
        return self._reason

    @contextlib.contextmanager
    def enabling(self, *, motors_on: bool = False) -> Iterator[EnableRequest]:
        """Register a request to open the gate for the duration of the `with` block.

        `motors_on`: initial value of `EnableRequest.motors_on`. While it is False, motors that are
        off do not cancel the request, because the request is expected to switch them on.
        """
        request = EnableRequest(motors_on)
        self._requests.append(request)
        try:
            yield request
        finally:
            self._requests.remove(request)

    def open(self, request: EnableRequest) -> None:
        """Open the gate. Raises GateError if the request is canceled or no longer registered."""
        if request.canceled is not None:
            raise GateError(request.canceled)
        if request not in self._requests:
            raise GateError('the request to enable the arm has ended')
        self._reason = self.refusal = None
        self._unexplained = False

    def close(self, reason: str, *, motors_off: bool = False, unexplained: bool = False) -> bool:
        """Close the gate, cancel pending requests, and return whether the gate was open.

        A closed gate keeps its first reason. `motors_off`: the only reason is that the motors are
        off, which cancels only requests with `motors_on`. `unexplained`: the controller has not
        reported the cause yet. The next reason is then appended to this one.
        """
        for request in list(self._requests):
            if request.motors_on or not motors_off:
                request.cancel(reason)
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
        for request in self._requests:
            request.motors_on = True
