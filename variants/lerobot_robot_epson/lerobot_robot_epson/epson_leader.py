# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A second arm as lerobot's Teleoperator: keys or a slow wave move it, another one follows."""

import math
import time

from lerobot.lerobot_types import RobotAction
from lerobot.teleoperators import Teleoperator
from lerobot.teleoperators.keyboard import KeyboardTeleop, KeyboardTeleopConfig
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_robot_epson.config_epson import EpsonLeaderConfig
from lerobot_robot_epson.epson_device import LONGEST_STEP_S, EpsonDevice

KEYS = ('qa', 'ws', 'ed', 'rf', 'tg', 'yh')
"""For each joint the key that turns it forward, and back."""


class EpsonLeader(EpsonDevice, Teleoperator):
    """Leads by its own joints. Keys are those that lerobot sees: on X11, Windows and macOS."""

    config_class = EpsonLeaderConfig
    name = 'epson_leader'

    def __init__(self, config: EpsonLeaderConfig) -> None:
        super().__init__(config)
        if config.hand not in ('keys', 'wave'):
            raise ValueError(f'hand = {config.hand!r}: must be keys or wave')
        self._keyboard = KeyboardTeleop(KeyboardTeleopConfig())
        self._first, self._turn, self._asked = None, 0.0, 0.0

    @property
    def feedback_features(self) -> dict[str, type]:
        """None: the leader feels nothing."""
        return {}

    def send_feedback(self, feedback: dict[str, float]) -> None:
        """Do nothing."""

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Connect, switch the motors on, and listen to the keys. Raises RobotError."""
        with self._connecting() as stack:
            if self.config.hand == 'keys':
                self._keyboard.connect()
                if not self._keyboard.is_connected:
                    raise RuntimeError('no keys: lerobot sees them on X11, Windows and macOS only')
                stack.callback(self._keyboard.listener.stop)
        self._first, self._turn = self.arm.joints, 0.0

    @check_if_not_connected
    def get_action(self) -> RobotAction:
        """Move on, and return where the joints are. Raises RobotError."""
        if self.config.hand == 'keys':
            pressed = self._keyboard.get_action()
            turns = [(more in pressed) - (less in pressed) for more, less in KEYS]
            self.arm.servo_velocity(turns[: len(self.fastest)] * self.fastest)
        else:
            passed, self._asked = time.monotonic() - self._asked, time.monotonic()
            self._turn += 2.0 * math.pi * min(passed, LONGEST_STEP_S) / self.config.period
            joints = self._first.copy()
            joints[0] += self.config.amplitude * (1.0 - math.cos(self._turn)) / 2.0
            self.arm.servo(joints)
        return self._named(self.arm.joints)
