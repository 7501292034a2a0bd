# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Answers to what every port answers, and to what a port does not know (REP-I0006)."""

import logging
from collections.abc import Callable, Mapping

from epson_driver.simple_message import (
    BodyError,
    CommType,
    Frame,
    GetVersion,
    HeaderError,
    Message,
    MessageType,
    Opaque,
    Packet,
    Ping,
    ReplyCode,
    decode,
    reply,
)

VERSION = (0, 2, 0)
"""Of the controller's program, in GET_VERSION replies: major, minor, patch."""

WITHOUT_WATCHDOG = (0, 1, 0)
"""Of one that lets a motion client hang."""

Answers = Mapping[int, Callable[[], Message]]
"""What a port answers to requests besides PING, or instead of VERSION: message type to body."""

UNANSWERED = (CommType.TOPIC, CommType.SERVICE_REPLY)
"""Kinds of messages that want no answer."""

_log = logging.getLogger(__name__)


def failure(msg_type: int) -> Packet:
    """Return the FAILURE reply that is only a header."""
    return reply(Opaque(msg_type), ReplyCode.FAILURE)


def answer(packet: Packet, own: Answers) -> Packet | None:
    """Return the reply to a request, or None for topics and replies, which want none."""
    if packet.comm_type is not CommType.SERVICE_REQUEST:
        return None
    if isinstance(packet.message, Ping):
        return reply(Ping((0,) * len(packet.message.padding)), ReplyCode.SUCCESS)
    if packet.msg_type in own:
        return reply(own[packet.msg_type](), ReplyCode.SUCCESS)
    if packet.msg_type == MessageType.GET_VERSION:
        return reply(GetVersion(VERSION), ReplyCode.SUCCESS)
    return failure(packet.msg_type)


def answer_frame(frame: Frame, own: Answers) -> Packet | None:
    """Return the reply to a frame that may break the header's or the body's rules.

    None for topics and replies: two peers that answer those would do so for ever.
    """
    try:
        return answer(decode(frame), own)
    except (HeaderError, BodyError) as error:
        _log.warning('refused: %s', error)
        wanted = frame.msg_type > 0 and frame.comm_type not in UNANSWERED
        return failure(frame.msg_type) if wanted else None
