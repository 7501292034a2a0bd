# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm gate, which inhibits motion until the arm is enabled."""

import contextlib
from collections.abc import Callable, Iterator

from epson_driver.driver.inhibit import Inhibit

DISABLED = 'disabled on request'  # reason for a gate that was closed by the `disable` command


class GateError(RuntimeError):
    """Raised if the gate stays closed, because the request to open it is no longer valid."""


class EnableRequest:
    """A pending request to open the gate. `canceled`: why it is no longer valid, or None.

    `motors_on`: the motors have been reported on since the request was made. If they go off, the
    request is canceled.
    """

    def __init__(self, motors_on: bool) -> None:
        self.canceled: str | None = None
        self.motors_on = motors_on
        self.on_cancel: Callable[[], object] = lambda: None  # called when the request is canceled

    def cancel(self, why: str) -> None:
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
        self.refusal: Inhibit | None = None  # of the last attempt to enable the arm

    @property
    def reason(self) -> str | None:
        return self._reason

    @contextlib.contextmanager
    def enabling(self, *, motors_on: bool = False) -> Iterator[EnableRequest]:
        """Register a request to open the gate. `motors_on`: cancel it if the motors go off."""
        request = EnableRequest(motors_on)
        self._requests.append(request)
        try:
            yield request
        finally:
            self._requests.remove(request)

    def open(self, request: EnableRequest) -> None:
        if request.canceled is not None:
            raise GateError(request.canceled)
        if request not in self._requests:
            raise GateError('the request to enable the arm has ended')
        self._reason = self.refusal = None
        self._unexplained = False

    def close(self, reason: str, *, motors_off: bool = False, unexplained: bool = False) -> bool:
        """Close the gate, cancel pending requests, and return whether the gate was open.

        `motors_off`: the motors are off, and there is no other reason. This only cancels requests
        with `motors_on`. `unexplained`: the next reason is appended to this reason.
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
        """Record that the motors are on. If they go off now, pending requests are canceled."""
        for request in self._requests:
            request.motors_on = True
