# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O points of a controller, the interface for accessing them, and error texts."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from epson_driver.link import Link
from epson_driver.profiles.io_profile import MAX_POINTS as MAX_SHOWN
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.simple_message import Dialect, IoAddress, IoRange, IoResult, IoSetting, IoType

NAMES = {
    IoType.DIGITAL_INPUT: 'DI',
    IoType.DIGITAL_OUTPUT: 'DO',
    IoType.ANALOG_INPUT: 'AI',
    IoType.ANALOG_OUTPUT: 'AO',
    IoType.GROUP_INPUT: 'GI',
    IoType.GROUP_OUTPUT: 'GO',
    IoType.FLAG: 'flag',
}

WORD_GROUPS = 1000  # first index of groups with 16 bits instead of 8 (docs/io.md)

WORD_BITS, BYTE_BITS = 16, 8

GROUPS = {
    IoType.DIGITAL_INPUT: IoType.GROUP_INPUT,
    IoType.DIGITAL_OUTPUT: IoType.GROUP_OUTPUT,
}

INPUTS = (IoType.DIGITAL_INPUT, IoType.ANALOG_INPUT, IoType.GROUP_INPUT)

Ranges = Sequence[IoRange]


class IoUnavailableError(RuntimeError):
    """Raised if a request fails. The text contains the reason.

    `sent`: the controller may have executed the request. `passing`: the failure is temporary. It
    ends, for example, when the arm is at rest.
    """

    def __init__(self, text: str, *, sent: bool = False, passing: bool = False) -> None:
        super().__init__(text)
        self.sent = sent
        self.passing = passing


@dataclass(frozen=True, slots=True)
class PointReply:
    """A controller's reply for one point. `result`: an IoResult, or 0 if `why` has the error."""

    value: int = 0
    result: int = IoResult.SUCCESS
    why: str = ''
    passing: bool = False

    def text(self, io_type: int, index: int, written: int | None, ranges: Ranges) -> str:
        if self.why:
            return f'{_address(io_type, index, written)}: {self.why}'
        return sentence(self.result, io_type, index, written, ranges)


class Backend(ABC):
    """Interface for reading and writing the I/O points of one controller.

    * `ranges`: the existing points, or None while they are unknown.
    * `grouped`: whether groups consist of digital points, as docs/io.md describes.

    All timeouts are in s.
    """

    shown: Sequence[IoType]  # types of points that can be read at any time
    grouped = True
    ranges: tuple[IoRange, ...] | None = None
    link: Link | None = None  # the link for simple messages, if any
    wake: Callable[[], None]  # called when this link is established or lost

    def follow(self, dialect: Dialect) -> None:  # noqa: B027 - text has no byte order
        """Use the byte order and floating-point width of the state server."""

    async def find_ranges(self, timeout: float) -> None:  # noqa: B027 - a profile has them
        """Request the list of existing points. Raises IoUnavailableError if the request fails."""

    @abstractmethod
    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[PointReply]:
        """Return a result for each address. Raises IoUnavailableError if the request fails."""

    @abstractmethod
    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[PointReply]:
        """Write points in order. Raises IoUnavailableError if the request fails."""


def ranges_of(profile: IoProfile, *, words: bool, flags: bool) -> tuple[IoRange, ...]:
    """Return the points of a profile.

    `words`: whether to include groups of 16 bits. `flags`: whether to include flags.
    """
    ranges = []
    for io_type, count in (
        (IoType.DIGITAL_INPUT, profile.digital_inputs),
        (IoType.DIGITAL_OUTPUT, profile.digital_outputs),
    ):
        ranges.append(IoRange(io_type, 0, count, 0))
        ranges.append(IoRange(GROUPS[io_type], 0, -(-count // BYTE_BITS), 0))
        if words:
            ranges.append(IoRange(GROUPS[io_type], WORD_GROUPS, -(-count // WORD_BITS), 0))
    if flags:
        ranges.append(IoRange(IoType.FLAG, 0, profile.flags, 0))
    return tuple(item for item in ranges if item.count)


def there(io_type: int, index: int, ranges: Ranges) -> bool:
    return any(
        item.io_type == io_type and item.start <= index < item.start + item.count
        for item in ranges
    )


def rejection(io_type: int, index: int, value: int | None, ranges: Ranges) -> IoResult:
    """Return SUCCESS if a point can be read or set to `value`, else the error.

    `value`: None for reading.
    """
    if io_type not in [item.io_type for item in ranges]:
        return IoResult.TYPE_UNSUPPORTED
    if not there(io_type, index, ranges):
        return IoResult.INDEX_OUT_OF_RANGE
    if value is None:
        return IoResult.SUCCESS
    if io_type in INPUTS:
        return IoResult.TYPE_FEATURE_UNSUPPORTED
    if io_type == IoType.ANALOG_OUTPUT:  # only the controller knows its range
        return IoResult.SUCCESS
    maximum = _max_value(index, ranges) if io_type == IoType.GROUP_OUTPUT else 1
    return IoResult.SUCCESS if 0 <= value <= maximum else IoResult.VALUE_OUT_OF_RANGE


def shown(
    ranges: Ranges, types: Sequence[IoType], *, grouped: bool
) -> Iterator[tuple[IoRange, int, list[IoAddress]]]:
    """Yield each readable range, how many points one of its values contains, and its addresses.

    If groups consist of digital points (`grouped`), the digital points are read as groups, and the
    values of all groups are computed from the digital points (`packed`). At most MAX_SHOWN points
    are polled. Further ranges are omitted.
    """
    remaining = MAX_SHOWN
    for item in ranges:
        if item.io_type not in types or not 0 < item.count <= remaining:
            continue
        remaining -= item.count
        group = GROUPS.get(IoType(item.io_type))
        if grouped and item.io_type in GROUPS.values():
            continue
        if not grouped or group is None or item.start:
            points = range(item.start, item.start + item.count)
            yield item, 1, [IoAddress(item.io_type, index) for index in points]
            continue
        width, first = WORD_BITS, WORD_GROUPS
        if not there(group, first + (item.count - 1) // width, ranges):
            width, first = BYTE_BITS, 0
        ports = range(first, first - -item.count // width)
        yield item, width, [IoAddress(group, index) for index in ports]


def packed(groups: IoRange, bits: Sequence[int]) -> tuple[int, ...]:
    """Compute the values of a range of groups from `bits`, the values of all digital points."""
    width = _width(groups.start)
    first = groups.start % WORD_GROUPS
    return tuple(
        sum(value << bit for bit, value in enumerate(bits[width * port : width * (port + 1)]))
        for port in range(first, first + groups.count)
    )


def sentence(result: int, io_type: int, index: int, value: int | None, ranges: Ranges) -> str:
    """Return the error text for an IoResult. `value`: the value to write, or None for reading."""
    if result == IoResult.SUCCESS:
        return ''
    rule = _RULES.get(result)
    why = rule(io_type, index, ranges) if rule else f'result {result}, which is unknown'
    return f'{_address(io_type, index, value)}: {why}'


def _address(io_type: int, index: int, value: int | None) -> str:
    name = NAMES[IoType(io_type)] if io_type in NAMES else f'type {io_type}, index'
    return f'{name} {index}' if value is None else f'{name} {index} = {value}'


def _no_type(io_type: int, _index: int, _ranges: Ranges) -> str:
    if io_type in NAMES:
        return f'the controller has no {NAMES[IoType(io_type)]}'
    return f'unknown type, must be {min(NAMES)} to {max(NAMES)}'


def _not_by_type(io_type: int, _index: int, _ranges: Ranges) -> str:
    return 'an input cannot be written' if io_type in INPUTS else 'not supported by this type'


def _no_index(io_type: int, _index: int, ranges: Ranges) -> str:
    spans = [
        f'{item.start} to {item.start + item.count - 1}'
        for item in ranges
        if item.io_type == io_type and item.count > 0
    ]
    return f'the controller has {" and ".join(spans)}' if spans else 'unknown index'


def _no_value(io_type: int, index: int, ranges: Ranges) -> str:
    if io_type == IoType.ANALOG_OUTPUT:
        return "beyond the range of the controller's analogue outputs, in mV"
    if io_type != IoType.GROUP_OUTPUT:
        return 'must be 0 or 1'
    return f'must be 0 to {_max_value(index, ranges)}'


def _width(group: int) -> int:
    return WORD_BITS if group >= WORD_GROUPS else BYTE_BITS


def _max_value(group: int, ranges: Ranges) -> int:
    """Return the largest value of an output group. Bits without a digital point are 0."""
    width = _width(group)
    first = group % WORD_GROUPS * width
    outputs = [item for item in ranges if item.io_type == IoType.DIGITAL_OUTPUT]
    end = max((item.start + item.count for item in outputs), default=first + width)
    return int((1 << max(0, min(width, end - first))) - 1)


_RULES: dict[int, Callable[[int, int, Ranges], str]] = {
    IoResult.TYPE_UNSUPPORTED: _no_type,
    IoResult.TYPE_FEATURE_UNSUPPORTED: _not_by_type,
    IoResult.INDEX_FEATURE_UNSUPPORTED: lambda *_: 'not supported by this index',
    IoResult.INDEX_OUT_OF_RANGE: _no_index,
    IoResult.VALUE_OUT_OF_RANGE: _no_value,
}
