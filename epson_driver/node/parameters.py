# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters as one table: name, default, description, range, read-only or not."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import (
    HOST,
    JOINT_NAMES,
    InputError,
    Rule,
    count,
    list_of,
    near_name,
    shown,
)
from epson_driver.profiles import ControllerProfile, load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import MAX_JOINTS

Loaded = TypeVar('Loaded')

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


@dataclass(frozen=True)
class Row:
    """One parameter, limited by `choices` or `low`…`high`, with `now` changeable at any time."""

    name: str
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    now: bool = False
    rule: Rule | None = None
    """What else the value is checked against at the start."""

    @property
    def descriptor(self) -> ParameterDescriptor:
        """What `ros2 param describe` shows."""
        descriptor = ParameterDescriptor(
            description=self.description,
            read_only=not self.now,
            additional_constraints=f'one of: {", ".join(self.choices)}' if self.choices else '',
        )
        if self.low is not None and self.high is not None:
            if isinstance(self.default, int):
                descriptor.integer_range = [
                    IntegerRange(from_value=int(self.low), to_value=int(self.high), step=0)
                ]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=self.low, to_value=self.high, step=0.0)
                ]
        return descriptor


CONTROLLER = Row(
    'controller',
    'rc620',
    'Kind of controller: a file of config/controllers, or a path to one. Where other parameters '
    'are not set, it says which ports, which interface and which messages are used.',
)

ROBOT_MODEL = Row(
    'robot_model', 'c3_a601s', 'Robot model: a file of config/robots, or a path to one.'
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
    ),
    Row('joint_offsets', [0.0], 'Offsets of the joints: one for all, or one for each [rad, m].'),
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
        'Time between two points of the smooth motion; with thin this to twice this [s].',
        0.004,
        1.0,
    ),
    Row(
        'thin_deviation',
        0.01,
        'With smoothing thin: how far straight ways between its points may be from the smooth '
        'motion, each joint; less needs more points, at which the arm may be slower [rad, m].',
        0.0001,
        1.0,
    ),
    Row(
        'smoothing_tolerance',
        0.0,
        'With smoothing: resample or thin: how far beside the points of a plan the motion may '
        'pass, each joint, 0.001 or more, so that the noise of a recording is left out; 0: '
        'through them [rad, m].',
        0.0,
        0.5,
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
        'Silence on the state port after which the link is taken for lost [s].',
        0.05,
        60.0,
    ),
    Row(
        'state_position_margin',
        0.1,
        'How far beyond its range a joint may be reported; farther is not believed, is not '
        'published and disables the arm [rad, m].',
        0.0,
        10.0,
    ),
    Row(
        'state_velocity_margin',
        1.5,
        'How many times as fast as its limit a joint may be reported to move; faster is not '
        'believed, is not published and disables the arm [1].',
        1.0,
        100.0,
    ),
    Row(
        'io_timeout',
        1.0,
        'Patience for the reply to an I/O request, and silence of the I/O port after which the '
        'values are taken for unknown [s].',
        0.05,
        60.0,
        now=True,
    ),
    Row(
        'reply_timeout',
        5.0,
        'Patience for the reply to a point while the arm does not move, beyond the time that the '
        'plan takes to that point [s].',
        0.1,
        600.0,
        now=True,
    ),
    Row(
        'start_tolerance',
        0.02,
        'How far from the measured position a trajectory may start, each joint [rad, m].',
        0.0,
        1.0,
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
        'Rate of the action feedback and of ~/controller_state while a goal runs [Hz].',
        0.1,
        200.0,
        now=True,
    ),
    Row(
        'servo.scale',
        0.25,
        "Share of the joints' limits of velocity, acceleration and jerk that streams of setpoints "
        'may use; it holds for the next stream [1].',
        0.01,
        1.0,
        now=True,
    ),
    Row(
        'servo.timeout',
        0.1,
        'Silence of a stream of setpoints after which the arm ends at its last position, or '
        'brakes [s].',
        0.02,
        1.0,
        now=True,
    ),
    Row(
        'servo.start_tolerance',
        0.1,
        'How far from the arm the first position of a stream of setpoints may be, each joint '
        '[rad, m].',
        0.0,
        1.0,
        now=True,
    ),
    Row(
        'servo.catch_up',
        1.5,
        'How many times as fast as a stream of positions goes itself the arm may follow when it '
        'is behind, each joint, within `servo.scale` [1].',
        1.0,
        100.0,
        now=True,
    ),
    Row(
        'servo.period',
        0.02,
        'Time between two points at least that a stream of setpoints becomes. A controller that '
        'takes long for each point follows better if there are fewer [s].',
        0.02,
        0.2,
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
        'Size at which a trace ends [MB].',
        0.001,
        10000.0,
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
    Row('gripper.stroke', 0.05, 'How far it opens [m].', 1e-4, 2.0),
    Row(
        'gripper.time',
        2.0,
        'After so long at most it is open, is closed, or holds something [s].',
        0.05,
        60.0,
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
        '1 is tool0 itself, and then tf has no frame of it [m].',
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
        'Velocity below which a joint counts as standing [rad/s, m/s].',
        1e-6,
        10.0,
        now=True,
    ),
    Row(
        'constraints.goal_time',
        0.0,
        'How much longer than planned a goal may take before it is aborted; 0: no limit [s].',
        0.0,
        3600.0,
        now=True,
    ),
)


def joint_rows(joint: str, unit: str = 'rad') -> Iterator[Row]:
    """Yield the parameters of one joint, named as joint_trajectory_controller names them."""
    yield Row(
        f'constraints.{joint}.goal',
        GOAL_TOLERANCE[unit],
        f'How far {joint} may be from the end of the trajectory for success; 0: any [{unit}].',
        0.0,
        10.0,
        now=True,
    )
    yield Row(
        f'constraints.{joint}.trajectory',
        0.0,
        f'How far {joint} may be from the plan at any moment on the way; 0: not checked [{unit}].',
        0.0,
        10.0,
        now=True,
    )


def profile_defaults(profile: ControllerProfile) -> dict[str, Any]:
    """Return the parameters that a controller's profile has values for.

    The byte order is not among them: it is found out; the profile says what to begin with.
    """
    return {
        'motion_port': profile.ports.motion,
        'state_port': profile.ports.state,
        'io_port': profile.ports.io,
        'remote_port': profile.ports.remote,
        'error_texts': profile.error_texts,
        'interface': profile.program.interface,
        'point_message': profile.program.point_message,
        'smoothing': profile.program.smoothing,
        'resample_period': profile.program.resample_period,
        'thin_deviation': profile.program.thin_deviation,
        'servo.period': profile.program.setpoint_period,
    }


def declare(node: Node) -> dict[str, Any]:
    """Declare all parameters on an rclpy node and return their values by name.

    Where the controller's profile has a value, it is the default; so are the robot model's joint
    names. Raises InputError that names the parameter, its value and what is allowed, such as the
    profiles or the models there are; what rclpy checks, its ParameterException.
    """
    values = declare_rows(node, (CONTROLLER,))
    given = profile_defaults(_loaded('controller', values, load_controller_profile))
    values |= declare_rows(node, (ROBOT_MODEL,))
    model = _loaded('robot_model', values, load_robot_model)
    given['joint_names'] = list(model.joint_names)
    values |= declare_rows(
        node,
        (
            replace(row, default=given.get(row.name, row.default))
            for row in TABLE
            if row not in (CONTROLLER, ROBOT_MODEL)
        ),
    )
    _loaded('error_texts', values, load_error_texts)
    names = values['joint_names']
    if len(names) > MAX_JOINTS:
        raise InputError(
            f'parameter joint_names has {len(names)} names: a message carries {MAX_JOINTS} joints'
        )
    units = dict(zip(names, model.limits.units, strict=False))
    for joint in names:
        values |= declare_rows(node, joint_rows(joint, units.get(joint, 'rad')))
    return values


def undeclared(node: Node) -> Iterator[str]:
    """Yield a sentence for each parameter that was given to a node and that it does not have.

    rclpy has no public list of what was given. Its automatically_declare_parameters_from_overrides
    would make one, but for an empty array it raises an error that names no parameter, before
    `declare` can say what is wrong. Should the private one be gone some day, that is said.
    """
    given = getattr(node, '_parameter_overrides', None)
    if given is None:
        yield 'this rclpy does not say which parameters were given: misspelled ones are ignored'
        return
    for name in given:
        if not node.has_parameter(name):
            near = near_name(name, node.get_parameters_by_prefix(''))
            yield f'parameter {name} is ignored: there is none of that name' + (
                f'; did you mean {near}?' if near else ''
            )


def rejection(changes: Iterable[Parameter]) -> str:
    """Return why rclpy parameters cannot have these values, or '' if they can.

    Ranges, types and read-only flags are rclpy's business: it has them from the descriptors.
    """
    choices = {row.name: row.choices for row in TABLE if row.choices}
    for change in changes:
        allowed = choices.get(change.name, (change.value,))
        if change.value not in allowed:
            return _not_among(change.name, change.value, allowed)
    return ''


def _not_among(name: str, value: object, choices: Sequence[Any]) -> str:
    allowed = ', '.join(map(str, choices))
    return f'parameter {name} = {shown(value)}: must be one of {allowed}'


def declare_rows(node: Node, rows: Iterable[Row]) -> dict[str, Any]:
    """Declare the parameters of some rows and return their values by name. Raises as `declare`."""
    values = {}
    for row in rows:
        value = node.declare_parameter(row.name, row.default, row.descriptor).value
        if isinstance(row.default, list):
            value = list(value or ())  # rclpy has None for []
        if value is None:
            raise InputError(f'parameter {row.name}: has no value')
        if row.choices and value not in row.choices:
            raise InputError(_not_among(row.name, value, row.choices))
        if row.rule is not None:
            row.rule.checked(value, f'parameter {row.name}')
        values[row.name] = value
    return values


def _loaded(name: str, values: dict[str, Any], load: Callable[[str], Loaded]) -> Loaded:
    try:
        return load(values[name])
    except (OSError, InputError) as error:
        raise InputError(f'parameter {name} = {shown(values[name])}: {error}') from error
