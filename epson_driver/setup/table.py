# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The table of all settings: name, default, description, range, unit, and when it may change.

The node's parameters and the `Settings` of the Python API are created from it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from epson_driver.driver.state.joint_mapping import OFFSETS, SIGNS
from epson_driver.inputs import HOST, JOINT_NAMES, VARIABLE, Rule, choice, count, list_of, number

GOAL_TOLERANCE = {'rad': 0.01, 'm': 0.001}

JOINTS = [f'joint_{i}' for i in range(1, 7)]

PAIR = 2
_EACH_POINT = list_of(count(-1, 2**31 - 1))


def _pair(value: Any) -> list[int]:
    if not isinstance(value, list) or len(value) != PAIR:
        raise ValueError
    points: list[int] = _EACH_POINT.read(value)
    return points


POINT_PAIR = Rule(_pair, 'must be two whole numbers ≥ -1')


def is_a(kind: type, text: str) -> Rule:

    def read(value: Any) -> Any:
        if not isinstance(value, kind):
            raise TypeError
        return value

    return Rule(read, text)


_WORDS = {bool: 'True or False', str: 'text', list: 'a list'}

NAME_OR_FILE = is_a(str, 'must be a name or a path')


@dataclass(frozen=True)
class Row:
    """A setting. A valid value is one of `choices`, between `low` and `high`, or meets `rule`.

    `now`: whether the setting may change while the driver runs.
    """

    name: str
    default: Any
    about: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    now: bool = False
    rule: Rule | None = None
    unit: str = ''
    """Unit of the value, shown in the description. '1' stands for a ratio."""

    @property
    def description(self) -> str:
        return f'{self.about[:-1]} [{self.unit}].' if self.unit else self.about

    @property
    def allowed(self) -> Rule:
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
    'Controller profile: the name of a file in config/controllers, or a path. It sets the '
    'defaults of ports, interface and messages.',
    rule=NAME_OR_FILE,
)

ROBOT_MODEL = Row(
    'robot_model',
    'c3_a601s',
    'Robot model: the name of a file in config/robots, or a path.',
    rule=NAME_OR_FILE,
)

PLAN_SCALING = Row(
    'plan_scaling',
    True,
    'With timing time_optimal: the highest velocity and acceleration of the plan, as '
    'fractions of the limits, are maxima, so that a plan with low scaling factors stays slow. '
    'False: only the limits apply.',
)
"""The setting `plan_scaling`, which the driver and smooth_goals share."""

TABLE = (
    CONTROLLER,
    Row('robot_ip', '127.0.0.1', 'IP address or host name of the robot controller.', rule=HOST),
    Row('motion_port', 11000, 'TCP port of the motion server.', 1, 65535),
    Row('state_port', 11002, 'TCP port of the state server.', 1, 65535),
    Row('io_port', 11003, 'TCP port of the I/O server (0: not used).', 0, 65535),
    Row(
        'remote_port',
        0,
        'TCP port of the Remote Ethernet server (RC700-A: 5000; 0: not used). ~/enable, ~/disable '
        'and ~/reset_error use it, and with some profiles also the I/O.',
        0,
        65535,
    ),
    Row(
        'password_variable',
        '',
        'Environment variable that contains the Remote Ethernet password (empty: the password in '
        'the profile, usually none).',
        rule=VARIABLE,
    ),
    Row(
        'joint_names',
        JOINTS,
        "Joint names in the controller's order (default: from `robot_model`).",
        rule=JOINT_NAMES,
    ),
    Row(
        'frame_id',
        'base_link',
        'Frame of `joint_states`, including the prefix of the links if they have one.',
    ),
    Row(
        'joint_signs',
        [1],
        'Sign (1 or -1) applied to controller joints before adding `joint_offsets`: one for all '
        'joints, or one per joint.',
        rule=SIGNS,
    ),
    Row(
        'joint_offsets',
        [0.0],
        'Joint offsets: one for all joints, or one per joint.',
        unit='rad, m',
        rule=OFFSETS,
    ),
    Row(
        'j23_factor',
        0,
        'Coupling of joint 2 into joint 3 (FANUC: its J23_factor; ABB with coupled joints: -1).',
        -1,
        1,
    ),
    ROBOT_MODEL,
    Row(
        'error_texts',
        'epson',
        "Meanings of the controller's error numbers: the name of a file in config/errors, or a "
        'path (none: unknown).',
        rule=NAME_OR_FILE,
    ),
    Row(
        'interface',
        'streaming',
        'Transfer of trajectories. streaming: point by point, each acknowledged. download: all '
        'points before the motion, not acknowledged. statements: over Remote Ethernet only, '
        'goals of one point or motion primitives. rtmc: Real-time Motion Control of an RC800.',
        choices=('streaming', 'download', 'statements', 'rtmc'),
    ),
    Row(
        'point_message',
        'joint_traj_pt',
        'Message for a point: joint_traj_pt has one speed and a duration, joint_traj_pt_full has '
        'time, positions and velocities.',
        choices=('joint_traj_pt', 'joint_traj_pt_full'),
    ),
    Row(
        'smoothing',
        'none',
        'Conversion of trajectories before sending. none: the points are sent unchanged, for a '
        'controller that smooths or moves point to point. resample: points at a fixed period on '
        'the smooth motion through them. thin: as few points as `thin_deviation` allows.',
        choices=('none', 'resample', 'thin'),
    ),
    Row(
        'resample_period',
        0.05,
        'Time between points with smoothing resample. With thin: minimum time; the maximum is '
        'twice as long.',
        0.004,
        1.0,
        unit='s',
    ),
    Row(
        'thin_deviation',
        0.01,
        'With smoothing thin: maximum deviation of each joint from the smooth motion between '
        'points. A smaller value needs more points and can slow the arm down.',
        0.0001,
        1.0,
        unit='rad, m',
    ),
    Row(
        'smoothing_tolerance',
        0.0,
        'With smoothing resample or thin, or timing time_optimal: maximum deviation of each joint '
        'from the waypoints, at least 0.001 (0: exactly through them). It removes the noise of a '
        'recording, or makes a time-optimal motion faster.',
        0.0,
        0.5,
        unit='rad, m',
    ),
    Row(
        'timing',
        'as_planned',
        'Timing of trajectories. as_planned: the times of the points. time_optimal: as fast as '
        'the joint limits allow; times are ignored and not needed.',
        choices=('as_planned', 'time_optimal'),
    ),
    PLAN_SCALING,
    Row(
        'byte_order',
        'auto',
        "The controller's byte order (auto: detected from its state messages).",
        choices=('auto', 'little', 'big'),
    ),
    Row(
        'state_timeout',
        1.0,
        'State-link receive timeout.',
        0.05,
        60.0,
        unit='s',
    ),
    Row(
        'state_position_margin',
        0.1,
        'Maximum distance of a reported joint position from the joint range. A larger distance is '
        'implausible: the position is not published and disables the arm.',
        0.0,
        10.0,
        unit='rad, m',
    ),
    Row(
        'state_velocity_margin',
        1.5,
        'Maximum reported joint velocity, as a multiple of the velocity limit. A larger value is '
        'implausible: it is not published and disables the arm.',
        1.0,
        100.0,
        unit='1',
    ),
    Row(
        'io_timeout',
        1.0,
        'Reply timeout for an I/O request, and receive timeout of the I/O link, after which the '
        'values are unknown.',
        0.05,
        60.0,
        unit='s',
        now=True,
    ),
    Row(
        'reply_timeout',
        5.0,
        'Maximum wait for a reply while the arm is at rest, added to the duration of the move.',
        0.1,
        600.0,
        unit='s',
        now=True,
    ),
    Row(
        'start_tolerance',
        0.02,
        'Maximum distance of each joint from the measured position to the start of a trajectory.',
        0.0,
        1.0,
        unit='rad, m',
        now=True,
    ),
    Row(
        'require_planned_speed',
        True,
        'Reject trajectories and streams that the controller would execute faster than planned, '
        'because it ignores the times of points. False: execute them with a warning.',
        now=True,
    ),
    Row(
        'allow_nonzero_velocity_at_trajectory_end',
        False,
        'Accept trajectories with a velocity at the last point. The arm stops there anyway.',
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
        'Fraction of the velocity, acceleration and jerk limits available to setpoint streams. A '
        'change applies to the next stream.',
        0.01,
        1.0,
        unit='1',
        now=True,
    ),
    Row(
        'servo.timeout',
        0.1,
        'Setpoint timeout. After it the arm ends at the last position, or brakes from the last '
        'velocity.',
        0.02,
        1.0,
        unit='s',
        now=True,
    ),
    Row(
        'servo.start_tolerance',
        0.1,
        'Maximum distance of each joint from the arm to the first setpoint of a position stream.',
        0.0,
        1.0,
        unit='rad, m',
        now=True,
    ),
    Row(
        'servo.catch_up',
        1.5,
        "Speed limit of each joint while catching up, as a multiple of the stream's own speed, "
        'within `servo.scale`.',
        1.0,
        100.0,
        unit='1',
        now=True,
    ),
    Row(
        'servo.period',
        0.02,
        'Minimum time between the points sent for a setpoint stream. A controller that is slow '
        'per point follows better with a larger value.',
        0.02,
        0.2,
        unit='s',
        now=True,
    ),
    Row(
        'trace_folder',
        '~/.ros/epson_driver',
        'Folder for `trace_file`, created when needed (empty: no traces).',
    ),
    Row(
        'trace_file',
        '',
        'New file in `trace_folder` for a trace of the network traffic, for Wireshark and '
        '`epson_driver report`. Date and time replace %Y%m%d-%H%M%S (empty: no trace).',
        now=True,
    ),
    Row(
        'trace_size',
        100.0,
        'Maximum size of a trace.',
        0.001,
        10000.0,
        unit='MB',
        now=True,
    ),
    Row(
        'gripper.outputs',
        [-1, -1],
        'Digital outputs that open and close the gripper, for ~/gripper_cmd (-1, -1: none).',
        rule=POINT_PAIR,
    ),
    Row(
        'gripper.inputs',
        [-1, -1],
        'Digital inputs that are on when the gripper is open and closed (-1, -1: none).',
        rule=POINT_PAIR,
    ),
    Row('gripper.stroke', 0.05, 'Stroke of the gripper.', 1e-4, 2.0, unit='m'),
    Row(
        'gripper.time',
        2.0,
        'Maximum duration of a motion. A closing gripper that takes longer holds an object.',
        0.05,
        60.0,
        unit='s',
    ),
    Row(
        'tool.name',
        'tool',
        'Name of the tool frame, a child of tool0 in tf. It gets the prefix that `frame_id` has '
        'before base_link.',
    ),
    Row(
        'tool.pose',
        [*[0.0] * 6, 1.0],
        'Initial tool (TCP) for poses of motion primitives, until ~/set_tool sets another: x, y, '
        'z in tool0 and a quaternion x, y, z, w (0, 0, 0, 0, 0, 0, 1: tool0 itself, without a '
        'tool frame).',
        unit='m',
    ),
    Row(
        'points_file',
        '',
        "File of taught points, RC+'s .pts or .yaml. It is written after each "
        'change (empty: points are lost when the node ends).',
    ),
    Row(
        'constraints.stopped_velocity_tolerance',
        0.01,
        'Velocity below which a joint counts as stopped.',
        1e-6,
        10.0,
        unit='rad/s, m/s',
        now=True,
    ),
    Row(
        'constraints.goal_time',
        0.0,
        'Maximum delay of a goal beyond its planned end, after which it is aborted (0: no limit).',
        0.0,
        3600.0,
        unit='s',
        now=True,
    ),
)


def joint_rows(joint: str, unit: str = 'rad') -> Iterator[Row]:
    yield Row(
        f'constraints.{joint}.goal',
        GOAL_TOLERANCE[unit],
        f'Goal tolerance of {joint} at the end of the trajectory (0: any).',
        0.0,
        10.0,
        now=True,
        unit=unit,
    )
    yield Row(
        f'constraints.{joint}.trajectory',
        0.0,
        f'Path tolerance of {joint} during the trajectory (0: not checked).',
        0.0,
        10.0,
        now=True,
        unit=unit,
    )


EACH_JOINT = '<joint>'
"""Placeholder for a joint's name, in the settings that every joint has."""

ROWS = {row.name: row for row in (*TABLE, *joint_rows(EACH_JOINT))}
