# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Which arm and which program a profile asks for."""

from typing import TYPE_CHECKING, Literal

from epson_driver.motion import Array
from epson_driver.profiles.point_fields import FieldsUsed
from epson_driver.sim_controller.arm.executor import Executor
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.mechanism import Mechanism
from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.arm.streaming import Planner, Streaming
from epson_driver.sim_controller.errors import ErrorRegister
from epson_driver.sim_controller.programs.motion_program import MotionProgram
from epson_driver.sim_controller.programs.motoman_program import MotomanProgram
from epson_driver.sim_controller.programs.program import Program

if TYPE_CHECKING:
    from epson_driver.sim_controller.core import Controller


def new_mechanism(controller: 'Controller', start: Array, planner: Planner | None) -> Mechanism:
    """Return an arm that is smooth if there is a planner, and goes point to point otherwise."""
    motion = controller.profile.motion
    caps = LowPower(motion.low_power, motion.low_power_tool_speed, controller.model.reach)
    return Mechanism(_new_arm(controller, start, planner, caps), controller.servo, caps)


def _new_arm(
    controller: 'Controller', start: Array, planner: Planner | None, caps: LowPower
) -> Executor:
    limits, profile = controller.model.limits, controller.profile
    motion, program = profile.motion, profile.program
    if planner is None:
        return PointToPoint(
            limits,
            start,
            motion.speed,
            motion.accel,
            cp=motion.cp,
            statement_overhead=motion.statement_overhead,
            acknowledge=_acknowledge(program.acknowledge, 'done'),
            caps=caps,
            timed=program.uses is FieldsUsed.DURATION,
        )
    return Streaming(
        limits,
        start,
        planner,
        controller.timing,
        controller.planner_failed,
        motion.look_ahead,
        motion.look_ahead_points,
        low_power_limits=caps.limits(limits),
        acknowledge=_acknowledge(program.acknowledge, 'taken'),
        uses=program.uses,
        speed=motion.speed,
        accel=motion.accel,
    )


def new_program(controller: 'Controller', arm: Executor, errors: ErrorRegister) -> Program:
    """Return the program that the profile names."""
    profile = controller.profile
    if profile.program.kind == 'motoman':
        return MotomanProgram(
            arm,
            profile.motion.pending_limit,
            errors,
            controller.motion_refusal,
            controller.send_reply,
            controller.trajectory_begins,
            controller,
            lambda: controller.lines.hang_up('motion'),
        )
    return MotionProgram(
        arm,
        profile.program,
        profile.motion.pending_limit,
        errors,
        controller.motion_refusal,
        controller.send_reply,
        controller.clock,
        controller.trajectory_begins,
        controller.dialect.real,
    )


_Acknowledge = Literal['taken', 'done']


def _acknowledge(asked: Literal['default', 'taken', 'done'], usual: _Acknowledge) -> _Acknowledge:
    return usual if asked == 'default' else asked
