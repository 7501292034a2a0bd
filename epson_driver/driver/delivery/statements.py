# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions as SPEL+ statements, for a controller without a program: Go, Move, Arc3 by `$Execute`.

The controller plans the motion: it accepts a target and a speed, but no times along the path.
Plans of several points and streams are therefore refused. The error text names the alternatives.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.driver.delivery.delivery import Delivery, DeliveryRules, PreparedTrajectory
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.link.replies import Statement
from epson_driver.motion import Array, JointLimits, Trajectory

TOOL_NUMBER = 15
"""Number of the controller's tool that TLSet sets for motions of a tool."""

AT_START = 0.02
"""Distance from the arm, rad or m, within which a first point is not a waypoint."""

MOST_CHARACTERS = 4060
"""Maximum length of the text of one `$Execute` (RC+ 7.0 user's guide)."""

NO_PLANS = (
    'a plan of {} points: by Remote Ethernet alone the controller takes no points and times: send '
    'its last point alone, or motion primitives (move_joints, move_line, move_arc in Python), or '
    'load the controller program'
)

FIXED_SPEED = (
    'by Remote Ethernet alone the controller takes no other speed while it moves, and no pause: '
    'give each motion its speed, or stop it'
)

ToolFrame = tuple[float, float, float, float, float, float]
"""A tool frame in the flange, as in TLSet: x, y, z in mm, u, v, w in degrees."""


@dataclass(frozen=True)
class PathSpeed:
    """Speed and acceleration of the tool, m/s, m/s², and of its rotation, rad/s, rad/s²."""

    speed: float
    acceleration: float
    turn_speed: float = 1.0
    turn_acceleration: float = 10.0


@dataclass(frozen=True)
class Load:
    """Payload: mass, kg, inertia about the flange axis, kg m², and distance from that axis, m."""

    mass: float
    inertia: float = 0.0
    eccentricity: float = 0.0

    @property
    def text(self) -> str:
        """Return the payload as statements."""
        return (
            f'Weight {self.mass:.4g}; Inertia {self.inertia:.4g}, {self.eccentricity * 1e3:.4g}; '
        )


class Moves:
    """Creates statements for joints within limits, in the controller's joint convention.

    Targets are joint positions, shape (n,), rad (m), in the ROS convention. They also define the
    arm's configuration.
    """

    def __init__(self, limits: JointLimits, mapping: JointMapping, power: str) -> None:
        self._limits = limits
        self._mapping = mapping
        self._power = f'Power {power.capitalize()}'
        self.load: Load | None = None
        """Payload set with each motion. None: the controller's own setting."""

    def joints(self, target: Array, speed: float, acceleration: float) -> Statement:
        """Return a joint move. speed, acceleration: fractions of the controller's, (0, 1]."""
        percent, ramp = _percent(speed), _percent(acceleration)
        text = f'Speed {percent}; Accel {ramp}, {ramp}; Go {self._point(target)}'
        return Statement(f'{self._settings}; {text}')

    def line(
        self, target: Array, speeds: PathSpeed, *, tool: ToolFrame | None, turns: bool = False
    ) -> Statement:
        """Return a line of the flange or a tool. turns: only the orientation changes."""
        return self._path(f'Move {self._point(target)}{" ROT" if turns else ""}', speeds, tool)

    def arc(
        self, via: Array, target: Array, speeds: PathSpeed, *, tool: ToolFrame | None
    ) -> Statement:
        """Return a circular arc through `via`, of the flange or a tool."""
        return self._path(f'Arc3 {self._point(via)}, {self._point(target)}', speeds, tool)

    @property
    def _settings(self) -> str:
        return f'{"" if self.load is None else self.load.text}{self._power}'

    def _path(self, text: str, speeds: PathSpeed, tool: ToolFrame | None) -> Statement:
        chosen = 'Tool 0'
        if tool is not None:
            frame = ', '.join(f'{value:.4f}' for value in tool)
            chosen = f'TLSet {TOOL_NUMBER}, XY({frame}); Tool {TOOL_NUMBER}'
        given = (
            f'SpeedS {speeds.speed * 1e3:.4g}; AccelS {speeds.acceleration * 1e3:.4g}; '
            f'SpeedR {np.degrees(speeds.turn_speed):.4g}; '
            f'AccelR {np.degrees(speeds.turn_acceleration):.4g}'
        )
        return Statement(f'{self._settings}; {given}; {chosen}; {text}')

    def _point(self, joints: Array) -> str:
        counted = self._mapping.positions_to_controller(joints)
        scales = [np.degrees(1.0) if unit == 'rad' else 1e3 for unit in self._limits.units]
        return f'JA({", ".join(f"{value:.5f}" for value in counted * scales)})'


def last_point(trajectory: Trajectory) -> Trajectory:
    """Return the last point of a trajectory, because one statement reaches only one point."""
    return Trajectory(trajectory.joint_names, trajectory.times[-1:], trajectory.positions[-1:])


class StatementDelivery(Delivery):
    """A trajectory directly to its end as `Go`. Only the power in `rules` is used."""

    no_streams = (
        'by Remote Ethernet alone the arm follows no streams: each statement begins and ends at '
        'rest; send motions one by one, or load the controller program'
    )

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, rules)
        self.moves = Moves(limits, mapping, rules.power)

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return a joint move to the last point, no faster than its time requires.

        Earlier points may only be at the arm's position. Raises GoalRejectedError if one is not.
        """
        if np.any(np.abs(trajectory.positions[:-1] - start) > AT_START):
            text = NO_PLANS.format(len(trajectory.times))
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, text)
        target, duration = trajectory.positions[-1], max(trajectory.duration, 1e-3)
        needed = float(np.max(np.abs(target - start) / self._limits.velocity)) / duration
        share = min(max(needed, self._rules.slowest), 1.0)
        move = self.moves.joints(target, share, share)
        return PreparedTrajectory(last_point(trajectory), [move])


def _percent(share: float) -> int:
    return min(max(round(share * 100), 1), 100)
