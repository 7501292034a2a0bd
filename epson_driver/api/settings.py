# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From the arguments of a Robot to the driver's configuration."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from epson_driver.api.errors import RobotError
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal import GoalSettings, cause_timeout
from epson_driver.driver.io.gripper import GripperWiring
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.smoothing import usual_smoothing
from epson_driver.driver.state.joint_mapping import OFFSETS, SIGNS, joint_mapping
from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import HOST, JOINT_NAMES, Rule, choice, count, number, shown
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.simple_message import MAX_JOINTS, ByteOrder
from epson_driver.trace import TraceError, open_trace

PORT = count(1, 65_535)
OPTIONAL_PORT = count(0, 65_535)
BYTE_ORDERS = {'auto': None, 'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}
GOAL_TOLERANCE = {'rad': 0.01, 'm': 0.001}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What most robots need not set. Names, units and defaults are those of the ROS parameters.

    None: what the controller's profile says, or the robot model. goal_tolerance, start_tolerance:
    rad (m), all joints. Times in s. servo_scale: the share of the joint limits that streams may
    use; servo_timeout: so long after the last setpoint the arm brakes. gripper: how it is wired,
    if there is one. trace_file: a new pcap file that `connect` begins (docs/report.md), with its
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
    'servo_scale': number(0.01, 1.0),
    'servo_timeout': number(0.02, 1.0, 's'),
    'joint_names': JOINT_NAMES,
    'joint_signs': _each(SIGNS),
    'joint_offsets': _each(OFFSETS),
    'j23_factor': choice(-1, 0, 1),
    'error_texts': _FILE,
    'interface': choice('streaming', 'download', 'statements'),
    'point_message': choice('joint_traj_pt', 'joint_traj_pt_full'),
    'byte_order': choice(*BYTE_ORDERS),
    'gripper': Rule(_is(GripperWiring), 'must be GripperWiring(...)'),
    'trace_file': _FILE,
}


@dataclass(frozen=True, kw_only=True)
class Ports:
    """TCP ports of the controller's servers, None for the profile's, 0 for one not used."""

    motion: int | None = None
    state: int | None = None
    io: int | None = None
    remote: int | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None:
                rule = PORT if field.name in ('motion', 'state') else OPTIONAL_PORT
                rule.checked(value, f'{field.name}_port')


@dataclass(frozen=True)
class Setup:
    """All that a driver is made with, its model with the joint names that were asked for."""

    model: RobotModel
    configuration: Configuration
    goals: GoalSettings
    start_tolerance: float
    goal_tolerance: np.ndarray[tuple[int], np.dtype[np.float64]]
    goal_time: float
    gripper: GripperWiring | None
    servo: ServoSettings
    trace_file: str | None

    async def open_trace(self) -> BinaryIO | None:
        """Open the file for a trace, if one is asked for. Raises RobotError."""
        if self.trace_file is None:
            return None
        path = Path(self.trace_file)
        try:
            return await asyncio.to_thread(open_trace, str(path.parent), path.name)
        except TraceError as error:
            raise RobotError(str(error)) from error


def make_setup(host: str, controller: str, model_name: str, ports: Ports, more: Settings) -> Setup:
    """Return the setup for a controller profile and a robot model, both by name or file.

    Raises ValueError that names argument, value and what is allowed, FileNotFoundError that lists
    the profiles or models there are.
    """
    HOST.checked(host, 'host')
    for field, name in (('controller', controller), ('model', model_name)):
        if not isinstance(name, str):
            raise ValueError(f'{field} = {shown(name)}: must be a name, or the path of a file')
    profile = load_controller_profile(controller)
    model = load_robot_model(model_name)
    if more.joint_names is not None:
        if len(more.joint_names) != len(model.joint_names):
            raise ValueError(
                f'joint_names has {len(more.joint_names)} names, but {model.name} has '
                f'{len(model.joint_names)} joints'
            )
        model = replace(model, limits=replace(model.limits, names=tuple(more.joint_names)))
    limits = model.limits
    if len(limits.names) > MAX_JOINTS:
        raise ValueError(f'{model.name} has {len(limits.names)} joints: at most {MAX_JOINTS}')
    usual = profile.ports
    return Setup(
        model,
        Configuration(
            host=host,
            motion_port=usual.motion if ports.motion is None else ports.motion,
            state_port=usual.state if ports.state is None else ports.state,
            io_port=usual.io if ports.io is None else ports.io,
            remote_port=usual.remote if ports.remote is None else ports.remote,
            io_timeout=more.io_timeout,
            io=profile.io,
            byte_order=BYTE_ORDERS[more.byte_order],
            state_timeout=more.state_timeout,
            limits=limits,
            errors=load_error_texts(more.error_texts or profile.error_texts),
            delivery=delivery_rules(
                profile,
                more.interface or profile.program.interface,
                more.point_message or profile.program.point_message,
            ),
            mapping=joint_mapping(
                len(limits.names), more.joint_signs, more.joint_offsets, more.j23_factor
            ),
            usual_byte_order=profile.byte_order,
            motors=profile.program.motors,
            client_timeout=profile.server.client_timeout,
            password=profile.remote.password,
            state_period=profile.state.period,
            smoothing=usual_smoothing(profile.program),
            configured_as=f'{profile.name}, {model.name}',
        ),
        GoalSettings(
            stopped_velocity=more.stopped_velocity_tolerance,
            reply_timeout=more.reply_timeout,
            cause_timeout=cause_timeout(profile.state),
        ),
        more.start_tolerance,
        np.array(
            [
                GOAL_TOLERANCE[unit] if more.goal_tolerance is None else more.goal_tolerance
                for unit in limits.units
            ]
        ),
        more.goal_time,
        more.gripper,
        ServoSettings(
            share=more.servo_scale,
            timeout=more.servo_timeout,
            reply_timeout=more.reply_timeout,
            period=profile.program.setpoint_period,
        ),
        more.trace_file,
    )
