# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The optional settings of a Robot, which correspond to ROS parameters."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from epson_driver.driver.io.gripper_wiring import GripperWiring
from epson_driver.setup.robot_file import robot_settings
from epson_driver.setup.table import ROWS, is_a

ARGUMENTS = {'host': 'robot_ip', 'model': 'robot_model'}
"""ROS parameter names of the arguments of Robot that are named differently."""


def setting(name: str, *usual: object) -> Any:
    """Return a dataclass field for a ROS parameter. `usual`: default, if not the parameter's."""
    row = ROWS[name]
    default = usual[0] if usual else row.default
    return field(
        default=tuple(default) if isinstance(default, list) else default, metadata={'row': row}
    )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings that most robots do not need. Names, units and defaults match the ROS parameters.

    None selects the value of the controller's profile or of the robot model. Times are in s.
    docs/ros_interface.md describes all of them.

    * goal_tolerance, start_tolerance: maximum error of every joint, rad (m). A goal tolerance of 0
      disables the check.
    * require_planned_speed: whether to reject motions that the controller is known to execute
      faster than planned.
    * servo_scale: fraction of the joints' velocity, acceleration and jerk limits that streams of
      setpoints may use.
    * servo_timeout: time after the last setpoint of a stream at which the arm brakes.
    * gripper: wiring of the gripper, or None without a gripper.
    * trace_file: path of a new pcap file that `connect` creates (docs/report.md). %Y%m%d-%H%M%S
      in the name is replaced by date and time.
    """

    joint_names: tuple[str, ...] | None = setting('joint_names', None)
    joint_signs: tuple[int, ...] = setting('joint_signs')
    joint_offsets: tuple[float, ...] = setting('joint_offsets')
    j23_factor: int = setting('j23_factor')
    error_texts: str | None = setting('error_texts', None)
    password_variable: str | None = setting('password_variable', None)
    interface: Literal['streaming', 'download', 'statements', 'rtmc'] | None = setting(
        'interface', None
    )
    point_message: Literal['joint_traj_pt', 'joint_traj_pt_full'] | None = setting(
        'point_message', None
    )
    byte_order: Literal['auto', 'little', 'big'] = setting('byte_order')
    state_timeout: float = setting('state_timeout')
    io_timeout: float = setting('io_timeout')
    reply_timeout: float = setting('reply_timeout')
    start_tolerance: float = setting('start_tolerance')
    goal_tolerance: float | None = setting('constraints.<joint>.goal', None)
    goal_time: float = setting('constraints.goal_time')
    stopped_velocity_tolerance: float = setting('constraints.stopped_velocity_tolerance')
    require_planned_speed: bool = setting('require_planned_speed')
    servo_scale: float = setting('servo.scale')
    servo_timeout: float = setting('servo.timeout')
    gripper: GripperWiring | None = None
    trace_file: str | None = setting('trace_file', None)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is not None or item.default is not None:
                rule = item.metadata['row'].allowed if item.metadata else _GRIPPER
                rule.argument(list(value) if isinstance(value, tuple) else value, item.name)


_GRIPPER = is_a(GripperWiring, 'must be GripperWiring(...)')


def checked_argument(name: str, value: object) -> str:
    """Check the value of a Robot's argument, and return the name of its ROS parameter."""
    row = ROWS[ARGUMENTS.get(name, name)]
    row.allowed.argument(value, name)
    return row.name


def parameter_values(
    settings: Settings, host: str, controller: str | None, model: str | None, **ports: int | None
) -> dict[str, Any]:
    """Return the settings and the arguments of a Robot by ROS parameter name.

    `host`: an address or the path of a robot's file. Arguments that are None are left out. Their
    values come from the robot's file, the profile, or the table of settings.
    """
    in_file = isinstance(host, str) and host.endswith('.yaml')
    values = robot_settings(host) if in_file else {}
    optional = {'controller': controller, 'model': model, **ports}
    arguments = {name: value for name, value in optional.items() if value is not None}
    if not in_file:
        arguments['host'] = host
    for name, value in arguments.items():
        values[checked_argument(name, value)] = value
    for item in fields(settings):
        value = getattr(settings, item.name)
        if value is not None and 'row' in item.metadata:
            name = item.metadata['row'].name
            values[name] = list(value) if isinstance(value, tuple) else value
    if (wiring := settings.gripper) is not None:
        values['gripper.outputs'] = [wiring.open_output, wiring.close_output]
        values['gripper.inputs'] = [wiring.opened_input, wiring.closed_input]
        values |= {'gripper.stroke': wiring.stroke, 'gripper.time': wiring.time}
    if settings.trace_file is not None:
        path = Path(settings.trace_file)
        values |= {'trace_folder': str(path.parent), 'trace_file': path.name}
    return values
