# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The base of robot and leader: a connected arm and its joints by name."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import numpy.typing as npt
from lerobot.utils.decorators import check_if_not_connected

from epson_driver.motion.setpoint_tracker import servo_limits
from lerobot_robot_epson.config_epson import EpsonArm

LONGEST_STEP_S = 0.07
"""Maximum time step of an action, s, so that a late action causes no jump."""

BRAKE_S = 0.06
"""Maximum braking time, s, which limits the joint speeds."""


class EpsonDevice:
    """An arm for lerobot. Joints are `joint_1.pos` and so on, rad (m)."""

    def __init__(self, config: EpsonArm) -> None:
        super().__init__(config)
        self.config = config
        self.arm = config.make_arm()
        self.limits = self.arm.model.limits
        stoppable = config.acceleration * servo_limits(self.limits, 1.0, BRAKE_S).velocity
        self.fastest = np.minimum(config.speed * self.limits.velocity, stoppable)
        self._joints = [f'{name}.pos' for name in self.limits.names]
        self._open: ExitStack | None = None

    @property
    def action_features(self) -> dict[str, type]:
        """The position of each joint."""
        return dict.fromkeys(self._joints, float)

    @property
    def is_connected(self) -> bool:
        """Whether `disconnect` is needed. A lost link raises RobotError in other methods."""
        return self._open is not None

    @property
    def is_calibrated(self) -> bool:
        """True: the encoders are absolute."""
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    configure = calibrate

    @contextmanager
    def _connecting(self) -> Iterator[ExitStack]:
        """Enter contexts, which an error closes immediately and `disconnect` closes later."""
        with ExitStack() as stack:
            yield stack
            stack.enter_context(self.arm)
            self.arm.enable()
            self._open = stack.pop_all()

    @check_if_not_connected
    def disconnect(self) -> None:
        """Stop the arm, switch the motors off, and close all connections."""
        stack, self._open = self._open, None
        stack.close()

    def _named(self, positions: npt.NDArray[np.float64]) -> dict[str, float]:
        return dict(zip(self._joints, positions.tolist(), strict=True))
