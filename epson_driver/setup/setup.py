# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Creates a driver from the settings, a controller's profile and a robot model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.delivery.statements import Statement, StatementDelivery, last_point
from epson_driver.driver.driver import Driver, DriverEvents
from epson_driver.driver.goal.goal import Goal, GoalSettings, Tolerances, cause_timeout
from epson_driver.driver.io.gripper_wiring import GripperWiring
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.smoothing import Smoothing, check_tolerance
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.driver.state.plausibility import Margins
from epson_driver.error_texts import ErrorTexts, load_error_texts
from epson_driver.inputs import InputError
from epson_driver.motion import Array, Trajectory
from epson_driver.motion.point_to_point import straight
from epson_driver.profiles import ControllerProfile, load_controller_profile
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.rtmc.messages import MAX_PASSWORD_BYTES
from epson_driver.setup.robot_file import password_in
from epson_driver.setup.table import EACH_JOINT, TABLE, joint_rows
from epson_driver.simple_message import MAX_JOINTS, ByteOrder

BYTE_ORDERS = {'auto': None, 'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}
NOT_WIRED = [-1, -1]


@dataclass(frozen=True)
class Setup:
    """The settings of a driver by name, and the objects created from them."""

    values: dict[str, Any]
    profile: ControllerProfile
    model: RobotModel
    configuration: Configuration
    gripper: GripperWiring | None

    def make_driver(self, events: DriverEvents) -> Driver:
        driver = Driver(self.configuration, events, self.goals)
        if driver.statements is not None:
            driver.statements.arm = Kinematics(self.model)
        self.apply(driver)
        return driver

    def apply(self, driver: Driver) -> None:
        driver.goal_queue.settings = self.goals
        driver.goal_queue.start_tolerance = self.values['start_tolerance']
        driver.servo.settings = self.servo
        driver.io.timeout = self.values['io_timeout']

    @property
    def goals(self) -> GoalSettings:
        return GoalSettings(
            stopped_velocity=self.values['constraints.stopped_velocity_tolerance'],
            reply_timeout=self.values['reply_timeout'],
            cause_timeout=cause_timeout(self.profile.state),
            require_planned_speed=self.values['require_planned_speed'],
        )

    @property
    def servo(self) -> ServoSettings:
        return ServoSettings(
            scale=self.values['servo.scale'],
            timeout=self.values['servo.timeout'],
            start_tolerance=self.values['servo.start_tolerance'],
            reply_timeout=self.values['reply_timeout'],
            period=self.values['servo.period'],
            catch_up=self.values['servo.catch_up'],
        )

    def tolerances(self, kind: str) -> Tolerances:
        """Return the tolerances of all joints.

        `kind`: 'goal' or 'trajectory'. 0 means no limit.
        """
        names = self.model.joint_names
        values = np.array([self.values[f'constraints.{name}.{kind}'] for name in names])
        return Tolerances(np.where(values > 0.0, values, np.inf), np.full(len(names), np.inf))

    def joint_move(
        self, start: Array, target: Array, speed: float, acceleration: float
    ) -> tuple[Trajectory, Callable[[StatementDelivery], str]]:
        limits = self.model.limits
        path = straight(
            start, target, limits, speed, acceleration, sampled=self.profile.program.exact_times
        )
        return path, lambda moves: moves.joints(target, speed, acceleration)

    def goal(self, trajectory: Trajectory, statement: str | None = None) -> Goal:
        path = self.tolerances('trajectory')
        return Goal(
            trajectory if statement is None else last_point(trajectory),
            self.tolerances('goal').position,
            self.values['constraints.goal_time'],
            path_tolerance=path if path.checked else None,
            units=self.model.limits.units,
            may_end_moving=self.values['allow_nonzero_velocity_at_trajectory_end'],
            message=None if statement is None else Statement(statement),
        )


def profile_defaults(profile: ControllerProfile) -> dict[str, Any]:
    """Return the settings for which a controller's profile has values.

    The byte order is excluded, because it is detected. The profile's byte order is only the
    initial one.
    """
    return {
        'motion_port': profile.motion_port,
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


def make_setup(settings: Mapping[str, Any]) -> Setup:
    """Return the setup for settings by name, each of which has already been checked.

    The controller's profile, the robot model and the table provide the defaults. Raises ValueError
    if settings are incompatible, InputError if the profile or the model does not exist.
    """
    values = {row.name: row.default for row in TABLE} | {**settings}
    profile = load_controller_profile(values['controller'])
    model = load_robot_model(values['robot_model'])
    usual = profile_defaults(profile) | {'joint_names': list(model.joint_names)}
    values |= usual | {**settings}
    names = tuple(values['joint_names'])
    if len(names) != len(model.joint_names):
        raise ValueError(
            f'parameter joint_names has {len(names)} names, but {model.name} has '
            f'{len(model.joint_names)} joints'
        )
    if len(names) > MAX_JOINTS:
        raise ValueError(f'{model.name} has {len(names)} joints: at most {MAX_JOINTS}')
    model = replace(model, limits=replace(model.limits, names=names))
    for name, unit in zip(names, model.limits.units, strict=True):
        for row, item in zip(joint_rows(name, unit), joint_rows(EACH_JOINT), strict=True):
            values.setdefault(row.name, values.get(item.name, row.default))
    configuration = _configuration(values, profile, model)
    return Setup(values, profile, model, configuration, _gripper_wiring(values))


def _configuration(
    values: Mapping[str, Any], profile: ControllerProfile, model: RobotModel
) -> Configuration:
    smoothing = Smoothing(
        None if values['smoothing'] == 'none' else values['resample_period'],
        time_optimal=values['timing'] == 'time_optimal',
        own_points=not profile.program.uses.duration,
        thin=values['smoothing'] == 'thin',
        deviation=values['thin_deviation'],
        tolerance=values['smoothing_tolerance'],
    )
    real_time = profile.program.interface == 'rtmc'
    try:
        check_tolerance(smoothing)
    except ValueError as error:
        raise ValueError(f'parameter smoothing_tolerance = {error}') from error
    return Configuration(
        host=values['robot_ip'],
        motion_port=values['motion_port'],
        state_port=values['state_port'],
        remote_port=values['remote_port'],
        io_port=values['io_port'],
        io_timeout=values['io_timeout'],
        io=profile.io,
        byte_order=BYTE_ORDERS[values['byte_order']],
        state_timeout=values['state_timeout'],
        limits=model.limits,
        errors=ErrorTexts(load_error_texts(values['error_texts'])),
        delivery=delivery_rules(profile, values['interface'], values['point_message']),
        mapping=joint_mapping(
            len(model.joint_names),
            values['joint_signs'],
            values['joint_offsets'],
            values['j23_factor'],
        ),
        usual_byte_order=profile.byte_order,
        motors=profile.program.motors,
        client_timeout=profile.server.client_timeout,
        password=_password(values['password_variable'], profile, real_time),
        model=model.name,
        cycle=profile.rtmc.cycle,
        state_period=profile.state.period,
        margins=Margins(values['state_position_margin'], values['state_velocity_margin']),
        configured_as=f'{profile.name}, {model.name}',
        smoothing=smoothing,
    )


def _password(variable: str, profile: ControllerProfile, real_time: bool) -> str:
    password = password_in(variable, (profile.rtmc if real_time else profile.remote).password)
    if real_time and (size := len(password.encode())) > MAX_PASSWORD_BYTES:
        name = f'password_variable = {variable}' if variable else 'rtmc.password of the profile'
        raise InputError(f'{name}: {size} bytes: at most {MAX_PASSWORD_BYTES}')
    return password


def _gripper_wiring(values: Mapping[str, Any]) -> GripperWiring | None:
    outputs, inputs = values['gripper.outputs'], values['gripper.inputs']
    if outputs == inputs == NOT_WIRED:
        return None
    try:
        return GripperWiring(
            open_output=outputs[0],
            close_output=outputs[1],
            opened_input=inputs[0],
            closed_input=inputs[1],
            stroke=values['gripper.stroke'],
            time=values['gripper.time'],
        )
    except ValueError as error:
        raise InputError(
            f'parameters gripper.outputs = {outputs}, gripper.inputs = {inputs}: {error}; '
            'both are needed for a gripper'
        ) from error
