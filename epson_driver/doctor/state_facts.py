# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Measures properties of a controller from its state messages.

The properties have the names of the keys of a controller profile.
"""

import itertools
import statistics
from collections import Counter
from collections.abc import Sequence
from typing import Self

from epson_driver.doctor.listening import ReceivedTraffic
from epson_driver.simple_message import (
    ByteOrder,
    JointFeedback,
    JointPosition,
    Mode,
    Packet,
    Status,
    ValidFields,
)

Facts = dict[str, object]

MIN_JOINTS = 20
MIN_STATUSES = 3

SAME_CYCLE_FRACTION = 0.3
"""A STATUS up to this fraction of a period after a joint state belongs to the same cycle."""

MAX_UNCERTAINTY_FRACTION = 0.25
"""Maximum uncertainty of a measured period, as a fraction of the period. A period with a larger
uncertainty is omitted."""


def state_facts(traffic: ReceivedTraffic) -> Facts:
    """Return the controller's properties that one or more received messages prove."""
    facts: Facts = {}
    packets = traffic.packets
    order = packets[0][1].dialect.byte_order
    facts['byte_order'] = 'little' if order is ByteOrder.LITTLE else 'big'
    joints = [(time, p.message) for time, p in packets if is_joints(p)]
    statuses = [p.message for _, p in packets if isinstance(p.message, Status)]
    feedback = [m for _, m in joints if isinstance(m, JointFeedback)]
    if joints:
        facts['state.message'] = 'joint_feedback' if feedback else 'joint_position'
    if feedback:
        facts['state.feedback_time'] = any(m.valid_fields & ValidFields.TIME for m in feedback)
    if len(statuses) >= MIN_STATUSES:
        mode = statuses[-1].mode
        if mode in (Mode.MANUAL, Mode.AUTO):
            facts['mode'] = 'auto' if mode == Mode.AUTO else 'manual'
    if len(joints) >= MIN_JOINTS and len(statuses) >= MIN_STATUSES:
        facts |= _rhythm(traffic)
    return facts


def is_joints(packet: Packet) -> bool:
    return isinstance(packet.message, JointPosition | JointFeedback)


def latest_joints(traffic: ReceivedTraffic) -> tuple[float, ...] | None:
    """Return the newest ten joint values, rad or m, or None if none were received."""
    for _, packet in reversed(traffic.packets):
        if isinstance(packet.message, JointPosition):
            return packet.message.joints
        if isinstance(packet.message, JointFeedback):
            return packet.message.positions
    return None


def latest_status(traffic: ReceivedTraffic) -> Status | None:
    for _, packet in reversed(traffic.packets):
        if isinstance(packet.message, Status):
            return packet.message
    return None


class Measured(float):
    uncertainty: float

    def __new__(cls, value: float, uncertainty: float = 0.0) -> Self:
        made = super().__new__(cls, value)
        made.uncertainty = uncertainty
        return made


def rhythm(times: Sequence[float], lateness: float = 0.0) -> Measured | None:
    """Return the period of messages from their arrival times, s, or None if there are too few.

    The period is the median time from message i to message i + n/2, divided by n/2. Bursts and
    single gaps do not change this median, because TCP delays messages but loses none. `lateness`:
    uncertainty of each time, s.
    """
    half = len(times) // 2
    if half < MIN_JOINTS // 2:
        return None
    slopes = sorted((b - a) / half for a, b in zip(times, times[half:], strict=False))
    quarter = len(slopes) // 4
    spread = slopes[len(slopes) - 1 - quarter] - slopes[quarter]
    return Measured(statistics.median(slopes), spread + lateness / half)


def _rhythm(traffic: ReceivedTraffic) -> Facts:
    """Return the facts about timing.

    They are the period of the state task, and the number of joint states per STATUS. A STATUS is
    sent together with a joint state, or in a cycle without a joint state. Facts that are uncertain
    because of bursts or late timers of this machine are omitted.
    """
    kinds = [(time, is_joints(packet)) for time, packet in traffic.packets]
    at_status = [index for index, (_, joints) in enumerate(kinds) if not joints]
    fraction = Counter(b - a - 1 for a, b in itertools.pairwise(at_status)).most_common(1)[0][0]
    result = rhythm([time for time, joints in kinds if joints], traffic.lateness)
    if fraction < 1 or result is None or result <= 0.0:
        return {}
    after = [kinds[i][0] - kinds[i - 1][0] for i in at_status if i and kinds[i - 1][1]]
    margin = statistics.fmean(after) - SAME_CYCLE_FRACTION * result
    doubt = 3.0 * statistics.pstdev(after) / len(after) ** 0.5
    facts: Facts = {'state.joint_positions_per_status': fraction}
    if abs(margin) > doubt and result.uncertainty < MAX_UNCERTAINTY_FRACTION * result:
        together = margin < 0.0
        slots = fraction if together else fraction + 1
        facts['state.period'] = Measured(result * fraction / slots, result.uncertainty)
        facts['state.status_with_joints'] = together
    return facts
