# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How a gripper is wired, the state that its inputs show, and what it raises."""

from dataclasses import dataclass

from epson_driver.inputs import count, number

_INDEX = count(0, 2**31 - 1)
_STROKE_M = number(1e-4, 2.0, 'm')
_TIME_S = number(0.05, 60.0, 's')


class GripperError(RuntimeError):
    """The gripper did not do what was asked, as its text explains."""


@dataclass(frozen=True, kw_only=True)
class GripperWiring:
    """Which outputs (DO) open and close it, and which inputs (DI) tell that it is open or closed.

    stroke: how far it opens, m. time: after so many s at most it has opened, closed, or holds
    something. Raises ValueError for what cannot be.
    """

    open_output: int
    close_output: int
    opened_input: int
    closed_input: int
    stroke: float = 0.05
    time: float = 2.0

    def __post_init__(self) -> None:
        for name in ('open_output', 'close_output', 'opened_input', 'closed_input'):
            _INDEX.checked(getattr(self, name), name)
        _STROKE_M.checked(self.stroke, 'stroke')
        _TIME_S.checked(self.time, 'time')
        for one, other in (('open_output', 'close_output'), ('opened_input', 'closed_input')):
            if getattr(self, one) == getattr(self, other):
                raise ValueError(f'{one} = {other} = {getattr(self, one)}: must be different')


@dataclass(frozen=True, slots=True)
class GripperState:
    """The state that the inputs show. With neither it moves, or holds something."""

    opened: bool
    closed: bool

    def position(self, stroke: float) -> float:
        """Return its opening, m, half of the stroke where neither input shows one."""
        return stroke if self.opened else 0.0 if self.closed else stroke / 2
