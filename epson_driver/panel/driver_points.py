# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The points taught to a driver, from its service ~/taught_points."""

from typing import Any

import numpy as np
from epson_msgs.srv import TaughtPoints
from rclpy.node import Node

from epson_driver.panel.robot_state import RobotState

PERIOD_S = 2.0
TIMEOUT_S = 5.0
"""Timeout, s. A driver that has died in between never answers."""

MAX = 200
"""Maximum number of points shown."""


class DriverPoints:
    """Polls the points, one request at a time, and stores the answer in a state."""

    def __init__(self, node: Node, name: str, state: RobotState) -> None:
        self._node = node
        self._state = state
        self._client = node.create_client(TaughtPoints, f'{name}/taught_points')
        self._asking: Any = None
        self._asked = -np.inf

    def look(self, now: float) -> None:
        """Send a request if one is due. `now`: the panel's clock, s."""
        if self._asking is not None and now - self._asked > TIMEOUT_S:
            self._give_up()
        if (
            self._asking is None
            and now - self._asked > PERIOD_S
            and self._client.service_is_ready()
        ):
            self._asked = now
            self._asking = self._client.call_async(TaughtPoints.Request())
            self._asking.add_done_callback(self._on_answer)

    def forget(self) -> None:
        """Drop the points, because the driver is gone."""
        self._give_up()
        self._state.taught = {}

    def close(self) -> None:
        """Stop sending requests."""
        self._give_up()
        self._node.destroy_client(self._client)

    def _give_up(self) -> None:
        if self._asking is not None:
            self._client.remove_pending_request(self._asking)
            self._asking = None

    def _on_answer(self, future: Any) -> None:
        answer = future.result()
        if future is not self._asking:
            return
        self._asking = None
        if answer is None:
            return
        match = {}
        for name, pose in zip(answer.names[:MAX], answer.poses, strict=False):
            at, turn = pose.position, pose.orientation
            values = np.array([at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w])
            if np.isfinite(values).all() and abs(np.linalg.norm(values[3:]) - 1.0) < 1e-3:
                match[name] = values
        self._state.taught = match
