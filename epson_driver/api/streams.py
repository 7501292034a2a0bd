# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoints of the Python API: one more source of the driver's servo, under the same rules.

What cannot be followed is heard by the servo all the same: a program that goes on after a stop has
not let go.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from epson_driver.api.connection import Connection
from epson_driver.api.errors import PathError, RobotError, refusals
from epson_driver.api.moves import joint_rows
from epson_driver.api.poses import BASE_LINK, TOOL
from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.servo.setpoint import POSSIBLE_SHARE, Setpoint
from epson_driver.motion import Array, JointLimits
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.tool_pose import finite_numbers

SOURCE = 'servo()'
"""The source of all setpoints of a Robot: which method they come by does not matter."""

MAX_JUMP_RAD = 0.5
"""A pose that a joint would have to go so far for, from one setpoint to the next, is refused."""

OFF_COURSE = 0.02
"""As a share of what is asked for, the tool may move otherwise: more is a singularity."""


class Streams:
    """Hands setpoints to the driver of a connection. `limits`: of the joints."""

    def __init__(self, connection: Connection, limits: JointLimits) -> None:
        self._connection = connection
        self._limits = limits

    def positions(self, target: npt.ArrayLike, velocities: npt.ArrayLike | None) -> None:
        """Follow joint positions, shape (n,). Raises ArgumentError or RobotError."""
        with self._heard() as servo:
            joints = joint_rows('target', target, self._limits, rows=False)
            given = None
            if velocities is not None:
                given = joint_rows('velocities', velocities, self._limits, rows=False)
            self._take(servo, Setpoint(SOURCE, joints, given))

    def velocities(self, velocities: npt.ArrayLike) -> None:
        """Follow joint velocities, shape (n,). Raises ArgumentError or RobotError."""
        with self._heard() as servo:
            given = joint_rows('velocities', velocities, self._limits, rows=False)
            self._check_possible(given)
            self._take(servo, Setpoint(SOURCE, velocities=given))

    def pose(self, arm: Kinematics, find: Callable[[Array], Array]) -> None:
        """Follow a pose of the tool, which `find` makes of where the tool is now.

        Both shape (4, 4), m, in base_link. Raises PathError, ArgumentError or RobotError.
        """
        with self._heard() as servo:
            near = self._commanded(servo)
            pose = find(arm.forward(near))
            found = arm.inverse(pose, near)
            if not len(found):
                why = arm.why_unreachable(pose) or 'it is out of reach'
                raise PathError(f'pose: {why}')
            jump = np.abs(found[0] - near)
            if jump.max() > MAX_JUMP_RAD:
                joint = int(np.argmax(jump))
                raise PathError(
                    f'pose: {self._limits.names[joint]} would have to jump from {near[joint]:.4g} '
                    f'to {found[0][joint]:.4g} {self._limits.units[joint]}'
                )
            self._take(servo, Setpoint(SOURCE, found[0]))

    def twist(self, arm: Kinematics, twist: npt.ArrayLike, frame: str) -> None:
        """Follow a velocity of the tool: x y z, m/s, and about x y z, rad/s, shape (6,).

        Raises PathError, ArgumentError or RobotError.
        """
        with self._heard() as servo:
            wanted = finite_numbers('velocity', twist)
            if wanted.shape != (6,):
                raise ValueError(
                    f'velocity has shape {wanted.shape}: must be (6,), x y z in m/s and the turn '
                    'about x y z in rad/s'
                )
            if frame not in (BASE_LINK, TOOL):
                raise ValueError(f'frame = {frame!r}: must be {BASE_LINK} or {TOOL}')
            near = self._commanded(servo)
            jacobian = arm.jacobian(near)
            if frame == TOOL:
                turn = arm.forward(near)[:3, :3]
                wanted = np.concatenate([turn @ wanted[:3], turn @ wanted[3:]])
            joints = np.linalg.lstsq(jacobian, wanted, rcond=1e-4)[0]
            off = float(np.linalg.norm(jacobian @ joints - wanted))
            if off > OFF_COURSE * float(np.linalg.norm(wanted)):
                raise PathError(
                    'velocity: the tool cannot move that way here, at a singularity or for want '
                    'of a joint'
                )
            share = np.abs(joints) / (servo.settings.share * self._limits.velocity)
            self._take(servo, Setpoint(SOURCE, velocities=joints / max(share.max(), 1.0)))

    async def end(self) -> str:
        """Wait until no stream is followed and the arm stands, and say so."""
        servo = self._connection.running.servo
        while servo.occupation() is not None:
            await self._connection.next_joints()
            servo = self._connection.running.servo
        return 'no stream is followed, and the arm stands'

    @contextmanager
    def _heard(self) -> Iterator[Servo]:
        """Have the servo hear of a setpoint that is none, so that the stream is not let go of."""
        servo = self._connection.running.servo
        try:
            yield servo
        except ValueError as error:
            servo.refuse(SOURCE, str(error))
            raise

    def _take(self, servo: Servo, setpoint: Setpoint) -> None:
        """Raise RobotError unless it is followed."""
        driver = self._connection.running
        why = servo.take(setpoint)
        if why is None:
            return
        if not servo.active:
            with refusals():
                driver.goal_queue.check_ready(asyncio.get_running_loop().time())
        raise RobotError(f'the setpoint is not followed: {why}')

    def _commanded(self, servo: Servo) -> Array:
        """Return where the joints are sent now, shape (n,), or are, without a stream."""
        commanded = servo.commanded
        return self._connection.sample().positions if commanded is None else commanded

    def _check_possible(self, velocities: Array) -> None:
        fastest = POSSIBLE_SHARE * self._limits.velocity
        wrong = np.flatnonzero(np.abs(velocities) > fastest)
        if wrong.size:
            joint = int(wrong[0])
            unit = self._limits.units[joint]
            raise ValueError(
                f'velocities: {self._limits.names[joint]} = {velocities[joint]:.6g} {unit}/s is '
                f'beyond what the joint can do, {self._limits.velocity[joint]:.6g} {unit}/s'
            )
