# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints: a source of the driver's servo, subject to the same rules.

An invalid setpoint is also reported to the servo. A program that keeps sending after a stop has
not released its stream, even if its setpoints are invalid.
"""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from epson_driver.api.arm import Arm
from epson_driver.api.errors import PathError, RobotError, checked_arguments, refusals
from epson_driver.api.moves import joint_rows
from epson_driver.api.poses import BASE_LINK, TOOL, Pose
from epson_driver.inputs import shown
from epson_driver.motion import Array, JointLimits
from epson_driver.tool_motion.tool_pose import finite_numbers

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.driver.servo.servo import Servo

SOURCE = 'servo()'
"""Source name of all setpoints of a Robot, shared by its methods."""

MAX_JUMP_RAD = 0.5
"""Maximum joint step between two pose setpoints. A pose that needs more is rejected."""

OFF_COURSE = 0.02
"""Maximum deviation from the requested tool velocity, as a fraction of it. A larger one indicates
a singularity."""


class Streams(Arm):
    """Streams of setpoints for an arm. Robot inherits all of them."""

    @checked_arguments
    def servo(self, target: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> None:
        """Follow joint positions, shape (n,), rad (m), sent 10 to 500 times a second.

        velocities: the velocities at these positions, shape (n,); None: estimated. Only the newest
        setpoint is used. The arm follows within a fraction of its limits (`Settings.servo_scale`).
        The first setpoint must be within 0.1 rad of the arm, and the arm stops at the last one.
        After a stop or a disable, a stream must be silent for a second before it can restart
        (docs/servo.md).

        Raises ArgumentError for an invalid setpoint. Raises RobotError or MotionError with the
        reason while the stream is not followed. The setpoint is then dropped.
        """
        limits = self.model.limits
        with self._received() as servo:
            joints = joint_rows('target', target, limits, rows=False)
            given = None
            if velocities is not None:
                given = joint_rows('velocities', velocities, limits, rows=False)
            self._take(servo, joints, given)

    @checked_arguments
    def servo_velocity(self, velocities: npt.ArrayLike) -> None:
        """Follow joint velocities, shape (n,), rad/s (m/s). Otherwise like `servo`."""
        with self._received() as servo:
            given = joint_rows('velocities', velocities, self.model.limits, rows=False)
            _check_possible(given, self.model.limits)
            self._take(servo, velocities=given)

    @checked_arguments
    def servo_pose(self, pose: Pose, *, frame: str | None = None) -> None:
        """Follow a pose of the tool, in any form and frame that `move_line` accepts.

        The configuration nearest to the current one is used. Raises PathError for a pose that is
        out of reach or needs another configuration. Otherwise like `servo`.
        """
        arm, limits = self._hand[1], self.model.limits
        with self._received() as servo:
            near = self._commanded(servo)
            wanted = self._frames.target('pose', pose, frame).seen_from(arm.forward(near))
            result = arm.inverse(wanted, near)
            if not len(result):
                why = arm.why_unreachable(wanted) or 'out of reach'
                raise PathError(f'pose: {why}')
            jump = np.abs(result[0] - near)
            if jump.max() > MAX_JUMP_RAD:
                joint = int(np.argmax(jump))
                raise PathError(
                    f'pose: {limits.names[joint]} would have to jump from {near[joint]:.4g} to '
                    f'{result[0][joint]:.4g} {limits.units[joint]}'
                )
            self._take(servo, result[0])

    @checked_arguments
    def servo_speed(self, velocity: npt.ArrayLike, *, frame: str = BASE_LINK) -> None:
        """Follow a velocity of the tool: x y z, m/s, and about x y z, rad/s, shape (6,).

        frame: axes of the velocity, 'base_link' or 'tool' (the current tool frame). The motion is
        slower where a joint would be too fast. Raises PathError where the tool cannot move in this
        direction. Otherwise like `servo`.
        """
        arm = self._hand[1]
        with self._received() as servo:
            wanted = finite_numbers('velocity', velocity)
            if wanted.shape != (6,):
                raise ValueError(
                    f'velocity has shape {wanted.shape}: must be (6,), x y z in m/s and the turn '
                    'about x y z in rad/s'
                )
            if frame not in (BASE_LINK, TOOL):
                raise ValueError(f'frame = {shown(frame)}: must be {BASE_LINK} or {TOOL}')
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
            fraction = np.abs(joints) / (servo.settings.share * self.model.limits.velocity)
            self._take(servo, velocities=joints / max(fraction.max(), 1.0))

    async def servo_end(self) -> str:
        """Wait until no stream is followed and the arm is at rest. Return a message."""
        servo = self._connection.running.servo
        while servo.active_user() is not None:
            await self._connection.next_joints()
            servo = self._connection.running.servo
        return 'no stream is followed, and the arm is at rest'

    @contextmanager
    def _received(self) -> Iterator['Servo']:
        """Report an invalid setpoint to the servo, so the stream does not count as released."""
        servo = self._connection.running.servo
        try:
            yield servo
        except ValueError as error:
            servo.refuse(SOURCE, str(error))
            raise

    def _take(
        self, servo: 'Servo', positions: Array | None = None, velocities: Array | None = None
    ) -> None:
        """Pass a setpoint to the servo. Raises RobotError if it is not followed."""
        from epson_driver.driver.servo.setpoint import Setpoint

        driver = self._connection.running
        why = servo.take(Setpoint(SOURCE, positions, velocities))
        if why is None:
            return
        if not servo.active:
            with refusals():
                driver.goal_queue.ready_sample(asyncio.get_running_loop().time())
        raise RobotError(f'the setpoint is not followed: {why}')

    def _commanded(self, servo: 'Servo') -> Array:
        """Return the joints commanded by the stream, shape (n,), or else the measured ones."""
        commanded = servo.commanded
        return self._connection.sample().positions if commanded is None else commanded


def _check_possible(velocities: Array, limits: JointLimits) -> None:
    from epson_driver.driver.servo.setpoint import POSSIBLE_SHARE

    fastest = POSSIBLE_SHARE * limits.velocity
    wrong = np.flatnonzero(np.abs(velocities) > fastest)
    if wrong.size:
        joint = int(wrong[0])
        unit = limits.units[joint]
        raise ValueError(
            f'velocities: {limits.names[joint]} = {velocities[joint]:.6g} {unit}/s is above '
            f'the joint limit, {limits.velocity[joint]:.6g} {unit}/s'
        )
