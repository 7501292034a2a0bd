# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What most robots need not set."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Literal

from epson_driver.driver.io.gripper_wiring import GripperWiring
from epson_driver.driver.state.joint_mapping import OFFSETS, SIGNS
from epson_driver.inputs import JOINT_NAMES, Rule, choice, number


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What most robots need not set. Names, units and defaults are those of the ROS parameters.

    None: what the controller's profile says, or the robot model. goal_tolerance, start_tolerance:
    rad (m), all joints. Times in s. require_planned_speed: refuse motions that the controller is
    known to execute faster. servo_scale: the share of the joint limits that streams may use;
    servo_timeout: so long after the last setpoint the arm brakes. gripper: how it is wired, if
    there is one. trace_file: a new pcap file that `connect` begins (docs/report.md), with its
    folder; %Y%m%d-%H%M%S in its name is filled in. See docs/ros_interface.md for each.
    """

    joint_names: tuple[str, ...] | None = None
    joint_signs: tuple[int, ...] = (1,)
    joint_offsets: tuple[float, ...] = (0.0,)
    j23_factor: int = 0
    error_texts: str | None = None
    interface: Literal['streaming', 'download', 'statements'] | None = None
    point_message: Literal['joint_traj_pt', 'joint_traj_pt_full'] | None = None
    byte_order: Literal['auto', 'little', 'big'] = 'auto'
    state_timeout: float = 1.0
    io_timeout: float = 1.0
    reply_timeout: float = 5.0
    start_tolerance: float = 0.02
    goal_tolerance: float | None = None
    goal_time: float = 0.0
    stopped_velocity_tolerance: float = 0.01
    require_planned_speed: bool = True
    servo_scale: float = 0.25
    servo_timeout: float = 0.15
    gripper: GripperWiring | None = None
    trace_file: str | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None or field.default is not None:
                _RULES[field.name].checked(value, field.name)


def _is(*kinds: type) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        if not isinstance(value, kinds):
            raise TypeError
        return value

    return read


def _each(rule: Rule) -> Rule:
    return Rule(lambda values: rule.read(list(values)), rule.text)


_FILE = Rule(_is(str), 'must be the path of a file')

_RULES: dict[str, Rule] = {
    'state_timeout': number(0.05, 60.0, 's'),
    'io_timeout': number(0.05, 60.0, 's'),
    'reply_timeout': number(0.1, 600.0, 's'),
    'start_tolerance': number(0.0, 1.0, 'rad or m'),
    'goal_tolerance': number(0.0, 10.0, 'rad or m'),
    'goal_time': number(0.0, 3600.0, 's'),
    'stopped_velocity_tolerance': number(1e-6, 10.0, 'rad/s or m/s'),
    'require_planned_speed': Rule(_is(bool), 'must be True or False'),
    'servo_scale': number(0.01, 1.0),
    'servo_timeout': number(0.02, 1.0, 's'),
    'joint_names': JOINT_NAMES,
    'joint_signs': _each(SIGNS),
    'joint_offsets': _each(OFFSETS),
    'j23_factor': choice(-1, 0, 1),
    'error_texts': _FILE,
    'interface': choice('streaming', 'download', 'statements'),
    'point_message': choice('joint_traj_pt', 'joint_traj_pt_full'),
    'byte_order': choice('auto', 'little', 'big'),
    'gripper': Rule(_is(GripperWiring), 'must be GripperWiring(...)'),
    'trace_file': _FILE,
}
