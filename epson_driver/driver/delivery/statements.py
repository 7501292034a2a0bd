# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions as SPEL+ statements, for a controller without a program.

The statements Go, Move and Arc3 are sent by the `$Execute` command of Remote Ethernet. The
controller plans the motion. It accepts a target and a speed, but no times along the path.
Therefore setpoint streams and plans of several points are rejected, with a text that names
alternatives, except for a plan along a straight line of the tool.
"""

from dataclasses import dataclass
from math import inf

import numpy as np

from epson_driver.driver.delivery.delivery import (
    Delivery,
    DeliveryRules,
    OnReply,
    PreparedTrajectory,
)
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link.remote_link import RemoteLink
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.robots.kinematics import Kinematics, uvw
from epson_driver.simple_message import Message, ReplyCode, reply
from epson_driver.tool_motion.pose_path import SHORTEST_PATH, line
from epson_driver.tool_motion.tool_trajectory import ToolLimits

TOOL_NUMBER = 15  # number of the controller's tool that is set (TLSet) for lines and arcs
SAME_M = 1e-6  # tool displacement below which a line is a pure rotation, m
MAX_COMPARED = 2000  # planned positions compared with the via point of an arc
AT_START = 0.02  # maximum distance of all points except the last from the arm's position, rad or m
STRAIGHT_M, STRAIGHT_RAD = 1e-4, 1e-3  # maximum deviation of tool 0 from a straight line
STRAIGHT_STEP = 0.1  # maximum distance of a joint between two points of a straight line, rad or m
MAX_CHARACTERS = 4060  # maximum length of the text of one `$Execute` (RC+ 7.0 user's guide)

NO_TIMES = 'over Remote Ethernet alone the controller accepts no points and times'
NO_PLANS = (
    f'a plan of {{}} points: {NO_TIMES}. '
    'Send only its last point, a straight line of tool0, or motion primitives (move_joints, '
    'move_line, move_arc in Python), or load the controller program'
)

FIXED_SPEED = (
    'over Remote Ethernet alone the controller cannot change the speed during a motion, or pause: '
    'set the speed of each motion, or stop it'
)


@dataclass(frozen=True, slots=True)
class Statement(Message):
    """SPEL+ statements for `$Execute`. The reply arrives when their motion is over."""

    text: str
    duration: float = inf  # expected time until the reply, s: unknown


@dataclass(frozen=True, slots=True)
class StatementReply(Message):
    """The reply to a Statement or to `$Abort`. `why`: the reason why it failed, or ''."""

    why: str = ''


@dataclass(frozen=True)
class Load:
    """Payload: mass, kg, inertia about the flange axis, kg m², and offset from that axis, m."""

    mass: float
    inertia: float = 0.0
    eccentricity: float = 0.0

    @property
    def text(self) -> str:
        return (
            f'Weight {self.mass:.4g}; Inertia {self.inertia:.4g}, {self.eccentricity * 1e3:.4g}; '
        )


def last_point(trajectory: Trajectory) -> Trajectory:
    return Trajectory(trajectory.joint_names, trajectory.times[-1:], trajectory.positions[-1:])


class StatementDelivery(Delivery):
    """Motions as SPEL+ statements. A trajectory becomes one `Go` or `Move` to its last point.

    Of the DeliveryRules, only `power` and `slowest` are used. A target is an array of joint
    positions in the ROS convention, shape (n,), rad or m, so it also determines the arm's posture.
    """

    no_plans = NO_TIMES
    no_streams = (
        'over Remote Ethernet alone the arm follows no streams, because it stops after each '
        'statement: send single motions, or load the controller program'
    )

    def __init__(
        self, link: RemoteLink, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, rules)
        self._remote = link
        self._load: Load | None = None
        self.arm: Kinematics | None = None  # for detecting straight lines; None: none is detected

    def set_load(self, load: Load | None) -> None:
        """Set the payload that each motion sets. None: the controller's payload applies."""
        self._load = load

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return one joint move to the last point, or one line if tool 0 moves on a line.

        The speed of a joint move is the plan's mean speed, rounded to at least 1 % (SPEL+
        `Speed`).
        """
        whole = np.vstack([start, trajectory.positions])
        target, duration = whole[-1], max(trajectory.duration, 1e-3)
        if np.any(np.abs(whole[1:-1] - start) > AT_START):
            speeds = None if self.arm is None else _straight(self.arm, whole, duration)
            if self.arm is None or speeds is None:
                text = NO_PLANS.format(len(trajectory.times))
                raise GoalRejectedError(ErrorCode.INVALID_GOAL, text)
            text = self.path(self.arm, np.eye(4), whole, speeds)
        else:
            needed = float(np.max(np.abs(target - start) / self._limits.velocity)) / duration
            fraction = min(max(needed, self._rules.slowest), 1.0)
            text = self.joints(target, fraction, fraction)
        return PreparedTrajectory(last_point(trajectory), [Statement(text)])

    def post(self, message: Message, on_reply: OnReply) -> None:
        def on_answer(value: str | Exception) -> None:
            if isinstance(value, ConnectionError):
                return  # the link reports its end
            why = ''
            if isinstance(value, RemoteError):
                why = f'{value.meaning} (error {value.number})'
            code = ReplyCode.FAILURE if why else ReplyCode.SUCCESS
            on_reply(reply(StatementReply(why), code), self._remote.last_received)

        if isinstance(message, Statement):
            self._remote.move(message.text, on_answer)
        else:
            self._remote.abort(on_answer)

    def joints(self, target: Array, speed: float, acceleration: float) -> str:
        """Return the statements of a joint move. `speed`, `acceleration`: fractions (0, 1]."""
        percent, ramp = _percent(speed), _percent(acceleration)
        text = f'Speed {percent}; Accel {ramp}, {ramp}; Go {self._point(target)}'
        return f'{self._settings}; {text}'

    def path(
        self,
        arm: Kinematics,
        tool: Array,
        positions: Array,
        limits: ToolLimits,
        via: Array | None = None,
    ) -> str:
        """Return the statements of a line, or of a circular arc through `via`, shape (3,), m.

        `tool`: pose of the tool in the flange frame, shape (4, 4), m. `positions`: planned joint
        positions from start to end, shape (k, n), rad or m.
        """
        target = self._point(positions[-1])
        if via is None:
            start, end = (arm.forward(row)[:3, 3] for row in positions[[0, -1]])
            text = f'Move {target}{" ROT" if np.linalg.norm(end - start) < SAME_M else ""}'
        else:
            text = f'Arc3 {self._point(_passing(arm, positions, via))}, {target}'
        speeds = (
            f'SpeedS {limits.speed * 1e3:.4g}; AccelS {limits.acceleration * 1e3:.4g}; '
            f'SpeedR {np.degrees(limits.turn_speed):.4g}; '
            f'AccelR {np.degrees(limits.turn_acceleration):.4g}'
        )
        return f'{self._settings}; {speeds}; {_tool(tool)}; {text}'

    @property
    def _settings(self) -> str:
        power = f'Power {self._rules.power.capitalize()}'
        return f'{"" if self._load is None else self._load.text}{power}'

    def _point(self, joints: Array) -> str:
        values = self._mapping.positions_to_controller(joints)
        scales = [np.degrees(1.0) if unit == 'rad' else 1e3 for unit in self._limits.units]
        return f'JA({", ".join(f"{value:.5f}" for value in values * scales)})'


def _straight(arm: Kinematics, positions: Array, duration: float) -> ToolLimits | None:
    """Return the speeds of a plan along a straight line of tool 0, or None for any other plan.

    positions: from start to end, shape (k, n), rad or m. duration: duration of the plan, s.
    """
    poses = [arm.forward(row) for row in positions]
    path = line(poses[0], poses[-1])
    turns = path.length < SHORTEST_PATH
    size = path.angle if turns else path.length
    if size < SHORTEST_PATH or np.abs(np.diff(positions, axis=0)).max() > STRAIGHT_STEP:
        return None
    moved = [line(poses[0], pose) for pose in poses]
    fractions = np.array([part.angle if turns else part.length for part in moved]) / size
    for pose, fraction in zip(poses, fractions.tolist(), strict=True):
        off = line(path.pose(fraction), pose)
        if off.length > STRAIGHT_M or off.angle > STRAIGHT_RAD:
            return None
    if np.diff(fractions).min() * size < -(STRAIGHT_RAD if turns else STRAIGHT_M):  # it turns back
        return None
    usual, ramp = ToolLimits(), 4.0 / duration
    speed = usual.speed if turns else max(path.length / duration, 1e-4)
    turn_speed = max(path.angle / duration, 2e-3)
    return ToolLimits(speed, speed * ramp, turn_speed, turn_speed * ramp)


def _percent(fraction: float) -> int:
    return min(max(round(fraction * 100), 1), 100)


def _passing(arm: Kinematics, positions: Array, via: Array) -> Array:
    """Return joint positions that place the tool at the position `via`.

    `positions`: planned joint positions, shape (k, n). The tool's orientation is taken from the
    planned position that is nearest to `via`. If the arm cannot reach `via`, this planned position
    is returned.
    """
    positions = positions[:: len(positions) // MAX_COMPARED + 1]
    poses = [arm.forward(row) for row in positions]
    nearest = int(np.argmin([np.linalg.norm(pose[:3, 3] - via) for pose in poses]))
    pose = poses[nearest].copy()
    pose[:3, 3] = via
    result = arm.inverse(pose, positions[nearest])
    return np.asarray(result[0] if len(result) else positions[nearest])


def _tool(pose: Array) -> str:
    """Return the statements that select a tool, with its `pose` in the flange frame, (4, 4), m."""
    if np.allclose(pose, np.eye(4), atol=1e-9):
        return 'Tool 0'
    frame = [*(pose[:3, 3] * 1e3), *np.degrees(uvw(pose[:3, :3]))]
    values = ', '.join(f'{value:.4f}' for value in frame)
    return f'TLSet {TOOL_NUMBER}, XY({values}); Tool {TOOL_NUMBER}'
