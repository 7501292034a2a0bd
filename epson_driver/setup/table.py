# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The settings as one table: name, default, description, range, unit, and when they may change.

The node's parameters and the `Settings` of the Python API are created from it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from epson_driver.driver.state.joint_mapping import OFFSETS, SIGNS
from epson_driver.inputs import HOST, JOINT_NAMES, Rule, choice, count, list_of, number

GOAL_TOLERANCE = {'rad': 0.01, 'm': 0.001}

JOINTS = [f'joint_{i}' for i in range(1, 7)]

PAIR = 2
_EACH_POINT = list_of(count(-1, 2**31 - 1))


def _pair(value: Any) -> list[int]:
    if not isinstance(value, list) or len(value) != PAIR:
        raise ValueError
    points: list[int] = _EACH_POINT.read(value)
    return points


POINT_PAIR = Rule(_pair, 'must be two whole numbers from -1 on')


def is_a(kind: type, text: str) -> Rule:
    """Return the rule for an instance of a class."""

    def read(value: Any) -> Any:
        if not isinstance(value, kind):
            raise TypeError
        return value

    return Rule(read, text)


_WORDS = {bool: 'True or False', str: 'text', list: 'a list'}

NAME_OR_FILE = is_a(str, 'must be a name, or the path of a file')


@dataclass(frozen=True)
class Row:
    """One setting, limited by `choices` or `low`…`high`. `now`: it may change at any time."""

    name: str
    default: Any
    about: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    now: bool = False
    rule: Rule | None = None
    """Additional check of the value at the start."""
    unit: str = ''
    """Appended to the description. 1 marks a ratio."""

    @property
    def description(self) -> str:
        """The description as a sentence, with the unit."""
        return f'{self.about[:-1]} [{self.unit}].' if self.unit else self.about

    @property
    def allowed(self) -> Rule:
        """The rule for the value."""
        if self.rule is not None:
            return self.rule
        if self.choices:
            return Rule(choice(*self.choices).read, f'must be one of {", ".join(self.choices)}')
        if self.low is None or self.high is None:
            kind = type(self.default)
            return is_a(kind, f'must be {_WORDS[kind]}')
        if isinstance(self.default, int):
            return count(int(self.low), int(self.high))
        return number(self.low, self.high, self.unit.replace(', ', ' or ').removeprefix('1'))


CONTROLLER = Row(
    'controller',
    'simulated',
    'Kind of controller: a file of config/controllers, or a path to one. Where other parameters '
    'are not set, it says which ports, which interface and which messages are used.',
    rule=NAME_OR_FILE,
)

ROBOT_MODEL = Row(
    'robot_model',
    'c3_a601s',
    'Robot model: a file of config/robots, or a path to one.',
    rule=NAME_OR_FILE,
)

TABLE = (
    CONTROLLER,
    Row('robot_ip', '127.0.0.1', 'Address of the robot controller.', rule=HOST),
    Row('motion_port', 11000, 'TCP port of its motion server.', 1, 65535),
    Row('state_port', 11002, 'TCP port of its state server.', 1, 65535),
    Row('io_port', 11003, 'TCP port of its I/O server; 0: not used.', 0, 65535),
    Row(
        'remote_port',
        0,
        'TCP port of its Remote Ethernet server (RC700-A: 5000), through which ~/enable, '
        '~/disable and ~/reset_error act on the motors, and, where the profile says so, the I/O '
        'is reached; 0: not used.',
        0,
        65535,
    ),
    Row(
        'joint_names',
        JOINTS,
        "Names of the joints in the controller's order. By default those of `robot_model`.",
        rule=JOINT_NAMES,
    ),
    Row(
        'frame_id',
        'base_link',
        'Frame of `joint_states`, as joint_state_broadcaster fills it; where links have a prefix, '
        'with that.',
    ),
    Row(
        'joint_signs',
        [1],
        'A joint is this, 1 or -1, times that of the controller, plus its offset: one number for '
        'all joints, or one for each.',
        rule=SIGNS,
    ),
    Row(
        'joint_offsets',
        [0.0],
        'Offsets of the joints: one for all, or one for each.',
        unit='rad, m',
        rule=OFFSETS,
    ),
    Row(
        'j23_factor',
        0,
        "What joint 3 has of the controller's joint 2 besides its own. FANUC: its J23_factor; "
        'ABB with coupled joints: -1.',
        -1,
        1,
    ),
    ROBOT_MODEL,
    Row(
        'error_texts',
        'epson',
        "What the controller's error numbers mean: a file of config/errors; none: not known.",
        rule=NAME_OR_FILE,
    ),
    Row(
        'interface',
        'streaming',
        'How trajectories reach the controller. streaming: point by point, each acknowledged; '
        'download: all of them before it moves, not acknowledged; statements: by Remote Ethernet '
        'alone, one goal of one point, or motion primitives.',
        choices=('streaming', 'download', 'statements'),
    ),
    Row(
        'point_message',
        'joint_traj_pt',
        'The message that carries a point: one speed and a duration, or time, positions and '
        'velocities.',
        choices=('joint_traj_pt', 'joint_traj_pt_full'),
    ),
    Row(
        'smoothing',
        'none',
        'What is sent of a trajectory. none: its own points, for a controller that smooths or '
        'goes from point to point; resample: points on the smooth motion through them; thin: of '
        'its own points those that are far enough apart, and others where there are too few.',
        choices=('none', 'resample', 'thin'),
    ),
    Row(
        'resample_period',
        0.05,
        'Time between two points of the smooth motion; with thin this to twice this.',
        0.004,
        1.0,
        unit='s',
    ),
    Row(
        'thin_deviation',
        0.01,
        'With smoothing thin: how far straight ways between its points may be from the smooth '
        'motion, each joint; less needs more points, at which the arm may be slower.',
        0.0001,
        1.0,
        unit='rad, m',
    ),
    Row(
        'smoothing_tolerance',
        0.0,
        'With smoothing: resample or thin: how far beside the points of a plan the motion may '
        'pass, each joint, 0.001 or more, so that the noise of a recording is left out; 0: '
        'through them.',
        0.0,
        0.5,
        unit='rad, m',
    ),
    Row(
        'timing',
        'as_planned',
        'When the points are to be reached. as_planned: as the trajectory says; time_optimal: as '
        'fast as the joint limits allow, whatever times it has, or none.',
        choices=('as_planned', 'time_optimal'),
    ),
    Row(
        'byte_order',
        'auto',
        "The controller's byte order; auto: as its state messages show.",
        choices=('auto', 'little', 'big'),
    ),
    Row(
        'state_timeout',
        1.0,
        'Silence on the state port after which the link is taken for lost.',
        0.05,
        60.0,
        unit='s',
    ),
    Row(
        'state_position_margin',
        0.1,
        'How far beyond its range a joint may be reported; farther is not believed, is not '
        'published and disables the arm.',
        0.0,
        10.0,
        unit='rad, m',
    ),
    Row(
        'state_velocity_margin',
        1.5,
        'How many times as fast as its limit a joint may be reported to move; faster is not '
        'believed, is not published and disables the arm.',
        1.0,
        100.0,
        unit='1',
    ),
    Row(
        'io_timeout',
        1.0,
        'Patience for the reply to an I/O request, and silence of the I/O port after which the '
        'values are taken for unknown.',
        0.05,
        60.0,
        unit='s',
        now=True,
    ),
    Row(
        'reply_timeout',
        5.0,
        'Patience for the reply to a point while the arm does not move, beyond the time that the '
        'plan takes to that point.',
        0.1,
        600.0,
        unit='s',
        now=True,
    ),
    Row(
        'start_tolerance',
        0.02,
        'How far from the measured position a trajectory may start, each joint.',
        0.0,
        1.0,
        unit='rad, m',
        now=True,
    ),
    Row(
        'require_planned_speed',
        True,
        'Reject trajectories and streams that the controller is known to execute faster than '
        'planned, because it ignores the times of points. False: execute them and warn.',
        now=True,
    ),
    Row(
        'allow_nonzero_velocity_at_trajectory_end',
        False,
        'Accept trajectories whose last point has a velocity. The arm comes to rest there anyway.',
        now=True,
    ),
    Row(
        'action_monitor_rate',
        20.0,
        'Rate of the action feedback and of ~/controller_state while a goal runs.',
        0.1,
        200.0,
        unit='Hz',
        now=True,
    ),
    Row(
        'servo.scale',
        0.25,
        "Share of the joints' limits of velocity, acceleration and jerk that streams of setpoints "
        'may use; it holds for the next stream.',
        0.01,
        1.0,
        unit='1',
        now=True,
    ),
    Row(
        'servo.timeout',
        0.1,
        'Silence of a stream of setpoints after which the arm ends at its last position, or '
        'brakes.',
        0.02,
        1.0,
        unit='s',
        now=True,
    ),
    Row(
        'servo.start_tolerance',
        0.1,
        'How far from the arm the first position of a stream of setpoints may be, each joint.',
        0.0,
        1.0,
        unit='rad, m',
        now=True,
    ),
    Row(
        'servo.catch_up',
        1.5,
        'How many times as fast as a stream of positions goes itself the arm may follow when it '
        'is behind, each joint, within `servo.scale`.',
        1.0,
        100.0,
        unit='1',
        now=True,
    ),
    Row(
        'servo.period',
        0.02,
        'Time between two points at least that a stream of setpoints becomes. A controller that '
        'takes long for each point follows better if there are fewer.',
        0.02,
        0.2,
        unit='s',
        now=True,
    ),
    Row(
        'trace_folder',
        '~/.ros/epson_driver',
        'Folder for `trace_file`, made when it is needed. Empty: there are no traces.',
    ),
    Row(
        'trace_file',
        '',
        'Name of a file in `trace_folder` to record what goes over the wire into, for Wireshark '
        'and `epson_driver report`; %Y%m%d-%H%M%S and the like are filled in; it must not exist '
        'yet. Empty: no trace.',
        now=True,
    ),
    Row(
        'trace_size',
        100.0,
        'Size at which a trace ends.',
        0.001,
        10000.0,
        unit='MB',
        now=True,
    ),
    Row(
        'gripper.outputs',
        [-1, -1],
        'Digital outputs that open and close a gripper, for ~/gripper_cmd; -1, -1: there is none.',
        rule=POINT_PAIR,
    ),
    Row(
        'gripper.inputs',
        [-1, -1],
        'Digital inputs that tell that it is open, and closed; -1, -1: there is none.',
        rule=POINT_PAIR,
    ),
    Row('gripper.stroke', 0.05, 'How far it opens.', 1e-4, 2.0, unit='m'),
    Row(
        'gripper.time',
        2.0,
        'After so long at most it is open, is closed, or holds something.',
        0.05,
        60.0,
        unit='s',
    ),
    Row(
        'tool.name',
        'tool',
        "Name of the tool's frame, which hangs on tool0 in tf; before it goes what `frame_id` has "
        'before base_link.',
    ),
    Row(
        'tool.pose',
        [*[0.0] * 6, 1.0],
        'The tool (TCP) at the start, which the poses of motion primitives are about, until '
        '~/set_tool sets another: x, y, z in tool0 and a quaternion x, y, z, w; 0, 0, 0, 0, 0, 0, '
        '1 is tool0 itself, and then tf has no frame of it.',
        unit='m',
    ),
    Row(
        'points_file',
        '',
        'The file of taught points, which is read at the start and written when one is taught or '
        "forgotten: RC+'s .pts, or .yaml. Empty: they are kept as long as the node lives.",
    ),
    Row(
        'constraints.stopped_velocity_tolerance',
        0.01,
        'Velocity below which a joint counts as standing.',
        1e-6,
        10.0,
        unit='rad/s, m/s',
        now=True,
    ),
    Row(
        'constraints.goal_time',
        0.0,
        'How much longer than planned a goal may take before it is aborted; 0: no limit.',
        0.0,
        3600.0,
        unit='s',
        now=True,
    ),
)


def joint_rows(joint: str, unit: str = 'rad') -> Iterator[Row]:
    """Yield the parameters of one joint, with the names of joint_trajectory_controller."""
    yield Row(
        f'constraints.{joint}.goal',
        GOAL_TOLERANCE[unit],
        f'How far {joint} may be from the end of the trajectory for success; 0: any.',
        0.0,
        10.0,
        now=True,
        unit=unit,
    )
    yield Row(
        f'constraints.{joint}.trajectory',
        0.0,
        f'How far {joint} may be from the plan at any moment on the way; 0: not checked.',
        0.0,
        10.0,
        now=True,
        unit=unit,
    )


EACH_JOINT = '<joint>'
"""Placeholder for each joint's name."""

ROWS = {row.name: row for row in (*TABLE, *joint_rows(EACH_JOINT))}
