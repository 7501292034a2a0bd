# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters as one table: name, default, description, range, read-only or not."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

JOINTS = [f'joint_{i}' for i in range(1, 7)]


@dataclass(frozen=True)
class Row:
    """One parameter. `choices` or `low`…`high` limit its value; `now` lets it change any time."""

    name: str
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    now: bool = False

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


TABLE = (
    Row('robot_ip', '127.0.0.1', 'Address of the robot controller.'),
    Row('motion_port', 11000, 'TCP port of its motion server.', 1, 65535),
    Row('state_port', 11002, 'TCP port of its state server.', 1, 65535),
    Row('io_port', 11003, 'TCP port of its I/O server; 0: not used.', 0, 65535),
    Row(
        'remote_port',
        0,
        'TCP port of its Remote Ethernet server (RC700-A: 5000), through which ~/enable, '
        '~/disable and ~/reset_error act on the motors; 0: not used.',
        0,
        65535,
    ),
    Row('joint_names', JOINTS, "Names of the joints in the controller's order."),
    Row('robot_model', 'c3_a601s', 'Robot model: a file of config/robots, or a path to one.'),
    Row(
        'interface',
        'streaming',
        'How trajectories reach the controller: point by point, each acknowledged.',
        choices=('streaming',),
    ),
    Row(
        'point_message',
        'joint_traj_pt',
        'The message that carries a point.',
        choices=('joint_traj_pt',),
    ),
    Row(
        'smoothing',
        'none',
        'What is sent of a trajectory. none: its own points, for a controller that smooths or '
        'goes from point to point; resample: points on the smooth motion through them.',
        choices=('none', 'resample'),
    ),
    Row(
        'resample_period',
        0.05,
        'Time between two points of the smooth motion [s].',
        0.004,
        1.0,
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
        'reply_timeout',
        5.0,
        'Patience for the reply to a point while the arm does not move, beyond the planned '
        'duration of the point [s].',
        0.1,
        600.0,
        now=True,
    ),
    Row(
        'start_tolerance',
        0.02,
        'How far from the measured position a trajectory may start, each joint [rad].',
        0.0,
        1.0,
        now=True,
    ),
    Row(
        'allow_nonzero_velocity_at_trajectory_end',
        False,
        'Accept trajectories whose last point has a velocity. The arm comes to rest there anyway.',
        now=True,
    ),
    Row(
        'constraints.stopped_velocity_tolerance',
        0.01,
        'Velocity below which a joint counts as standing [rad/s].',
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


def joint_rows(joint: str) -> Iterator[Row]:
    """Yield the parameters of one joint, named as joint_trajectory_controller names them."""
    yield Row(
        f'constraints.{joint}.goal',
        0.01,
        f'How far {joint} may be from the end of the trajectory for success; 0: any [rad].',
        0.0,
        10.0,
        now=True,
    )
    yield Row(
        f'constraints.{joint}.trajectory',
        0.0,
        f'Tolerance of {joint} on the way; not checked yet, keep 0 [rad].',
        0.0,
        0.0,
        now=True,
    )


def declare(node: Any) -> dict[str, Any]:
    """Declare all parameters on an rclpy node and return their values by name.

    Raises ValueError that names the parameter, its value and what is allowed.
    """
    values = _declare_rows(node, TABLE)
    names = values['joint_names']
    if not names or len(set(names)) != len(names) or '' in names:
        raise ValueError(f'parameter joint_names = {names}: the names must be there and differ')
    for joint in names:
        values |= _declare_rows(node, joint_rows(joint))
    return values


def _declare_rows(node: Any, rows: Any) -> dict[str, Any]:
    values = {}
    for row in rows:
        value = node.declare_parameter(row.name, row.default, row.descriptor).value
        if row.choices and value not in row.choices:
            allowed = ', '.join(row.choices)
            raise ValueError(f'parameter {row.name} = {value!r}: must be one of {allowed}')
        values[row.name] = list(value) if isinstance(row.default, list) else value
    return values
