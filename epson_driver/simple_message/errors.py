# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Errors in bytes and messages. Each contains field, value and rule."""


class SimpleMessageError(ValueError):
    """A field of a frame or message breaks a rule of the protocol.

    `field`: the field's name on the wire (`length`, `msg_type`, `comm_type`, `reply_code`, `body`,
    or a body field such as `sequence` or `joints[3]`). `value`: its invalid value. `rule`: the
    allowed values.
    """

    def __init__(self, field: str, value: object, rule: str) -> None:
        super().__init__(f'{field} = {value!r}: {rule}')
        self.field = field
        self.value = value
        self.rule = rule


class FrameError(SimpleMessageError):
    """An impossible length prefix. The position in the stream is lost."""


class HeaderError(SimpleMessageError):
    """The header words contradict REP-I0006. The stream position is still valid."""


class BodyError(SimpleMessageError):
    """The body does not fit the message type. The stream position is still valid."""


class FieldError(SimpleMessageError):
    """A value cannot be encoded (wrong count, or out of range of the wire type)."""
