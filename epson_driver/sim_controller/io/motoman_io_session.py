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
_OUT_OF_RANGE = 'it must be an existing general input or output'

_log = logging.getLogger(__name__)


class _AddressError(Exception):
    """An I/O address does not exist. The message gives the reason."""


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
            io_type, index = _bit(message.address)
            return ReadIoBitReply(self._points.read(io_type, index), MotomanIoResult.OK)
        except (_AddressError, IoError) as error:
            return ReadIoBitReply(0, _refused(MotomanIoResult.READ_ADDRESS_INVALID, error))

    def _read_group(self, message: ReadIoGroup) -> ReadIoGroupReply:
        try:
            io_type, group = _group(message.address)
            value = self._points.read_port(io_type, group, BYTE_BITS)
        except (_AddressError, IoError) as error:
            return ReadIoGroupReply(0, _refused(MotomanIoResult.READ_ADDRESS_INVALID, error))
        return ReadIoGroupReply(value, MotomanIoResult.OK)

    def _write_bit(self, message: WriteIoBit) -> WriteIoBitReply:
        try:
            io_type, index = _bit(message.address)
            self._points.write(io_type, index, message.value)
        except (_AddressError, IoError) as error:
            return WriteIoBitReply(_not_written(error))
        return WriteIoBitReply(MotomanIoResult.OK)

    def _write_group(self, message: WriteIoGroup) -> WriteIoGroupReply:
        try:
            io_type, group = _group(message.address)
            self._points.write_port(io_type, group, BYTE_BITS, message.value)
        except (_AddressError, IoError) as error:
            return WriteIoGroupReply(_not_written(error))
        return WriteIoGroupReply(MotomanIoResult.OK)


def _bit(address: int) -> tuple[IoType, int]:
    group, place = divmod(address, _BIT_DIGITS)
    if place >= BYTE_BITS:
        raise _AddressError(f'address {address}: its last digit must be 0 to {BYTE_BITS - 1}')
    io_type, number = _group(group)
    return io_type, number * BYTE_BITS + place


def _group(address: int) -> tuple[IoType, int]:
    if GENERAL_INPUTS <= address < GENERAL_OUTPUTS - 1:
        return IoType.DIGITAL_INPUT, address - GENERAL_INPUTS
    if GENERAL_OUTPUTS <= address < 2 * GENERAL_OUTPUTS - 2:
        return IoType.DIGITAL_OUTPUT, address - GENERAL_OUTPUTS
    raise _AddressError(f'group {address}: {_OUT_OF_RANGE}')


def _not_written(error: _AddressError | IoError) -> MotomanIoResult:
    wrong_value = isinstance(error, IoError) and error.result == IoResult.VALUE_OUT_OF_RANGE
    result = MotomanIoResult.WRITE_ADDRESS_INVALID
    return _refused(MotomanIoResult.WRITE_VALUE_INVALID if wrong_value else result, error)


def _refused(result: MotomanIoResult, error: Exception) -> MotomanIoResult:
    _log.warning('refused (%d, %s): %s', result, result.name, error)
    return result


def _invalid(frame: Frame, subcode: Invalid, why: str) -> IoCtrlReply:
    _log.warning('message type %d refused (%s): %s', frame.msg_type, subcode.name, why)
    return IoCtrlReply(Result.INVALID, subcode)
