# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The wiring, state and exception of a gripper."""

from dataclasses import dataclass

from epson_driver.inputs import ArgumentError, count, number

_INDEX = count(0, 2**31 - 1)
_STROKE_M = number(1e-4, 2.0, 'm')
_TIME_S = number(0.05, 60.0, 's')


class GripperError(RuntimeError):
    """Raised if a command fails, or if the gripper's state is unknown. Its text is the reason."""


@dataclass(frozen=True, kw_only=True)
class GripperWiring:
    """Outputs (DO) that open and close the gripper, and inputs (DI) that show its end positions.

    * `stroke`: opening width, m.
    * `time`: maximum time for opening or closing, s. A gripper that has been closing for this time
      without being closed counts as holding an object.

    Raises ArgumentError if a value is invalid.
    """

    open_output: int
    close_output: int
    opened_input: int
    closed_input: int
    stroke: float = 0.05
    time: float = 2.0

    def __post_init__(self) -> None:
        for name in ('open_output', 'close_output', 'opened_input', 'closed_input'):
            _INDEX.argument(getattr(self, name), name)
        _STROKE_M.argument(self.stroke, 'stroke')
        _TIME_S.argument(self.time, 'time')
        for one, other in (('open_output', 'close_output'), ('opened_input', 'closed_input')):
            if getattr(self, one) == getattr(self, other):
                text = f'{one} = {other} = {getattr(self, one)}: must be different'
                raise ArgumentError(text)


@dataclass(frozen=True, slots=True)
class GripperState:
    """State of a gripper's two inputs. If both are False, the gripper moves or holds an object."""

    opened: bool
    closed: bool

    def position(self, stroke: float) -> float:
        """Return the opening width, m: `stroke` if opened, 0 if closed, else half of `stroke`."""
        return stroke if self.opened else 0.0 if self.closed else stroke / 2
