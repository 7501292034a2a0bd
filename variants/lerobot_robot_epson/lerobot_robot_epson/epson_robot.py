# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An arm as lerobot's Robot. Observations are measured joints and actions joint targets."""

import math
import time

import numpy as np
from lerobot.cameras import make_cameras_from_configs
from lerobot.lerobot_types import RobotAction, RobotObservation
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_robot_epson.config_epson import EpsonRobotConfig
from lerobot_robot_epson.epson_device import LONGEST_STEP_S, EpsonDevice

BEGIN_S = 0.005
"""Time step of the first action of a stream, s. A stream starts at the measured position."""

RISE_S = 0.2
"""Time from rest to full speed, s. Rapidly alternating actions therefore cause little motion."""

REST_S = 0.3
"""Time without an action, s, after which the arm is at rest and a new stream starts."""


class EpsonRobot(EpsonDevice, Robot):
    """Follows joint positions through epson_driver's streams.

    `connect` switches the motors on. A refusal by the driver raises its RobotError, at rest.
    """

    config_class = EpsonRobotConfig
    name = 'epson'

    def __init__(self, config: EpsonRobotConfig) -> None:
        super().__init__(config)
        self.cameras = make_cameras_from_configs(config.cameras)
        self._target = np.zeros(len(self._joints))
        self._velocity = np.zeros(len(self._joints))
        self._last_action = -math.inf

    @property
    def observation_features(self) -> dict[str, type | tuple[int | None, ...]]:
        """The positions, and a picture of each camera."""
        seen = {name: (item.height, item.width, 3) for name, item in self.cameras.items()}
        return {**self.action_features, **seen}

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Connect cameras and arm, and switch the motors on. Raises RobotError."""
        with self._connecting() as stack:
            for camera in self.cameras.values():
                camera.connect()
                stack.callback(camera.disconnect)

    @check_if_not_connected
    def get_observation(self) -> RobotObservation:
        """Return the measured joints and the newest pictures. Raises RobotError."""
        pictures = {name: camera.read_latest() for name, camera in self.cameras.items()}
        return {**self._named(self.arm.joints), **pictures}

    @check_if_not_connected
    def send_action(self, action: RobotAction) -> RobotAction:
        """Move towards the action within range and speed limits. Return the sent target.

        Raises ValueError for an action that lacks a joint or is not finite, and RobotError while
        the arm cannot follow.
        """
        for name in self._joints:
            if not math.isfinite(action.get(name, math.nan)):
                raise ValueError(f'{name} = {action.get(name)}: an action has all joints, finite')
        wanted = np.array([float(action[name]) for name in self._joints])
        now = time.perf_counter()
        step = min(now - self._last_action, LONGEST_STEP_S)
        if now - self._last_action > REST_S:
            self._target, self._velocity, step = self.arm.joints, 0.0 * wanted, BEGIN_S
        low, high = self.limits.position_min, self.limits.position_max
        distance = np.clip(wanted, low, high) - self._target
        slower = self.fastest * step / RISE_S  # maximum change of velocity in this step
        stoppable = (np.sqrt(slower**2 + 8.0 * slower * np.abs(distance) / step) - slower) / 2.0
        fastest = np.minimum(self.fastest, stoppable) + 1e-12
        slowdown = max(np.max(np.abs(distance) / (fastest * step)), 1.0)
        change = distance / step / slowdown - self._velocity
        self._velocity = self._velocity + change / max(np.max(np.abs(change) / slower), 1.0)
        target = np.clip(self._target + self._velocity * step, low, high)
        self.arm.servo(target, np.zeros(len(target)))  # zero velocity avoids extrapolation
        self._target, self._last_action = target, now
        return self._named(target)
