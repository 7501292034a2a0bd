# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's inputs, outputs and memory bits, used by its programs and its remote port.

A point is addressed by type and index. Digital points and flags are 0 or 1, analogue points are in
mV. A group combines digital points into one number. Group k is byte port k of SPEL+ (`In`, `Out`),
with points 8k to 8k+7, of which point 8k is the lowest bit. Group WORD_GROUPS + k is word port k
(`InW`, `OutW`), with points 16k to 16k+15. Bits above the last point read as 0 and cannot be set.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from epson_driver.profiles.io_profile import IoProfile, Point
from epson_driver.simple_message import IoRange, IoResult, IoType
from epson_driver.simple_message.io_messages import IoFeature

BYTE_BITS = 8
WORD_BITS = 16
WORD_GROUPS = 1000  # index of the group for word port 0. Lower groups are byte ports
Listener = Callable[[], None]
_log = logging.getLogger(__name__)


class IoError(Exception):
    """An I/O access is refused. The message names the address and the permitted values."""

    def __init__(self, result: IoResult, sentence: str) -> None:
        super().__init__(sentence)
        self.result = result


@dataclass(frozen=True, slots=True)
class _Kind:
    """The names of a type of points, and whether clients of the I/O port may write to it."""

    short: str
    name: str
    writable: bool
    bits: IoType | None = None  # type of the points of a group


_KINDS = {
    IoType.DIGITAL_INPUT: _Kind('DI', 'digital inputs', False),
    IoType.DIGITAL_OUTPUT: _Kind('DO', 'digital outputs', True),
    IoType.ANALOG_INPUT: _Kind('AI', 'analogue inputs', False),
    IoType.ANALOG_OUTPUT: _Kind('AO', 'analogue outputs', True),
    IoType.GROUP_INPUT: _Kind('GI', 'groups of inputs', False, IoType.DIGITAL_INPUT),
    IoType.GROUP_OUTPUT: _Kind('GO', 'groups of outputs', True, IoType.DIGITAL_OUTPUT),
    IoType.FLAG: _Kind('flag', 'flags', True),
}

_INPUTS = (IoType.DIGITAL_INPUT, IoType.ANALOG_INPUT)
_ANALOG = (IoType.ANALOG_INPUT, IoType.ANALOG_OUTPUT)
_PORTS = (IoType.DIGITAL_INPUT, IoType.DIGITAL_OUTPUT, IoType.FLAG)


class IoPoints:
    """The values of all points.

    Initially outputs have their safe values, and other points are 0.
    """

    def __init__(self, profile: IoProfile) -> None:
        self.profile = profile
        self._values: dict[IoType, list[int]] = {
            IoType.DIGITAL_INPUT: [0] * profile.digital_inputs,
            IoType.DIGITAL_OUTPUT: [0] * profile.digital_outputs,
            IoType.ANALOG_INPUT: [0] * profile.analog_inputs,
            IoType.ANALOG_OUTPUT: [0] * profile.analog_outputs,
            IoType.FLAG: [0] * profile.flags,
        }
        self._listeners: list[Listener] = []
        self._writers: set[object] = set()
        self._make_safe(profile.outputs)

    # One point, or one group.

    def read(self, io_type: int, index: int) -> int:
        kind, known = self._checked(io_type, index)
        if kind.bits is not None:
            return self.read_port(kind.bits, *_port(index))
        return self._values[known][index]

    def write(self, io_type: int, index: int, value: int) -> None:
        """Set a point. Raises IoError, and changes nothing, if an argument is invalid."""
        kind, known = self._checked(io_type, index)
        if not kind.writable:
            raise IoError(
                IoResult.TYPE_FEATURE_UNSUPPORTED,
                f'{kind.short} {index} = {value}: an input cannot be written',
            )
        self._set(kind, known, index, value)

    def set_input(self, io_type: int, index: int, value: int) -> None:
        kind, known = self._checked(io_type, index)
        if kind.bits not in _INPUTS and known not in _INPUTS:
            raise IoError(
                IoResult.TYPE_FEATURE_UNSUPPORTED, f'{kind.short} {index} = {value}: no input'
            )
        self._set(kind, known, index, value)

    def reset_point(self, io_type: int, index: int) -> None:
        """Set an output or a group of outputs to its safe value, or a flag to 0."""
        kind, known = self._checked(io_type, index)
        if not kind.writable:
            raise IoError(
                IoResult.TYPE_FEATURE_UNSUPPORTED,
                f'{kind.short} {index}: an input cannot be reset',
            )
        if kind.bits is not None:
            self._make_safe((kind.bits, bit) for bit in self._bits(kind.bits, *_port(index)))
        else:
            self._make_safe([(known, index)])

    # Many digital points or flags as one number.

    def read_port(self, io_type: IoType, port: int, width: int) -> int:
        """Return `width` points as one number. Point `width * port` is the lowest bit."""
        values = self._values[io_type]
        bits = self._bits(io_type, port, width)
        return sum(values[bit] << shift for shift, bit in enumerate(bits))

    def write_port(self, io_type: IoType, port: int, width: int, value: int) -> None:
        if not _KINDS[io_type].writable:
            text = f'{_KINDS[io_type].short} port {port}: an input cannot be written'
            raise IoError(IoResult.TYPE_FEATURE_UNSUPPORTED, text)
        self._set_port(io_type, port, width, value)

    def set_input_port(self, port: int, width: int, value: int) -> None:
        self._set_port(IoType.DIGITAL_INPUT, port, width, value)

    # Ranges of points.

    def ranges(self) -> tuple[IoRange, ...]:
        result = []
        for io_type, kind in _KINDS.items():
            features = IoFeature.STREAMING
            if kind.writable:
                features |= IoFeature.RESET
            result += [
                IoRange(io_type, start, count, features) for start, count in self._spans(io_type)
            ]
        return tuple(result)

    def check_range(self, io_type: int, start: int, count: int) -> None:
        """Raise IoError if a range is empty or contains a point that does not exist."""
        kind, _ = self._checked(io_type, start)
        last = start + count - 1
        if not any(
            first <= start <= last < first + size for first, size in self._spans(IoType(io_type))
        ):
            text = f'{kind.short} {start}, {count} points: {self._there_are(IoType(io_type))}'
            raise IoError(IoResult.INDEX_OUT_OF_RANGE, text)

    def read_range(self, io_type: int, start: int, count: int) -> tuple[int, ...]:
        """Return the values of a range that `check_range` accepts."""
        known = IoType(io_type)
        if _KINDS[known].bits is None:
            return tuple(self._values[known][start : start + count])
        return tuple(self.read(known, index) for index in range(start, start + count))

    # Events that affect all points.

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` after each change, until the returned function is called."""
        self._listeners.append(listener)

        def stop() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return stop

    def reset(self) -> None:
        """Set all outputs to their safe values, except those in the profile's `keep_on_reset`."""
        self._make_safe(self.profile.outputs - self.profile.keep_on_reset)

    def boot(self) -> None:
        flags = ((IoType.FLAG, index) for index in range(self.profile.flags))
        self._make_safe([*self.profile.outputs, *flags])

    def client_wrote(self, client: object) -> None:
        self._writers.add(client)

    def client_gone(self, client: object) -> None:
        """Record that a client has disconnected.

        If no other connected client has written outputs, and this one has, set all outputs to
        their safe values, except those in the profile's `keep_on_link_loss`.
        """
        if client not in self._writers:
            return
        self._writers.discard(client)
        if not self._writers:
            _log.warning('the last I/O client that wrote outputs has disconnected: safe values')
            self._make_safe(self.profile.outputs - self.profile.keep_on_link_loss)

    # Internals.

    def _checked(self, io_type: int, index: int) -> tuple[_Kind, IoType]:
        if io_type not in _KINDS:
            text = f'type {io_type}: unknown type of I/O, must be 1 to {len(_KINDS)}'
            raise IoError(IoResult.TYPE_UNSUPPORTED, text)
        known = IoType(io_type)
        kind = _KINDS[known]
        spans = self._spans(known)
        if not spans:
            text = f'{kind.short} {index}: {self._there_are(known)}'
            raise IoError(IoResult.TYPE_UNSUPPORTED, text)
        if not any(start <= index < start + count for start, count in spans):
            text = f'{kind.short} {index}: {self._there_are(known)}'
            raise IoError(IoResult.INDEX_OUT_OF_RANGE, text)
        return kind, known

    def _spans(self, io_type: IoType) -> list[tuple[int, int]]:
        bits = _KINDS[io_type].bits
        if bits is None:
            spans = [(0, len(self._values[io_type]))]
        else:
            points = len(self._values[bits])
            spans = [(0, -(-points // BYTE_BITS)), (WORD_GROUPS, -(-points // WORD_BITS))]
        return [(start, count) for start, count in spans if count]

    def _there_are(self, io_type: IoType) -> str:
        ranges = ' and '.join(
            f'{start} to {start + count - 1}' for start, count in self._spans(io_type)
        )
        name = _KINDS[io_type].name
        return f'this controller has {name} {ranges}' if ranges else f'it has no {name}'

    def _bits(self, io_type: IoType, port: int, width: int) -> range:
        count = len(self._values[io_type])
        if io_type not in _PORTS or not 0 <= port * width < count:
            text = f'{_KINDS[io_type].short} port {port} of {width} bits: there are {count} points'
            raise IoError(IoResult.INDEX_OUT_OF_RANGE, text)
        return range(port * width, min(port * width + width, count))

    def _set(self, kind: _Kind, io_type: IoType, index: int, value: int) -> None:
        if kind.bits is not None:
            self._set_port(kind.bits, *_port(index), value)
            return
        low, high = self.profile.analog_limits if io_type in _ANALOG else (0, 1)
        if not low <= value <= high:
            unit = ' mV' if io_type in _ANALOG else ''
            text = f'{kind.short} {index} = {value}{unit}: must be {low} to {high}{unit}'
            raise IoError(IoResult.VALUE_OUT_OF_RANGE, text)
        self._change([((io_type, index), value)])

    def _set_port(self, io_type: IoType, port: int, width: int, value: int) -> None:
        bits = self._bits(io_type, port, width)
        if not 0 <= value < 1 << len(bits):
            high = (1 << len(bits)) - 1
            text = (
                f'{_KINDS[io_type].short} port {port} of {width} bits = {value}: '
                f'must be 0 to {high}, it has the {len(bits)} points {bits[0]} to {bits[-1]}'
            )
            raise IoError(IoResult.VALUE_OUT_OF_RANGE, text)
        self._change(((io_type, bit), value >> shift & 1) for shift, bit in enumerate(bits))

    def _make_safe(self, points: Iterable[Point]) -> None:
        self._change((point, self.profile.safe.get(point, 0)) for point in points)

    def _change(self, settings: Iterable[tuple[Point, int]]) -> None:
        changed = False
        for (io_type, index), value in settings:
            changed = changed or self._values[io_type][index] != value
            self._values[io_type][index] = value
        if changed:
            for listener in tuple(self._listeners):
                listener()


def _port(group: int) -> tuple[int, int]:
    return (group - WORD_GROUPS, WORD_BITS) if group >= WORD_GROUPS else (group, BYTE_BITS)
