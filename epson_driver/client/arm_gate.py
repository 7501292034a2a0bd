# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm gate: after anything that stopped the arm for safety it stays still until enabled."""

from epson_driver.error_texts import NO_ERROR, ErrorTexts
from epson_driver.simple_message import Status, TriState


class ArmGate:
    """Open or closed, and why. Closed from the start; only `open` opens it.

    docs/invariants.md, 4: a link that comes back, a released E-stop or motors that are switched
    on again do not open it.
    """

    def __init__(self) -> None:
        self._reason: str | None = 'not enabled since the driver started'

    @property
    def reason(self) -> str | None:
        """Why it is closed; None while it is open."""
        return self._reason

    def open(self) -> None:
        """Somebody enabled the arm."""
        self._reason = None

    def close(self, reason: str) -> bool:
        """Close it. Returns True if it was open; otherwise the first reason is kept."""
        if self._reason is not None:
            return False
        self._reason = reason
        return True


def what_forbids_motion(status: Status, errors: ErrorTexts) -> str | None:
    """Return why the controller's status forbids motion, as a clause; None if it does not.

    Fields that the controller reports as unknown forbid nothing. `errors` has the texts of its
    error numbers.
    """
    number = status.error_code
    error = '' if number == NO_ERROR else f', error {errors.phrase(number)}'
    if status.e_stopped == TriState.TRUE:
        return f'the E-stop is pressed or not reset{error}'
    if status.in_error == TriState.TRUE:
        return f'the controller is in error {errors.phrase(number)}'
    if status.drives_powered == TriState.FALSE:
        return f'the motors are off{error}'
    return None
