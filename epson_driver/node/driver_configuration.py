# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From the node's parameters and the controller's profile to the driver's configuration."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal import GoalSettings, cause_timeout
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.smoothing import Smoothing, check_tolerance
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.driver.state.plausibility import Margins
from epson_driver.error_texts import load_error_texts
from epson_driver.profiles import ControllerProfile
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import ByteOrder

BYTE_ORDERS = {'auto': None, 'little': ByteOrder.LITTLE, 'big': ByteOrder.BIG}


def driver_configuration(
    parameters: Mapping[str, Any], profile: ControllerProfile
) -> Configuration:
    """Return the driver's configuration.

    Raises ValueError for parameters that do not go together.
    """
    values = parameters
    model = load_robot_model(values['robot_model'])
    names = tuple(values['joint_names'])
    if len(names) != len(model.joint_names):
        raise ValueError(
            f'parameter joint_names has {len(names)} names, but {model.name} has '
            f'{len(model.joint_names)} joints'
        )
    delivery = delivery_rules(profile, values['interface'], values['point_message'])
    smoothing = Smoothing(
        None if values['smoothing'] == 'none' else values['resample_period'],
        time_optimal=values['timing'] == 'time_optimal',
        thin=values['smoothing'] == 'thin',
        deviation=values['thin_deviation'],
        tolerance=values['smoothing_tolerance'],
    )
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
        limits=replace(model.limits, names=names),
        errors=load_error_texts(values['error_texts']),
        delivery=delivery,
        mapping=joint_mapping(
            len(names), values['joint_signs'], values['joint_offsets'], values['j23_factor']
        ),
        usual_byte_order=profile.byte_order,
        motors=profile.program.motors,
        client_timeout=profile.server.client_timeout,
        password=profile.remote.password,
        state_period=profile.state.period,
        margins=Margins(values['state_position_margin'], values['state_velocity_margin']),
        configured_as=f'{profile.name}, {model.name}',
        smoothing=smoothing,
    )


def goal_settings(parameters: Mapping[str, Any], profile: ControllerProfile) -> GoalSettings:
    """Return the settings of goal executions, whose parameters may change at any time."""
    return GoalSettings(
        stopped_velocity=parameters['constraints.stopped_velocity_tolerance'],
        reply_timeout=parameters['reply_timeout'],
        cause_timeout=cause_timeout(profile.state),
        require_planned_speed=parameters['require_planned_speed'],
    )


def servo_settings(parameters: Mapping[str, Any]) -> ServoSettings:
    """Return how streams of setpoints are followed."""
    return ServoSettings(
        share=parameters['servo.scale'],
        timeout=parameters['servo.timeout'],
        start_tolerance=parameters['servo.start_tolerance'],
        reply_timeout=parameters['reply_timeout'],
        period=parameters['servo.period'],
        catch_up=parameters['servo.catch_up'],
    )
