# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm gate: after anything that stopped the arm for safety it stays still until enabled."""

import contextlib
from collections.abc import Callable, Iterator


class GateError(RuntimeError):
    """The gate stays closed, as something closed it after the request to open it."""


class Enabling:
    """A request to open the gate, while it is under way.

    `canceled` says what closed the gate since, or would have closed it; None: nothing did.
    `motors_on`: the motors were seen on since it began, so that they must stay on.
    """

    def __init__(self, motors_on: bool) -> None:
        self.canceled: str | None = None
        self.motors_on = motors_on
        self.on_cancel: Callable[[], object] = lambda: None
        """Called when it is canceled."""

    def cancel(self, why: str) -> None:
        """Cancel this request, as something closes the gate."""
        if self.canceled is None:
            self.canceled = why
            self.on_cancel()


class ArmGate:
    """Open or closed, and why: closed from the start until `open` opens it.

    docs/invariants.md, 4: a link that comes back, a released E-stop or motors that are switched
    on again do not open it. Nor does a request that was under way when something closed it, or
    would have closed it if it had been open.
    """

    def __init__(self) -> None:
        self._reason: str | None = 'not enabled since the driver started'
        self._unexplained = False
        self._under_way: list[Enabling] = []

    @property
    def reason(self) -> str | None:
        """Why it is closed, or None while it is open."""
        return self._reason

    @contextlib.contextmanager
    def enabling(self, *, motors_on: bool = False) -> Iterator[Enabling]:
        """Begin a request to open it, which ends with the block.

        Motors that are off cancel it only once they were seen on (`motors_on`: they were):
        until then it is what switches them on.
        """
        enabling = Enabling(motors_on)
        self._under_way.append(enabling)
        try:
            yield enabling
        finally:
            self._under_way.remove(enabling)

    def open(self, enabling: Enabling) -> None:
        """Open it, for a request under way. Raises GateError if that was canceled."""
        if enabling.canceled is not None:
            raise GateError(enabling.canceled)
        if enabling not in self._under_way:
            raise GateError('the request to enable the arm has ended')
        self._reason = None
        self._unexplained = False

    def close(self, reason: str, *, motors_off: bool = False, unexplained: bool = False) -> bool:
        """Close it, or keep the first reason if it is closed. Returns True if it was open.

        Either way it cancels the requests to open it that are under way. `motors_off`: only that
        the motors are off closes it. `unexplained`: the controller has not said why so far; the
        next reason is added to this one.
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
        """Record that the motors are on, on which requests to open the gate rely."""
        for enabling in self._under_way:
            enabling.motors_on = True
