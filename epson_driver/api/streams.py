# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Methods of a Robot that send streams of setpoints to the driver's servo.

After a stop, the servo only accepts setpoints again after a pause in the stream. Therefore invalid
setpoints are also reported to the servo: a program that sends them has not paused.
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
"""Name of the stream in log and error texts. All methods of a Robot share one stream."""

MAX_JUMP_RAD = 0.5
"""Maximum step of a joint between two pose setpoints, rad. A larger step is rejected."""

OFF_COURSE = 0.02
"""Maximum deviation from the requested tool velocity, as a fraction of the requested velocity. If
it is larger, the tool cannot move in this direction."""


class Streams(Arm):
    """Methods that send setpoint streams. Robot inherits all of them."""

    @checked_arguments
    def servo(self, target: 'npt.ArrayLike', velocities: 'npt.ArrayLike | None' = None) -> None:
        """Send a setpoint of a stream: joint positions, shape (n,), rad (m).

        Call this 10 to 500 times a second. velocities: joint velocities at these positions, shape
        (n,), rad/s (m/s). None: they are estimated.

        The arm follows the newest setpoint within a fraction of its limits
        (`Settings.servo_scale`), and stops at the last setpoint. The first setpoint must be within
        0.1 rad of the arm. After a stop or disable, send no setpoint for a second before starting
        again (docs/servo.md).

        Raises ArgumentError if the setpoint is invalid, RobotError or MotionError if the servo
        does not accept a setpoint now. The setpoint is then dropped.
        """
        limits = self.model.limits
        with self._received() as servo:
            joints = joint_rows('target', target, limits, rows=False)
            values = None
            if velocities is not None:
                values = joint_rows('velocities', velocities, limits, rows=False)
            self._take(servo, joints, values)

    @checked_arguments
    def servo_velocity(self, velocities: 'npt.ArrayLike') -> None:
        """Send a setpoint of a stream (see `servo`): joint velocities, shape (n,), rad/s (m/s)."""
        with self._received() as servo:
            values = joint_rows('velocities', velocities, self.model.limits, rows=False)
            _check_possible(values, self.model.limits)
            self._take(servo, velocities=values)

    @checked_arguments
    def servo_pose(self, pose: 'Pose', *, frame: str | None = None) -> None:
        """Send a setpoint of a stream (see `servo`): a pose of the tool.

        pose, frame: see `move_line`. The arm uses the configuration nearest to the current one.
        Raises PathError if the pose is out of reach or needs another configuration, and the
        exceptions of `servo`.
        """
        arm, limits = self._hand[1], self.model.limits
        with self._received() as servo:
            near = self._commanded(servo)
            target = self._frames.target('pose', pose, frame).in_base_link(arm.forward(near))
            result = arm.inverse(target, near)
            if not len(result):
                why = arm.why_unreachable(target) or 'out of reach'
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
    def servo_speed(self, velocity: 'npt.ArrayLike', *, frame: str = BASE_LINK) -> None:
        """Send a setpoint of a stream (see `servo`): a velocity of the tool, shape (6,).

        * velocity: along x y z, m/s, and about x y z, rad/s.
        * frame: axes of the velocity, 'base_link' or 'tool' (the current tool frame).

        The tool moves slower than requested where a joint would exceed its velocity limit. Raises
        PathError if the tool cannot move in this direction, and the exceptions of `servo`.
        """
        arm = self._hand[1]
        with self._received() as servo:
            target = finite_numbers('velocity', velocity)
            if target.shape != (6,):
                raise ValueError(
                    f'velocity has shape {target.shape}: must be (6,), x y z in m/s and the turn '
                    'about x y z in rad/s'
                )
            if frame not in (BASE_LINK, TOOL):
                raise ValueError(f'frame = {shown(frame)}: must be {BASE_LINK} or {TOOL}')
            near = self._commanded(servo)
            jacobian = arm.jacobian(near)
            if frame == TOOL:
                turn = arm.forward(near)[:3, :3]
                target = np.concatenate([turn @ target[:3], turn @ target[3:]])
            joints = np.linalg.lstsq(jacobian, target, rcond=1e-4)[0]
            off = float(np.linalg.norm(jacobian @ joints - target))
            if off > OFF_COURSE * float(np.linalg.norm(target)):
                raise PathError(
                    'velocity: the tool cannot move in this direction, because of a singularity '
                    'or a missing joint'
                )
            fraction = np.abs(joints) / (servo.settings.scale * self.model.limits.velocity)
            self._take(servo, velocities=joints / max(fraction.max(), 1.0))

    async def servo_end(self) -> str:
        """Wait until the stream has ended and the arm is at rest. Return a message."""
        servo = self._connection.running.servo
        while servo.active_user() is not None:
            await self._connection.next_joints()
            servo = self._connection.running.servo
        return 'no stream is followed, and the arm is at rest'

    @contextmanager
    def _received(self) -> Iterator['Servo']:
        """Yield the servo. A ValueError in the `with` block is recorded as an invalid setpoint."""
        servo = self._connection.running.servo
        try:
            yield servo
        except ValueError as error:
            servo.refuse(SOURCE, str(error))
            raise

    def _take(
        self, servo: 'Servo', positions: Array | None = None, velocities: Array | None = None
    ) -> None:
        """Pass a setpoint to the servo. Raises RobotError if the servo does not accept it."""
        from epson_driver.driver.servo.setpoint import Setpoint

        driver = self._connection.running
        why = servo.take(Setpoint(SOURCE, positions, velocities))
        if why is None:
            return
        if not servo.active:
            with refusals():
                driver.goal_queue.ready_sample(asyncio.get_running_loop().time())
        raise RobotError(f'the setpoint is refused: {why}')

    def _commanded(self, servo: 'Servo') -> Array:
        """Return the joints commanded by a stream, or measured joints, shape (n,)."""
        commanded = servo.commanded
        return self._connection.sample().positions if commanded is None else commanded


def _check_possible(velocities: Array, limits: JointLimits) -> None:
    from epson_driver.driver.servo.setpoint import MAX_SPEED_FACTOR

    fastest = MAX_SPEED_FACTOR * limits.velocity
    wrong = np.flatnonzero(np.abs(velocities) > fastest)
    if wrong.size:
        joint = int(wrong[0])
        unit = limits.units[joint]
        raise ValueError(
            f'velocities: {limits.names[joint]} = {velocities[joint]:.6g} {unit}/s is above '
            f'the joint limit, {limits.velocity[joint]:.6g} {unit}/s'
        )
