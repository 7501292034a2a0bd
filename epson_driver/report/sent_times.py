# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sending times of joint states, estimated from their arrival like in the driver."""

import itertools
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from epson_driver.driver.state.sender_clock import SenderClock

MIN_MESSAGES = 20
"""Minimum number of messages for an estimate. With fewer, the arrival times are used."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A state message: its arrival time, and the controller's own time stamp, if any, s."""

    time: float
    joints: bool
    told: float | None = None


def sent_times(arrivals: Sequence[Arrival]) -> list[float]:
    """Return the sending times of one connection's messages with joints, ascending, s.

    The times are on the receiver's clock and never later than the arrival.
    """
    if len(arrivals) < MIN_MESSAGES:
        return [each.time for each in arrivals if each.joints]
    gaps = [b.time - a.time for a, b in itertools.pairwise(arrivals)]
    clock = SenderClock(max(statistics.fmean(sorted(gaps)[: -len(gaps) // 20 or None]), 1e-4))
    sent: list[float] = []
    since: list[float] = []
    """The clock's time of each message."""
    told: float | None = None
    for each in arrivals:
        passed = None
        if each.told is not None:
            passed = each.told - told if told is not None and each.told > told else None
            told = each.told
        gap = clock.gap
        shift = clock.step(each.time, passed)
        if shift and gap is not None:
            for index in reversed(range(len(since))):
                if since[index] < gap:
                    break
                since[index] += shift
                sent[index] = min(sent[index] + shift, each.time)
        if each.joints:
            since.append(clock.time)
            sent.append(max(clock.measured, sent[-1] + 1e-6) if sent else clock.measured)
    return sent
