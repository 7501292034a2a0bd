# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The download interface: the arm moves after the whole trajectory has arrived.

The rules (industrial_robot_client, `motion_download_interface`; thesis chapter 3):
* The first point has sequence -1, the last -3, the others any non-negative number. Either all
  points are topics, which are not answered, or all are requests, which are answered.
* The program spends `dead_time` s on each point. The arm starts when the last one is processed.
* A download moves nothing if it is refused (an invalid point) or interrupted (a new -1, a STOP or
  the loss of the client). The remaining points of a refused download are dropped without an error,
  so the first error remains visible.
* If a download exceeds the buffer, all its points are refused, or the excess ones are lost (ABB).
"""

import logging
from dataclasses import dataclass, field
from enum import Enum

from epson_driver.profiles.profile import DownloadProfile
from epson_driver.sim_controller.condition.errors import Rejection, corrupt
from epson_driver.simple_message import CommType, JointTrajPt, SpecialSequence

_log = logging.getLogger(__name__)

FIRST = SpecialSequence.START_TRAJECTORY_DOWNLOAD
LAST = SpecialSequence.END_TRAJECTORY


class _Phase(Enum):
    """The phase of a download. The value describes how its points are treated."""

    NONE = 'no download is active'
    COLLECTING = 'they are kept'
    REJECTED = 'they are dropped until the last one'


@dataclass
class Download:
    """The points of the current download."""

    profile: DownloadProfile
    _phase: _Phase = _Phase.NONE
    _comm_type: CommType = CommType.TOPIC
    _points: list[JointTrajPt] = field(default_factory=list)
    _dropped: int = 0
    busy_until: float = 0.0
    """Time at which the program has processed all received points, s."""

    def __len__(self) -> int:
        return len(self._points)

    def concerns(self, sequence: int, comm_type: CommType) -> bool:
        """Return whether a point starts or continues a download."""
        if sequence == FIRST:
            return comm_type is not CommType.SERVICE_REPLY
        if sequence == 0 and self.rejected and comm_type is CommType.SERVICE_REQUEST:
            return False  # a stream starts
        is_active = self._phase is not _Phase.NONE and comm_type is self._comm_type
        return is_active and (sequence >= 0 or sequence == LAST)

    @property
    def rejected(self) -> bool:
        """Whether the current download was refused, and its remaining points are dropped."""
        return self._phase is _Phase.REJECTED

    def start(self, comm_type: CommType) -> None:
        """Start a new download and discard an unfinished one."""
        self.clear()
        self._phase = _Phase.COLLECTING
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
        """Discard the stored points, and drop the remaining points of this download."""
        if self._phase is _Phase.COLLECTING:
            self._phase = _Phase.REJECTED
        self._points = []
        self.busy_until = 0.0

    def end(self) -> list[JointTrajPt]:
        """End the download and return all points to execute."""
        if self._points and self._dropped:
            _log.warning('%d points of a download are lost: the buffer is full', self._dropped)
        self._phase = _Phase.NONE
        points, self._points = self._points, []
        return points

    def clear(self) -> None:
        """Discard the download and its points."""
        if self._points:
            _log.warning('an incomplete download is dropped')
        self._points = []
        self._phase = _Phase.NONE
