# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoints, read from the messages that ROS sends streams in (docs/servo.md)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from control_msgs.msg import JointJog
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.servo.setpoint import Setpoint
from epson_driver.motion import Array
from epson_driver.node.trajectory_messages import duration_in_s

MAX_AHEAD_S = 0.5
"""A window that reaches further into the future is a trajectory, which is a goal's business, s."""

MAX_AGE_S = 0.5
"""One that ended longer ago is too old, or stamped by another clock, s."""


class SetpointError(ValueError):
    """A message that is no setpoint; the text says why."""


def from_trajectory(
    message: JointTrajectory, names: Sequence[str], source: str, now: float
) -> Setpoint:
    """Return the last point of a window, or a single point. `now`: the time of ROS, s.

    A window's last point lies ahead: that makes up for the tracker's lag, so its velocities are
    left out. Those of a single point count. Raises SetpointError.
    """
    last = message.points[-1]
    stamp = duration_in_s(message.header.stamp)
    ahead = duration_in_s(last.time_from_start) + (stamp - now if stamp else 0.0)
    if ahead > MAX_AHEAD_S:
        raise SetpointError(
            f'it ends in {ahead:.3g} s, more than {MAX_AHEAD_S:g} s: that is a trajectory, for '
            '~/joint_trajectory or the action (or the clocks differ)'
        )
    if ahead < -MAX_AGE_S:
        raise SetpointError(f'it ended {-ahead:.3g} s ago: it came late, or the clocks differ')
    positions = _values('positions', last.positions, message.joint_names, names)
    velocities = _values('velocities', last.velocities, message.joint_names, names)
    if positions is not None and len(message.points) > 1:
        velocities = None
    return _setpoint(source, positions, velocities)


def from_joint_state(message: JointState, names: Sequence[str], source: str) -> Setpoint:
    """Return positions, with their velocities if there are any, or velocities alone.

    Raises SetpointError.
    """
    return _setpoint(
        source,
        _values('position', message.position, message.name, names),
        _values('velocity', message.velocity, message.name, names),
    )


def from_positions(message: Float64MultiArray, names: Sequence[str], source: str) -> Setpoint:
    """Return positions in the controller's order. Raises SetpointError."""
    return _setpoint(source, _values('data', message.data, names, names), None)


def from_velocities(message: Float64MultiArray, names: Sequence[str], source: str) -> Setpoint:
    """Return velocities in the controller's order. Raises SetpointError."""
    return _setpoint(source, None, _values('data', message.data, names, names))


def from_jog(message: JointJog, names: Sequence[str], source: str) -> Setpoint:
    """Return the velocities of the joints that are named, 0 for the others.

    Raises SetpointError.
    """
    if message.displacements:
        raise SetpointError('displacements are not supported: use velocities')
    _check_names(message.joint_names, names, complete=False)
    if len(message.velocities) != len(message.joint_names):
        raise SetpointError(
            f'{len(message.velocities)} velocities for {len(message.joint_names)} joints'
        )
    velocities = np.zeros(len(names))
    for name, velocity in zip(message.joint_names, message.velocities, strict=True):
        velocities[list(names).index(name)] = velocity
    return _setpoint(source, None, velocities)


def _setpoint(source: str, positions: Array | None, velocities: Array | None) -> Setpoint:
    if positions is None and velocities is None:
        raise SetpointError('it has neither positions nor velocities')
    return Setpoint(source, positions, velocities)


def _values(
    field: str, values: Sequence[float], given: Sequence[str], names: Sequence[str]
) -> Array | None:
    """Return values in the order of `names`; None if there are none."""
    _check_names(given, names, complete=True)
    if not len(values):
        return None
    if len(values) != len(names):
        raise SetpointError(f'{len(values)} values in {field} for {len(names)} joints')
    order: Any = list(given)
    return np.array(values, dtype=float)[[order.index(name) for name in names]]


def _check_names(given: Sequence[str], names: Sequence[str], *, complete: bool) -> None:
    """Raise SetpointError for joints that are unknown, there twice, or missing."""
    for name in given:
        if name not in names:
            raise SetpointError(f'unknown joint {name!r}')
    if len(set(given)) != len(given):
        raise SetpointError('a joint is there twice')
    missing = [name for name in names if name not in given]
    if complete and missing:
        raise SetpointError(f'it lacks {", ".join(missing)}')
