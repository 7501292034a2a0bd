# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The download interface: the arm moves after the whole trajectory has arrived.

The rules (industrial_robot_client, `motion_download_interface`; thesis chapter 3):
* The first point has sequence -1, the last -3, the others any non-negative number. All points are
  topics, which are not answered, or all points are requests, which are answered.
* The program spends `dead_time` s on each point. The arm starts when the last one is processed.
* A download moves nothing if it is refused (an invalid point) or interrupted (a new -1, a STOP or
  the loss of the client). The remaining points of a refused download are dropped without an error,
  so the first error remains visible.
* If a download exceeds the buffer, all its points are refused. An ABB controller instead loses the
  excess points.
"""

import logging
from dataclasses import dataclass, field

from epson_driver.profiles.profile import DownloadProfile
from epson_driver.sim_controller.condition.errors import Rejection, corrupt
from epson_driver.simple_message import CommType, JointTrajPt, SpecialSequence

_log = logging.getLogger(__name__)

FIRST = SpecialSequence.START_TRAJECTORY_DOWNLOAD
LAST = SpecialSequence.END_TRAJECTORY


@dataclass
class Download:
    profile: DownloadProfile
    _active: bool = False
    rejected: bool = False  # the remaining points are dropped
    _comm_type: CommType = CommType.TOPIC
    _points: list[JointTrajPt] = field(default_factory=list)
    _dropped: int = 0
    busy_until: float = 0.0  # time at which all received points are processed, s

    def __len__(self) -> int:
        return len(self._points)

    def concerns(self, sequence: int, comm_type: CommType) -> bool:
        if sequence == FIRST:
            return comm_type is not CommType.SERVICE_REPLY
        if sequence == 0 and self.rejected and comm_type is CommType.SERVICE_REQUEST:
            return False  # a stream starts
        is_active = self._active and comm_type is self._comm_type
        return is_active and (sequence >= 0 or sequence == LAST)

    def start(self, comm_type: CommType) -> None:
        self.clear()
        self._active = True
        self._dropped = 0
        self._comm_type = comm_type

    def add(self, point: JointTrajPt, now: float) -> Rejection | None:
        """Add a point at the time `now`, s. Return why the whole download is refused, or None."""
        self.busy_until = max(self.busy_until, now) + self.profile.dead_time
        if len(self._points) < self.profile.buffer:
            self._points.append(point)
            return None
        if self.profile.overflow == 'refuse':
            return corrupt(f'the download is longer than {self.profile.buffer} points')
        self._dropped += 1
        return None

    def reject(self) -> None:
        self.rejected = self._active
        self._points = []
        self.busy_until = 0.0

    def end(self) -> list[JointTrajPt]:
        if self._points and self._dropped:
            _log.warning('%d points of a download are lost: the buffer is full', self._dropped)
        self._active = self.rejected = False
        points, self._points = self._points, []
        return points

    def clear(self) -> None:
        if self._points:
            _log.warning('an incomplete download is dropped')
        self._points = []
        self._active = self.rejected = False
