# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An arm as lerobot's Robot: observations are measured joints, actions where they should be."""

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
"""What the first action of a stream may do, s: a stream begins where the arm is."""

RISE_S = 0.2
"""From rest to full speed, and back, it takes so long, s: what is torn to and fro hardly moves."""

REST_S = 0.3
"""After so long without an action the arm rests, s, and the next one begins a stream."""


class EpsonRobot(EpsonDevice, Robot):
    """Follows joint positions through epson_driver's streams.

    `connect` switches the motors on. What the driver refuses raises its RobotError: the arm rests.
    """

    config_class = EpsonRobotConfig
    name = 'epson'

    def __init__(self, config: EpsonRobotConfig) -> None:
        super().__init__(config)
        self.cameras = make_cameras_from_configs(config.cameras)
        self._target = np.zeros(len(self._joints))
        self._velocity = np.zeros(len(self._joints))
        self._heard = -math.inf

    @property
    def observation_features(self) -> dict[str, type | tuple[int | None, ...]]:
        """The positions, and a picture of each camera."""
        seen = {name: (each.height, each.width, 3) for name, each in self.cameras.items()}
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
        """Let the arm go there, within range and speed, and return where it is sent now.

        Raises ValueError for an action that lacks a joint or is not finite, and RobotError while
        the arm cannot follow.
        """
        for name in self._joints:
            if not math.isfinite(action.get(name, math.nan)):
                raise ValueError(f'{name} = {action.get(name)}: an action has all joints, finite')
        wanted = np.array([float(action[name]) for name in self._joints])
        now = time.perf_counter()
        step = min(now - self._heard, LONGEST_STEP_S)
        if now - self._heard > REST_S:
            self._target, self._velocity, step = self.arm.joints, 0.0 * wanted, BEGIN_S
        low, high = self.limits.position_min, self.limits.position_max
        way = np.clip(wanted, low, high) - self._target
        slower = self.fastest * step / RISE_S  # so much in this step
        stoppable = (np.sqrt(slower**2 + 8.0 * slower * np.abs(way) / step) - slower) / 2.0
        fastest = np.minimum(self.fastest, stoppable) + 1e-12
        turn = way / step / max(np.max(np.abs(way) / (fastest * step)), 1.0) - self._velocity
        self._velocity = self._velocity + turn / max(np.max(np.abs(turn) / slower), 1.0)
        target = np.clip(self._target + self._velocity * step, low, high)
        self.arm.servo(target, np.zeros(len(target)))  # to rest there, not to be led beyond it
        self._target, self._heard = target, now
        return self._named(target)
