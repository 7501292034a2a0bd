# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The top level of the simulated controller, which assembles it according to its profile."""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from epson_driver.inputs import InputError
from epson_driver.motion import Array
from epson_driver.profiles.profile import ControllerProfile
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.robots import RobotModel
from epson_driver.share import share_path
from epson_driver.sim_controller.arm.executor import Executor
from epson_driver.sim_controller.arm.low_power import low_power_caps
from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.arm.simulated_arm import SimulatedArm
from epson_driver.sim_controller.arm.streaming import Planner, Streaming
from epson_driver.sim_controller.client_connections import ClientConnections
from epson_driver.sim_controller.condition.errors import clipped
from epson_driver.sim_controller.condition.spel_settings import SpelSettings
from epson_driver.sim_controller.condition.states import (
    NOTHING_LOADED,
    STARTED_BY_A_PERSON,
)
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.programs.motion_program import MotionProgram
from epson_driver.sim_controller.programs.motoman_program import MotomanProgram
from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.sim_controller.spel_host.spel_program import SpelProgram, SpelSource
from epson_driver.simple_message import MAX_JOINTS, Dialect
from epson_driver.spel import (
    ErrorNumber,
    SpelError,
    build,
    read_project,
    with_defines,
)

DEFAULT_SPEED = 0.05  # initial Speed and Accel of a SPEL+ program


ALL_BITS, ALL_FLAGS = 4096, 1024
"""Number of bits, and of flags: the maximum, because project files do not list the I/O boards."""


def new_controller(
    model: RobotModel,
    profile: ControllerProfile,
    start: Array | None = None,
    dialect: Dialect | None = None,
    planner: Planner | None = None,
    state_period: float | None = None,
    seed: int = 0,
    spel: SpelSource | None = None,
) -> Controller:
    """Return a controller that has just booted.

    `start` is the initial arm position, shape (n,), rad (None: the position nearest to zero within
    the limits). With a `planner` the arm moves smoothly, otherwise point to point. With `spel` a
    SPEL+ program runs instead of the built-in one, and the arm moves point to point. `dialect` and
    `state_period`, s, default to the profile's. `seed`: seed of random faults. Raises ValueError
    if the start is outside the limits, or if the robot has more joints than fit in a message.
    """
    limits = model.limits
    if len(limits.names) > MAX_JOINTS:
        raise ValueError(
            f'{model.name}: {len(limits.names)} joints: a message carries at most {MAX_JOINTS}'
        )
    start_position = clipped(np.zeros(len(limits.names)), limits) if start is None else start
    controller = Controller(
        model,
        profile,
        start_position,
        dialect or Dialect(profile.byte_order),
        planner,
        profile.state.period if state_period is None else state_period,
        seed,
    )
    controller.new_command_window = _command_window
    if spel is not None:
        _run_spel(controller, spel, start_position)
    else:
        controller.clients = ClientConnections(controller)
        if not profile.program.loaded:
            controller.tables = NOTHING_LOADED
        executor = _new_executor(controller, start_position, planner)
        caps = low_power_caps(model.reach)
        controller.arm = SimulatedArm(executor, controller.servo, caps)
        motoman = profile.program.kind == 'motoman'
        controller.program = MotomanProgram(controller) if motoman else MotionProgram(controller)
    controller.apply_power()
    return controller


def with_all_boards(profile: ControllerProfile) -> ControllerProfile:
    boards = replace(
        profile.io, digital_inputs=ALL_BITS, digital_outputs=ALL_BITS, flags=ALL_FLAGS
    )
    return replace(profile, io=boards)


def program_network(profile: ControllerProfile) -> ProgramNetwork:
    """Return the network ports of a SPEL+ program: motion, state and io as in the profile."""
    ports = profile.ports
    return ProgramNetwork({ports.motion: 'motion', ports.state: 'state', ports.io: 'io'})


def _run_spel(controller: Controller, source: SpelSource, start: Array) -> None:
    controller.spel = SpelSettings(DEFAULT_SPEED, DEFAULT_SPEED)
    controller.tables = STARTED_BY_A_PERSON
    controller.clients = ClientConnections(controller, source.network)
    executor = _statements(controller, start)
    caps = low_power_caps(controller.model.reach)
    controller.arm = SimulatedArm(executor, controller.servo, caps)
    controller.program = SpelProgram(controller, executor, source)


def _statements(controller: Controller, start: Array) -> PointToPoint:
    motion = replace(controller.profile.motion, speed=DEFAULT_SPEED, accel=DEFAULT_SPEED, cp=False)
    caps = low_power_caps(controller.model.reach)
    return PointToPoint(controller.model.limits, start, motion, caps=caps, late_blend=True)


def _command_window(controller: Controller) -> SpelProgram:
    """Return an empty program for `$Execute`.

    It takes control of the arm when a command moves the arm.
    """
    executor = _statements(controller, controller.arm.commanded)

    def acquire_arm() -> None:
        if controller.clients.has_client('motion'):
            text = 'the client of the motion port controls the arm'
            raise SpelError(ErrorNumber.TASK_TYPE, text)
        if controller.real_time is not None and controller.real_time.enabled:
            raise SpelError(ErrorNumber.TASK_TYPE, 'real-time motion control controls the arm')
        controller.arm.switch_executor(executor)

    source = SpelSource(build({'': ''}), ProgramNetwork({}))
    return SpelProgram(controller, executor, source, acquire_arm)


def _new_executor(controller: Controller, start: Array, planner: Planner | None) -> Executor:
    limits, profile = controller.model.limits, controller.profile
    motion, program = profile.motion, profile.program
    caps = low_power_caps(controller.model.reach)
    if planner is None:
        return PointToPoint(
            limits,
            start,
            motion,
            acknowledge=program.acknowledge,
            caps=caps,
            timed=program.uses is FieldsUsed.DURATION or program.kind == 'motoman',
        )
    return Streaming(
        limits,
        start,
        planner,
        controller.timing,
        controller.planner_failed,
        motion,
        program.uses,
        caps.limits(limits),
    )


_NAMES = re.compile(r"^'?#define\s+(\w+)\s", re.MULTILINE)
_MS = 1000.0
TIMEOUT_DEFINE = 'CLIENT_TIMEOUT'


def profile_project(profile: ControllerProfile, model: RobotModel) -> dict[str, str]:
    """Return the files of a profile's SPEL+ project, configured for a robot model.

    The #define lines get the values of `robot_defines`, the profile's `client_timeout` and its
    `config`. Raises InputError if a value does not fit the project, and OSError if a file cannot
    be read.
    """
    files = read_project(share_path(profile.spel.project))
    defines = robot_defines(files, model)
    if TIMEOUT_DEFINE in _defined(files):
        defines[TIMEOUT_DEFINE] = f'{profile.server.client_timeout:g}'
    return with_defines(files, {**defines, **profile.spel.config})


def robot_defines(files: Mapping[str, str], model: RobotModel) -> dict[str, str]:
    """Return the values of a project's #define lines that depend on the robot.

    J1_SPEED and so on are joint speeds in degrees/s or mm/s, which users of a real robot take from
    its manual. T100_MS and RAMP_MS are acceleration times, which they measure. Values without a
    #define line in `files` are omitted. Raises InputError if the project does not support the
    robot's joints.
    """
    limits, joints, scara = model.limits, len(model.joint_names), 'm' in model.limits.units
    if f'{joints} {scara}' not in ('6 False', '4 True') and 'JOINT_COUNT' in _defined(files):
        text = f'{model.name} has {joints} joints: the project is for six axes, or a SCARA'
        raise InputError(text)
    speeds = abs(limits.velocity * model.shown_per_unit)
    result = {f'J{number + 1}_SPEED': f'{speed:.6g}' for number, speed in enumerate(speeds)}
    result['T100_MS'] = f'{max(limits.velocity / limits.acceleration) * _MS:.0f}'
    result['RAMP_MS'] = f'{max(limits.acceleration / limits.jerk) * _MS:.0f}'
    result |= {'JOINT_COUNT': str(joints), 'SCARA': '1' if scara else ''}
    result['ROBOT_MODEL'] = f'"{model.sales_name}"'
    existing = _defined(files)
    return {name: value for name, value in result.items() if name in existing}


def _defined(files: Mapping[str, str]) -> set[str]:
    return {name for text in files.values() for name in _NAMES.findall(text)}
