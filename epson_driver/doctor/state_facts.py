# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the messages of a state port tell of a controller, as keys of a controller profile."""

import itertools
import statistics
from collections import Counter
from collections.abc import Sequence

from epson_driver.doctor.listening import Heard
from epson_driver.simple_message import (
    ByteOrder,
    JointFeedback,
    JointPosition,
    Mode,
    Packet,
    Status,
    TriState,
    ValidFields,
)

Facts = dict[str, object]
"""Values by the keys of a controller profile."""

MIN_JOINTS = 20
MIN_STATUSES = 3
"""Messages of each kind from which habits can be seen."""

TOGETHER_SHARE = 0.3
"""A STATUS that comes sooner after the joints than this share of a period came with them."""

BROKEN_SHARE = 0.1
"""If so many pieces of a stream end within a message, it is sent byte by byte."""

MIN_PIECES = 20


def state_facts(heard: Heard) -> Facts:
    """Return what is certain from what was heard; keys about which nothing is are left out.

    At least one message must have been heard.
    """
    facts: Facts = {}
    packets = heard.packets
    order = packets[0][1].dialect.byte_order
    facts['byte_order'] = 'little' if order is ByteOrder.LITTLE else 'big'
    if heard.pieces >= MIN_PIECES:
        facts['server.byte_by_byte'] = heard.broken_pieces > BROKEN_SHARE * heard.pieces
    joints = [(at, p.message) for at, p in packets if is_joints(p)]
    statuses = [p.message for _, p in packets if isinstance(p.message, Status)]
    feedback = [m for _, m in joints if isinstance(m, JointFeedback)]
    if joints:
        facts['state.message'] = 'joint_feedback' if feedback else 'joint_position'
    if feedback:
        facts['state.feedback_time'] = any(m.valid_fields & ValidFields.TIME for m in feedback)
    if len(statuses) >= MIN_STATUSES:
        for name in ('in_motion', 'motion_possible'):
            known = any(getattr(each, name) != TriState.UNKNOWN for each in statuses)
            facts[f'state.{name}'] = known
        mode = statuses[-1].mode
        if mode in (Mode.MANUAL, Mode.AUTO):
            facts['mode'] = 'auto' if mode == Mode.AUTO else 'manual'
    if len(joints) >= MIN_JOINTS and len(statuses) >= MIN_STATUSES:
        facts |= _rhythm(packets)
    return facts


def is_joints(packet: Packet) -> bool:
    """Return whether a packet says where the joints are."""
    return isinstance(packet.message, JointPosition | JointFeedback)


def latest_joints(heard: Heard) -> tuple[float, ...] | None:
    """Return the ten joint values that came last, rad or m; None if none did."""
    for _, packet in reversed(heard.packets):
        if isinstance(packet.message, JointPosition):
            return packet.message.joints
        if isinstance(packet.message, JointFeedback):
            return packet.message.positions
    return None


def latest_status(heard: Heard) -> Status | None:
    """Return the STATUS that came last."""
    for _, packet in reversed(heard.packets):
        if isinstance(packet.message, Status):
            return packet.message
    return None


def _rhythm(packets: Sequence[tuple[float, Packet]]) -> Facts:
    """Return period, messages per STATUS, and whether the STATUS has a slot of its own."""
    kinds = [(at, is_joints(packet)) for at, packet in packets]
    at_status = [index for index, (_, joints) in enumerate(kinds) if not joints]
    share = Counter(b - a - 1 for a, b in itertools.pairwise(at_status)).most_common(1)[0][0]
    if share < 1:
        return {}
    spans = [kinds[b][0] - kinds[a][0] for a, b in itertools.pairwise(at_status)]
    after = [
        kinds[index][0] - kinds[index - 1][0]
        for index in at_status
        if index and kinds[index - 1][1]
    ]
    between = [
        b - a for (a, first), (b, second) in itertools.pairwise(kinds) if first and second
    ] or spans
    period = _mean(spans)
    if period <= 0.0:
        return {}  # what was held up, and came all at once, has no rhythm
    together = statistics.median(after) < TOGETHER_SHARE * statistics.median(between)
    slots = share if together else share + 1
    return {
        'state.period': period / slots,
        'state.joint_positions_per_status': share,
        'state.status_with_joints': together,
    }


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the middle half: a gap or a burst counts for nothing."""
    quarter = len(values) // 4
    return statistics.fmean(sorted(values)[quarter : len(values) - quarter])
