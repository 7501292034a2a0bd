# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tolerances and patience that hold for every goal."""

from dataclasses import dataclass

from epson_driver.profiles.profile import StateProfile

CAUSE_TIMEOUT_S = 0.095
"""How long a rejected goal waits for the STATUS that says why, s. EPSON's comes every 55 ms."""

CAUSE_TIMEOUT_MARGIN_S = 0.04
"""What it waits beyond the time between two STATUS messages, s."""


@dataclass(frozen=True, slots=True)
class GoalSettings:
    """Tolerances and patience of a goal execution.

    stopped_velocity: rad/s, below which a joint counts as standing. reply_timeout: s without a
    reply and without the arm moving, beyond the planned duration of the point. cause_timeout: how
    long a rejected goal waits for the STATUS that says why, s. require_planned_speed: reject plans
    whose times the controller is known not to keep.
    """

    stopped_velocity: float = 0.01
    reply_timeout: float = 5.0
    cause_timeout: float = CAUSE_TIMEOUT_S
    require_planned_speed: bool = False


def cause_timeout(state: StateProfile) -> float:
    """Return how long to wait for a STATUS of a controller with this profile, s."""
    return state.period * (state.joint_positions_per_status + 1) + CAUSE_TIMEOUT_MARGIN_S
