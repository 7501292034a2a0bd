# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a link counts, for diagnostics and reports."""

from collections import Counter, deque
from dataclasses import dataclass, field

KEPT_LATENCIES = 512


@dataclass
class LinkStatistics:
    """Counters since the link object was made, bounded in memory."""

    connections: int = 0
    connected_since: float | None = None
    """Loop time at which the present connection was established, s; None without one."""
    frames_received: int = 0
    frames_sent: int = 0
    bytes_received: int = 0
    bytes_sent: int = 0
    unsolicited_replies: int = 0
    bad_frames: Counter[str] = field(default_factory=Counter)
    """By the field that was wrong (`length`, `comm_type`, `body`, …)."""
    reply_latencies: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT_LATENCIES))
    """Seconds from a request to its reply, the newest last."""
