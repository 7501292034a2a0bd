# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller profile: what one kind of controller does differently, as data.

It is read from config/controllers/NAME.yaml by `load_controller_profile`. The sections and keys of
the file have the names of the sections and fields here; what each may hold is in
profile_rules.py.
"""

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from epson_driver.inputs import InputError, printable, read_yaml, shown
from epson_driver.profiles.io_profile import IoProfile, read_io_profile
from epson_driver.profiles.profile_rules import (
    LOOK_AHEAD_S,
    RULES,
    FieldsUsed,
    checked,
)
from epson_driver.share import share_file
from epson_driver.simple_message import ByteOrder, Mode

__all__ = [
    'LOOK_AHEAD_S',
    'ControllerProfile',
    'DownloadProfile',
    'IoProfile',
    'MotionProfile',
    'PortsProfile',
    'ProgramProfile',
    'RemoteProfile',
    'ServerProfile',
    'ServoProfile',
    'SpelProfile',
    'StateProfile',
    'load_controller_profile',
]


@dataclass(frozen=True, slots=True)
class PortsProfile:
    """TCP ports of the servers. `remote` 0: the real controller has none for the driver."""

    motion: int
    state: int
    io: int
    remote: int


@dataclass(frozen=True, slots=True)
class MotionProfile:
    """How the arm is moved.

    `speed` and `accel` are fractions (0, 1] of the robot's limits, for point-to-point motion.
    `power` is what the program sets when a trajectory begins. `cp`: point-to-point moves blend
    into the next one if that is known in time. `statement_overhead` s pass before each move. In
    smooth motion points are taken while less than `look_ahead` s and fewer than
    `look_ahead_points` are ahead; at most `pending_limit` points wait.
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
    """How the real joints follow the commanded ones.

    They come `lag` s later, 0 for at once; `encoder`: what is reported are whole pulses.
    """

    lag: float
    encoder: bool


@dataclass(frozen=True, slots=True)
class DownloadProfile:
    """How a trajectory is taken that comes as a whole, before the arm moves.

    At most `buffer` points are kept; with more, `overflow` refuses all or drops those beyond. The
    program spends `dead_time` s on each.
    """

    buffer: int
    overflow: Literal['refuse', 'drop']
    dead_time: float


@dataclass(frozen=True, slots=True)
class ProgramProfile:
    """The program on the motion port: which messages it takes, and how it answers.

    * `kind`: JOINT_TRAJ_PT ('points'), or Motoman's messages.
    * `interface`: how a driver hands trajectories over unless it is told otherwise; 'statements':
      by Remote Ethernet, as no program is loaded, and no port but that one is served.
    * `reply`: JOINT_POSITION with the request's sequence, or only a header of the request's type.
    * `acknowledge`: when a streamed point is answered: when the arm has taken it, when it is
      there ('done'), or 'default': done point to point, taken in smooth motion.
    * `check_sequence`, `check_limits`: whether a point is refused for them. A point outside the
      limits that is not refused ends the motion with error 4001 when its turn comes.
    * `uses`: which of a point's velocity and duration count.
    * `late_failure`: a point outside the limits is answered with SUCCESS, then with FAILURE too,
      and the connection is closed; the arm finishes the points before it.
    * `accepts`: which messages are points: a JOINT_TRAJ_PT of its exact length ('exact'); one that
      may be longer ('longer'), whose STOP may be a topic, too; every message that is long enough
      for the joints ('any'), whatever its type, and shorter ones are not answered.
    * `special_sequences`: 'stop': only STOP is obeyed, the other negative ones are not answered.
    * `skip_first`: a first point so near to where the arm stands, rad or m, each joint, is left
      out; 0: none is.
    * `motors`: how a driver switches the motors and resets errors: not at all, by Remote Ethernet
      if it is given a port, by that but with main stopped before and started after ('restart'), or
      by Motoman's commands.
    * `smoothing`, `resample_period` (s), `thin_deviation` (rad, m): what a driver sends of a plan
      unless it is told otherwise, as its parameters of these names.
    * `setpoint_period`: time between two points that a driver makes of a stream, s, as its
      parameter `servo.period`.
    """

    kind: Literal['points', 'motoman']
    interface: Literal['streaming', 'download', 'statements']
    reply: Literal['sequence', 'header']
    acknowledge: Literal['default', 'taken', 'done']
    check_sequence: bool
    check_limits: bool
    uses: FieldsUsed
    late_failure: bool
    accepts: Literal['exact', 'longer', 'any']
    special_sequences: Literal['all', 'stop']
    skip_first: float
    motors: Literal['none', 'remote_ethernet', 'restart', 'motoman']
    smoothing: Literal['none', 'resample', 'thin']
    resample_period: float
    thin_deviation: float
    setpoint_period: float
    download: DownloadProfile

    @property
    def point_message(self) -> Literal['joint_traj_pt', 'joint_traj_pt_full']:
        """The message that carries a point, unless a driver is told otherwise."""
        return 'joint_traj_pt_full' if self.kind == 'motoman' else 'joint_traj_pt'


@dataclass(frozen=True, slots=True)
class StateProfile:
    """What the state port sends: one message per slot of `period` s.

    After `joint_positions_per_status` slots with the joints comes one with a STATUS, or it comes
    together with the last of them (`status_with_joints`). `in_motion`, `motion_possible`: whether
    the STATUS fills these fields; UNKNOWN otherwise. `feedback_time`: whether a JOINT_FEEDBACK
    carries the controller's time. `errors`: 'alarms': it shows the errors that
    need a reset, not what was rejected or an E-stop.
    """

    period: float
    joint_positions_per_status: int
    status_with_joints: bool
    message: Literal['joint_position', 'joint_feedback']
    feedback_time: bool
    in_motion: bool
    motion_possible: bool
    errors: Literal['all', 'alarms']


@dataclass(frozen=True, slots=True)
class ServerProfile:
    """How the ports treat their clients, of which they serve `…_clients` at once.

    `lost_client` is what the arm does when the motion client is gone: 'brake', and its motors go
    off; 'finish' the points it has, motors on; 'keep' them: it stands, motors on, and goes on when
    the next client connects.

    `client_timeout`: the arm stops when a motion client that sends heartbeats is silent for so
    long, s, and a driver sends them; 0: neither.

    `full` is what happens to a motion or state client too many: 'refuse' it, or let it 'replace'
    the one that came first, unless the arm has somewhere to go.
    """

    lost_client: Literal['brake', 'finish', 'keep']
    client_timeout: float
    full: Literal['refuse', 'replace']
    state_clients: int
    io_clients: int


@dataclass(frozen=True, slots=True)
class RemoteProfile:
    """The Remote Ethernet port. A session ends `session_timeout` s after the last word, 0: never.

    An empty `password`: any is taken. `clients`: how many may be logged in at once.
    """

    session_timeout: float
    password: str
    clients: int


@dataclass(frozen=True, slots=True)
class SpelProfile:
    """The SPEL+ project that the simulation runs instead of a built-in program.

    `project`: a folder of this package, or an absolute path; empty: none. `config`: what a person
    has changed in its #define lines; an empty value turns one off.
    """

    project: str
    config: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class ControllerProfile:
    """Data of one kind of controller.

    `approximate` holds sentences on what is only approximated. `error_texts` names the file of
    config/errors that its error numbers are in.
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


ALIKE = dict.fromkeys(('rc700', 'rc90', 'rc90b', 'rc800', 't', 'vt'), 'rc700a')
"""Controllers that do as another one, of which nothing else is known: name → profile."""

OLD_NAMES = {'rc620': 'simulated'}
"""Former names of profiles."""

_log = logging.getLogger(__name__)


def load_controller_profile(name: str) -> ControllerProfile:
    """Read config/controllers/NAME.yaml, or the file itself if `name` is a path to a .yaml file.

    Names are taken as EPSON writes them, too (RC700-A), and those of controllers that are ALIKE.

    A profile that says `like: OTHER` holds only what differs from that one: a name, or a .yaml
    file beside it. Raises FileNotFoundError (which lists the profiles there are) or InputError.
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
        **values,
    )


def _path(name: str, folder: Path) -> Path:
    if name.endswith('.yaml'):
        return folder / name
    plain = name.lower().replace('-', '')
    plain = ALIKE.get(plain, plain)
    if (new := OLD_NAMES.get(plain)) is not None:
        _log.warning(
            '%s is the old name of the profile %s, the built-in simulation; '
            'an RC620 with the program of this package has the profile spel',
            plain,
            new,
        )
        plain = new
    return share_file('config', 'controllers', plain + '.yaml')


def _read(path: Path) -> dict[str, Any]:
    """Return what the file says, over what the one says that it is like."""
    layers: list[dict[str, Any]] = []
    read: list[str] = []
    like: str | None = None
    while True:
        data = read_yaml(path)
        file = printable(path)
        real = os.path.realpath(path)
        if real in read:
            raise InputError(f'{file}: like = {shown(like)}: that one is like this one')
        if not isinstance(data, dict):
            raise InputError(f'{file}: the file = {shown(data)}: must be a mapping')
        read.append(real)
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
    """Return `base` with what `over` says, section by section."""
    merged = dict(base)
    for key, value in over.items():
        held = base.get(key)
        section = f'{place}{key}.'
        if isinstance(held, dict) and isinstance(value, dict) and section in _SECTIONS:
            merged[key] = _merged(held, value, section)
        else:
            merged[key] = value
    return merged


_SECTIONS = {key[: key.rindex('.') + 1] for key in RULES if '.' in key} | {'io.'}
