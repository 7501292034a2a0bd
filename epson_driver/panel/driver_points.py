# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads the taught points of a driver, by its service ~/taught_points."""

from typing import Any

import numpy as np
from epson_msgs.srv import TaughtPoints
from rclpy.node import Node

from epson_driver.panel.robot_state import RobotState

PERIOD_S = 2.0
"""Minimum interval between requests, s."""

TIMEOUT_S = 5.0
"""Timeout of a request, s. A driver that has died never answers."""

MAX = 200
"""Maximum number of points shown."""


class DriverPoints:
    """Polls the taught points of a driver, and stores them in a state."""

    def __init__(self, node: Node, name: str, state: RobotState) -> None:
        self._node = node
        self._state = state
        self._client = node.create_client(TaughtPoints, f'{name}/taught_points')
        self._asking: Any = None
        self._requested_at = -np.inf

    def poll(self, now: float) -> None:
        """Send a request if one is due. `now`: the panel's clock, s."""
        if self._asking is not None and now - self._requested_at > TIMEOUT_S:
            self._give_up()
        if (
            self._asking is None
            and now - self._requested_at > PERIOD_S
            and self._client.service_is_ready()
        ):
            self._requested_at = now
            self._asking = self._client.call_async(TaughtPoints.Request())
            self._asking.add_done_callback(self._on_answer)

    def forget(self) -> None:
        """Remove the points from the state, because the driver is gone."""
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
        points = {}
        for name, pose in zip(answer.names[:MAX], answer.poses, strict=False):
            p, q = pose.position, pose.orientation
            values = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
            if np.isfinite(values).all() and abs(np.linalg.norm(values[3:]) - 1.0) < 1e-3:
                points[name] = values
        self._state.taught = points
