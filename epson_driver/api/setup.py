# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From the arguments of a Robot to the driver's configuration."""

import asyncio
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from epson_driver.api.errors import RobotError
from epson_driver.api.settings import Settings
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal import GoalSettings, cause_timeout
from epson_driver.driver.io.gripper_wiring import GripperWiring
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.smoothing import usual_smoothing
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import HOST, count, shown
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.simple_message import MAX_JOINTS, ByteOrder
from epson_driver.trace import TraceError, open_trace

PORT = count(1, 65_535)
OPTIONAL_PORT = count(0, 65_535)
BYTE_ORDERS = {'auto': None, 'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}
GOAL_TOLERANCE = {'rad': 0.01, 'm': 0.001}


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
            require_planned_speed=more.require_planned_speed,
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
