# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller profile: the properties in which kinds of controllers differ, as data.

`load_controller_profile` reads it from config/controllers/NAME.yaml. The sections and keys of the
file have the names of the fields here. profile_rules.py lists the allowed values.
"""

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from epson_driver.inputs import InputError, near_names, printable, read_yaml, shown
from epson_driver.profiles.io_profile import IoProfile, read_io_profile
from epson_driver.profiles.profile_rules import RULES, FieldsUsed, checked
from epson_driver.share import share_path
from epson_driver.simple_message import ByteOrder, Mode


@dataclass(frozen=True, slots=True)
class PortsProfile:
    """TCP ports of the controller.

    `remote` is the port of Remote Ethernet, or 0 if a driver cannot use it.
    """

    motion: int
    state: int
    io: int
    remote: int


@dataclass(frozen=True, slots=True)
class MotionProfile:
    """Motion of the simulated arm.

    * `speed`, `accel`: fractions (0, 1] of the robot's limits, for point-to-point motion.
    * `power`: motor power that the program sets at the start of a trajectory.
    * `cp`: whether a point-to-point move blends into the next one, if that arrives in time.
    * `statement_overhead`: time before each point-to-point move, s.
    * `look_ahead`, `look_ahead_points`: maximum duration, s, and maximum number of the points
      ahead of the arm. Smooth motion accepts a further point below both.
    * `pending_limit`: maximum number of received points that wait to be accepted.
    """

    speed: float
    accel: float
    power: Literal['high', 'low']
    cp: bool
    statement_overhead: float
    look_ahead: float
    look_ahead_points: int
    pending_limit: int


@dataclass(frozen=True, slots=True)
class ServoProfile:
    """Response of the simulated joints to commanded positions.

    `lag`: delay, s (0: none). `encoder`: whether positions are reported in whole encoder pulses.
    """

    lag: float
    encoder: bool


@dataclass(frozen=True, slots=True)
class DownloadProfile:
    """Handling of trajectories that are downloaded as a whole before the arm moves.

    `buffer`: maximum number of points. `overflow`: whether a trajectory with more points is
    refused, or its further points are dropped. `dead_time`: time that the program needs for each
    point, s.
    """

    buffer: int
    overflow: Literal['refuse', 'drop']
    dead_time: float


@dataclass(frozen=True, slots=True)
class ProgramProfile:
    """The program that serves the motion port: accepted messages, replies, and driver defaults.

    * `kind`: 'points': JOINT_TRAJ_PT messages. 'motoman': Motoman's messages.
    * `interface`: default trajectory interface of a driver. 'statements': SPEL+ statements by
      Remote Ethernet, for a controller without a loaded program, which serves only that port.
      'rtmc': Real-time Motion Control, also without a program.
    * `reply`: 'sequence': a JOINT_POSITION with the request's sequence number. 'header': only a
      header of the request's type.
    * `acknowledge`: when a streamed point is answered. 'taken': once it is accepted. 'default':
      when the arm reaches it in point-to-point motion, and once it is accepted in smooth motion.
    * `check_sequence`, `check_limits`: whether a point with a wrong sequence number, or outside
      the limits, is refused. Otherwise the motion ends with error 4001 when it reaches a point
      outside the limits.
    * `uses`: which of a point's velocity and duration are used: one, both or none.
    * `exact_times`: whether close points of a smooth motion are executed at their times. The
      driver then sends a point wherever the jerk of a joint move changes.
    * `late_failure`: whether a point outside the limits is answered with SUCCESS, then with
      FAILURE, and the connection is closed. The arm finishes the earlier points.
    * `accepts`: which messages are points. 'exact': a JOINT_TRAJ_PT of its exact length. 'longer':
      also a longer JOINT_TRAJ_PT, and STOP may be sent as a topic. 'any': a message of any type
      that is long enough for the joints. Shorter messages are not answered.
    * `special_sequences`: accepted negative sequence numbers. 'all', or 'stop': only STOP. A
      message with any other negative number is not answered.
    * `skip_first`: maximum distance of each joint from the arm's position, rad or m, at which the
      first point is skipped (0: never).
    * `motors`: how a driver switches the motors and resets errors. 'none': not at all.
      'remote_ethernet': by Remote Ethernet, if its port is configured. 'restart': also by Remote
      Ethernet, but the driver stops main before and starts main afterwards. 'motoman': by
      Motoman's commands. 'rtmc': by Real-time Motion Control.
    * `smoothing`, `resample_period` (s), `thin_deviation` (rad, m): defaults of a driver's
      parameters with these names, which select the points of a trajectory to send.
    * `setpoint_period`: default of a driver's parameter `servo.period`, the time between the
      points that it sends while it follows a stream, s.
    """

    kind: Literal['points', 'motoman']
    interface: Literal['streaming', 'download', 'statements', 'rtmc']
    reply: Literal['sequence', 'header']
    acknowledge: Literal['default', 'taken']
    check_sequence: bool
    check_limits: bool
    uses: FieldsUsed
    exact_times: bool
    late_failure: bool
    accepts: Literal['exact', 'longer', 'any']
    special_sequences: Literal['all', 'stop']
    skip_first: float
    motors: Literal['none', 'remote_ethernet', 'restart', 'motoman', 'rtmc']
    smoothing: Literal['none', 'resample', 'thin']
    resample_period: float
    thin_deviation: float
    setpoint_period: float
    download: DownloadProfile

    @property
    def loaded(self) -> bool:
        """Whether the controller runs a loaded program, which serves the motion port."""
        return self.interface not in ('statements', 'rtmc')

    @property
    def point_message(self) -> Literal['joint_traj_pt', 'joint_traj_pt_full']:
        return 'joint_traj_pt_full' if self.kind == 'motoman' else 'joint_traj_pt'


@dataclass(frozen=True, slots=True)
class StateProfile:
    """Messages on the state port: one per slot of `period` s.

    * `joint_positions_per_status`: number of joint messages after which a STATUS follows.
    * `status_with_joints`: whether the STATUS is sent together with the last of these joint
      messages. Otherwise it is sent in the next slot.
    * `status_at_rest`: whether a STATUS is also sent in the first slot after the arm has come to
      rest.
    * `message`: type of the joint messages.
    * `feedback_time`: whether a JOINT_FEEDBACK contains the controller's time.
    * `errors`: which errors are reported. 'alarms': only errors that need a reset, so neither
      rejected requests nor the E-stop.
    """

    period: float
    joint_positions_per_status: int
    status_with_joints: bool
    status_at_rest: bool
    message: Literal['joint_position', 'joint_feedback']
    feedback_time: bool
    errors: Literal['all', 'alarms']


@dataclass(frozen=True, slots=True)
class ServerProfile:
    """Handling of clients at the controller's ports.

    `lost_client` is the reaction of the arm to a lost motion client. 'brake': it brakes and the
    motors are switched off. 'finish': it finishes its points, motors on. 'keep': it stops with the
    motors on, keeps its points, and resumes when the next client connects.

    `client_timeout`: the arm stops when a motion client that sends heartbeats is silent for this
    time, s. 0: the controller does not check the client, and a driver sends no heartbeats.

    `full` is the reaction to a motion or state client beyond the maximum: 'refuse' it, or
    'replace' the first client, unless the arm has points left. `state_clients` and `io_clients`
    are the maximum numbers of simultaneous clients.
    """

    lost_client: Literal['brake', 'finish', 'keep']
    client_timeout: float
    full: Literal['refuse', 'replace']
    state_clients: int
    io_clients: int


@dataclass(frozen=True, slots=True)
class RemoteProfile:
    """The Remote Ethernet port.

    `session_timeout`: time without a command after which a client is disconnected, s (0: never).
    `password`: any password is accepted if this one is empty. `clients`: maximum number of
    simultaneous logins.
    """

    session_timeout: float
    password: str
    clients: int


@dataclass(frozen=True, slots=True)
class RtmcProfile:
    """Real-time Motion Control of an RC800.

    `port`: UDP port at which a driver discovers the controller (0: not available). `cycle`: time
    between two targets, s.
    """

    port: int
    password: str
    cycle: float


@dataclass(frozen=True, slots=True)
class SpelProfile:
    """The SPEL+ project that the simulation runs instead of a built-in program.

    `project`: a folder of this package, an absolute path, or '' for the built-in program.
    `config`: the user's changes to the project's #define lines. An empty value turns a definition
    off.
    """

    project: str
    config: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class ControllerProfile:
    """Profile of one kind of controller.

    `approximate`: the profile's known approximations, as sentences. `error_texts`: name of a file
    in config/errors.
    """

    name: str
    description: str
    approximate: tuple[str, ...]
    byte_order: ByteOrder
    mode: Mode
    error_texts: str
    ports: PortsProfile
    motion: MotionProfile
    servo: ServoProfile
    program: ProgramProfile
    state: StateProfile
    server: ServerProfile
    spel: SpelProfile
    io: IoProfile
    remote: RemoteProfile
    rtmc: RtmcProfile

    @property
    def motion_port(self) -> int:
        """The TCP port of the motion server, or the UDP port of Real-time Motion Control."""
        return self.rtmc.port if self.program.interface == 'rtmc' else self.ports.motion


ALIKE = dict.fromkeys(('rc700', 'rc700a', 'rc90', 'rc90b', 'rc800', 't', 'vt'), 'spel')
"""EPSON's controllers, which use the profile of this package's program."""

OLD_NAMES = {'rc620': 'simulated'}

_log = logging.getLogger(__name__)


def load_controller_profile(name: str) -> ControllerProfile:
    """Read config/controllers/NAME.yaml, or the file itself if `name` is a path to a .yaml file.

    EPSON's spelling (RC700-A) and the controllers in ALIKE are also accepted. A profile with
    `like: OTHER` contains only its differences from OTHER, which is the name of a profile or of a
    .yaml file in the same folder. Raises InputError if a profile is invalid or unknown. The error
    text lists names that are similar to an unknown one.
    """
    path = _path(name, Path())
    values = checked(_read(path), printable(path))
    download = DownloadProfile(**values['program'].pop('download'))
    return ControllerProfile(
        ports=PortsProfile(**values.pop('ports')),
        motion=MotionProfile(**values.pop('motion')),
        servo=ServoProfile(**values.pop('servo')),
        program=ProgramProfile(download=download, **values.pop('program')),
        state=StateProfile(**values.pop('state')),
        server=ServerProfile(**values.pop('server')),
        spel=SpelProfile(**values.pop('spel')),
        io=read_io_profile(values.pop('io'), printable(path)),
        remote=RemoteProfile(**values.pop('remote')),
        rtmc=RtmcProfile(**values.pop('rtmc')),
        **values,
    )


def _path(name: str, folder: Path) -> Path:
    if name.endswith('.yaml'):
        return folder / name
    plain = name.lower().replace('-', '')
    plain = ALIKE.get(plain, plain)
    if (new := OLD_NAMES.get(plain)) is not None:
        _log.warning(
            'profile %s is now named %s (the built-in simulation). For an RC620 with the program '
            'of this package, use spel',
            plain,
            new,
        )
        plain = new
    known = {path.stem: path for path in share_path('config', 'controllers').glob('*.yaml')}
    if plain not in known:
        names = near_names(name, sorted({*known, *ALIKE}))
        raise InputError(f'no controller profile {printable(name)}: must be {", ".join(names)}')
    return known[plain]


def _read(path: Path) -> dict[str, Any]:
    """Return the settings in the file.

    Settings that are missing in the file come from the profile that its key `like` names.
    """
    layers: list[dict[str, Any]] = []
    read: list[str] = []
    like: str | None = None
    while True:
        data = read_yaml(path)
        file = printable(path)
        real_path = os.path.realpath(path)
        if real_path in read:
            raise InputError(f'{file}: like = {shown(like)}: must not refer back to this file')
        if not isinstance(data, dict):
            raise InputError(f'{file}: the file = {shown(data)}: must be a mapping')
        read.append(real_path)
        layers.append(data)
        like = data.pop('like', None)
        if like is None:
            break
        if not isinstance(like, str):
            raise InputError(f'{file}: like = {shown(like)}: must be the name of a profile')
        for key in ('name', 'description'):
            if key not in data:
                raise InputError(f'{file}: {key} is missing')
        path = _path(like, path.parent)
    merged: dict[str, Any] = {}
    for layer in reversed(layers):
        merged = _merged(merged, layer)
    return merged


def _merged(base: dict[str, Any], over: dict[str, Any], place: str = '') -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        base_value = base.get(key)
        section = f'{place}{key}.'
        if isinstance(base_value, dict) and isinstance(value, dict) and section in _SECTIONS:
            merged[key] = _merged(base_value, value, section)
        else:
            merged[key] = value
    return merged


_SECTIONS = {key[: key.rindex('.') + 1] for key in RULES if '.' in key} | {'io.'}
