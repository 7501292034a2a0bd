# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the controller is paused: it can be made to go on, and the goal with it."""

from epson_driver.simple_message import Status, TriState


class PauseDetector:
    """Reads it from STATUS: motion was possible and now is not, without an error.

    A controller that has never said that motion is possible does not tell, and is never paused.
    """

    def __init__(self) -> None:
        self.interrupted = False
        """Whether the controller denies motion; the arm may still brake."""
        self.paused = False
        """Whether the controller denies motion and the arm stands."""
        self._was_possible = False

    def see(self, status: Status) -> None:
        """Take the next status."""
        self._was_possible |= status.motion_possible == TriState.TRUE
        self.interrupted = (
            self._was_possible
            and status.motion_possible == TriState.FALSE
            and status.in_error != TriState.TRUE
            and not status.error_code
        )
        self.paused = self.interrupted and status.in_motion == TriState.FALSE
