# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The session of one client of Motoman's I/O port, which behaves like MotoROS.

The port is served in every condition of the controller, and outputs are unchanged when a client
disconnects. A message that does not read or write I/O is answered with IOCTRL_REPLY. docs/io.md
has a table of the addresses of bits and groups.
"""

import logging
from collections.abc import Callable, Mapping
from typing import Any

from epson_driver.sim_controller.io.io_points import BYTE_BITS, IoError, IoPoints
from epson_driver.sim_controller.ports import Send
from epson_driver.simple_message import (
    BodyError,
    Dialect,
    Frame,
    Framer,
    HeaderError,
    IoResult,
    IoType,
    Message,
    ReplyCode,
    decode,
    encode,
    reply,
)
from epson_driver.simple_message.motoman import (
    GENERAL_INPUTS,
    GENERAL_OUTPUTS,
    Invalid,
    IoCtrlReply,
    MotomanIoResult,
    ReadIoBit,
    ReadIoBitReply,
    ReadIoGroup,
    ReadIoGroupReply,
    Result,
    WriteIoBit,
    WriteIoBitReply,
    WriteIoGroup,
    WriteIoGroupReply,
)

_BIT_DIGITS = 10

_log = logging.getLogger(__name__)


class MotomanIoSession:
    def __init__(self, points: IoPoints, dialect: Dialect, send: Send) -> None:
        self._points = points
        self._dialect = dialect
        self._send = send
        self._framer = Framer(dialect.byte_order)
        self._open = True
        self._answers: Mapping[type[Message], Callable[[Any], Message]] = {
            ReadIoBit: self._read_bit,
            WriteIoBit: self._write_bit,
            ReadIoGroup: self._read_group,
            WriteIoGroup: self._write_group,
        }

    def receive(self, data: bytes) -> None:
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            message = self._answer(frame)
            code = ReplyCode.SUCCESS
            if getattr(message, 'result', 0) and not isinstance(message, IoCtrlReply):
                code = ReplyCode.FAILURE
            self._send(encode(reply(message, code), self._dialect))

    def closed(self) -> None:
        self._open = False

    def _answer(self, frame: Frame) -> Message:
        try:
            message = decode(frame).message
        except (HeaderError, BodyError) as error:
            return _invalid(frame, Invalid.MSGSIZE, str(error))
        handler = self._answers.get(type(message))
        if handler is None:
            return _invalid(frame, Invalid.MSGTYPE, 'it is not an I/O message')
        return handler(message)

    def _read_bit(self, message: ReadIoBit) -> ReadIoBitReply:
        try:
            value = self._points.read(*_bit(message.address))
        except IoError as error:
            return ReadIoBitReply(0, _refused(MotomanIoResult.READ_ADDRESS_INVALID, error))
        return ReadIoBitReply(value, MotomanIoResult.OK)

    def _read_group(self, message: ReadIoGroup) -> ReadIoGroupReply:
        try:
            value = self._points.read_port(*_group(message.address), BYTE_BITS)
        except IoError as error:
            return ReadIoGroupReply(0, _refused(MotomanIoResult.READ_ADDRESS_INVALID, error))
        return ReadIoGroupReply(value, MotomanIoResult.OK)

    def _write_bit(self, message: WriteIoBit) -> WriteIoBitReply:
        try:
            self._points.write(*_bit(message.address), message.value)
        except IoError as error:
            return WriteIoBitReply(_not_written(error))
        return WriteIoBitReply(MotomanIoResult.OK)

    def _write_group(self, message: WriteIoGroup) -> WriteIoGroupReply:
        try:
            self._points.write_port(*_group(message.address), BYTE_BITS, message.value)
        except IoError as error:
            return WriteIoGroupReply(_not_written(error))
        return WriteIoGroupReply(MotomanIoResult.OK)


def _bit(address: int) -> tuple[IoType, int]:
    group, place = divmod(address, _BIT_DIGITS)
    if place >= BYTE_BITS:
        text = f'address {address}: its last digit must be 0 to {BYTE_BITS - 1}'
        raise IoError(IoResult.INDEX_OUT_OF_RANGE, text)
    io_type, number = _group(group)
    return io_type, number * BYTE_BITS + place


def _group(address: int) -> tuple[IoType, int]:
    if GENERAL_INPUTS <= address < GENERAL_OUTPUTS - 1:
        return IoType.DIGITAL_INPUT, address - GENERAL_INPUTS
    if GENERAL_OUTPUTS <= address < 2 * GENERAL_OUTPUTS - 2:
        return IoType.DIGITAL_OUTPUT, address - GENERAL_OUTPUTS
    text = f'group {address}: it must be an existing general input or output'
    raise IoError(IoResult.INDEX_OUT_OF_RANGE, text)


def _not_written(error: IoError) -> MotomanIoResult:
    if error.result == IoResult.VALUE_OUT_OF_RANGE:
        return _refused(MotomanIoResult.WRITE_VALUE_INVALID, error)
    return _refused(MotomanIoResult.WRITE_ADDRESS_INVALID, error)


def _refused(result: MotomanIoResult, error: IoError) -> MotomanIoResult:
    _log.warning('refused (%d, %s): %s', result, result.name, error)
    return result


def _invalid(frame: Frame, subcode: Invalid, why: str) -> IoCtrlReply:
    _log.warning('message type %d refused (%s): %s', frame.msg_type, subcode.name, why)
    return IoCtrlReply(Result.INVALID, subcode)
