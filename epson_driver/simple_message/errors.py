# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Errors of bytes and messages: each names field, value and rule."""


class SimpleMessageError(ValueError):
    """A field of a frame or message breaks a rule of the protocol.

    `field` is the field's name on the wire (`length`, `msg_type`, `comm_type`, `reply_code`,
    `body`, or a body field such as `sequence` or `joints[3]`), `value` what it held, and `rule`
    what is allowed.
    """

    def __init__(self, field: str, value: object, rule: str) -> None:
        super().__init__(f'{field} = {value!r}: {rule}')
        self.field = field
        self.value = value
        self.rule = rule


class FrameError(SimpleMessageError):
    """An impossible length prefix, after which the position in the stream is lost."""


class HeaderError(SimpleMessageError):
    """The three header words contradict REP-I0006. The stream position is still good."""


class BodyError(SimpleMessageError):
    """The body does not fit the message type. The stream position is still good."""


class FieldError(SimpleMessageError):
    """A value cannot be encoded (wrong count, out of range of the wire type)."""
