# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O points of a controller, the interface for access to them, and reasons for refusals."""

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

WORD_GROUPS = 1000
"""First index of groups with 16 bits. Groups below it have 8 bits (docs/io.md)."""

WORD_BITS, BYTE_BITS = 16, 8

GROUPS = {
    IoType.DIGITAL_INPUT: IoType.GROUP_INPUT,
    IoType.DIGITAL_OUTPUT: IoType.GROUP_OUTPUT,
}

INPUTS = (IoType.DIGITAL_INPUT, IoType.ANALOG_INPUT, IoType.GROUP_INPUT)

Ranges = Sequence[IoRange]


class IoUnavailableError(RuntimeError):
    """A request without a reply, with the reason as its text.

    `sent`: the controller may have executed it. `passing`: the controller will reply again without
    intervention, for example when the arm is at rest.
    """

    def __init__(self, text: str, *, sent: bool = False, passing: bool = False) -> None:
        super().__init__(text)
        self.sent = sent
        self.passing = passing


@dataclass(frozen=True, slots=True)
class PointReply:
    """A controller's reply for one point: its value, or why it is missing.

    `result` is an IoResult's number, or 0 if `why` has the reason. `passing`: see
    IoUnavailableError.
    """

    value: int = 0
    result: int = IoResult.SUCCESS
    why: str = ''
    passing: bool = False

    def text(self, io_type: int, index: int, written: int | None, ranges: Ranges) -> str:
        """Return why a point was not read, or not written with `written`, or '' if it was."""
        if self.why:
            return f'{_address(io_type, index, written)}: {self.why}'
        return sentence(self.result, io_type, index, written, ranges)


class Backend(ABC):
    """Interface for reading and writing points of one controller. `timeout` is per request, s.

    `ranges` are the existing points, or None while they are unknown. `shown` are the types that
    can be read at any time. `grouped`: groups pack their points as docs/io.md describes. `link` is
    the link for simple messages, if it uses them. `wake` is called when that link is established
    and when it is lost.
    """

    shown: Sequence[IoType]
    grouped = True
    ranges: tuple[IoRange, ...] | None = None
    link: Link | None = None
    wake: Callable[[], None]

    def follow(self, dialect: Dialect) -> None:  # noqa: B027 - text has no byte order
        """Use the byte order and real width of the state server."""

    async def look(self, timeout: float) -> None:  # noqa: B027 - a profile has them
        """Request the existing points. Raises IoUnavailableError if the request fails."""

    @abstractmethod
    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[PointReply]:
        """Return a result for each address. Raises IoUnavailableError if the request fails."""

    @abstractmethod
    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[PointReply]:
        """Write points in order. Raises IoUnavailableError, with `sent` if they may be set."""


def ranges_of(profile: IoProfile, *, words: bool, flags: bool) -> tuple[IoRange, ...]:
    """Return the points of a profile that are accessible without an I/O server."""
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
    return tuple(held for held in ranges if held.count)


def there(io_type: int, index: int, ranges: Ranges) -> bool:
    """Return whether any range contains a point."""
    return any(
        held.io_type == io_type and held.start <= index < held.start + held.count
        for held in ranges
    )


def rejection(io_type: int, index: int, value: int | None, ranges: Ranges) -> IoResult:
    """Return SUCCESS, or why a point cannot be read, or written with `value`."""
    if io_type not in [held.io_type for held in ranges]:
        return IoResult.TYPE_UNSUPPORTED
    if not there(io_type, index, ranges):
        return IoResult.INDEX_OUT_OF_RANGE
    if value is None:
        return IoResult.SUCCESS
    if io_type in INPUTS:
        return IoResult.TYPE_FEATURE_UNSUPPORTED
    if io_type == IoType.ANALOG_OUTPUT:  # only the controller knows its range
        return IoResult.SUCCESS
    maximum = _most(index, ranges) if io_type == IoType.GROUP_OUTPUT else 1
    return IoResult.SUCCESS if 0 <= value <= maximum else IoResult.VALUE_OUT_OF_RANGE


def shown(
    ranges: Ranges, types: Sequence[IoType], *, grouped: bool
) -> Iterator[tuple[IoRange, int, list[IoAddress]]]:
    """Yield the ranges whose values are requested, points in one value, and addresses to read.

    Digital points are read in groups if these pack them (`grouped`). Such groups are shown without
    being read. Ranges that would exceed MAX_SHOWN points in total are omitted.
    """
    left = MAX_SHOWN
    for held in ranges:
        if held.io_type not in types or not 0 < held.count <= left:
            continue
        left -= held.count
        group = GROUPS.get(IoType(held.io_type))
        if grouped and held.io_type in GROUPS.values():
            continue
        if not grouped or group is None or held.start:
            points = range(held.start, held.start + held.count)
            yield held, 1, [IoAddress(held.io_type, index) for index in points]
            continue
        width, first = WORD_BITS, WORD_GROUPS
        if not there(group, first + (held.count - 1) // width, ranges):
            width, first = BYTE_BITS, 0
        ports = range(first, first - -held.count // width)
        yield held, width, [IoAddress(group, index) for index in ports]


def packed(held: IoRange, bits: Sequence[int]) -> tuple[int, ...]:
    """Return the values of a range of groups from the values of its digital points."""
    width = _width(held.start)
    ports = range(held.start % WORD_GROUPS, held.start % WORD_GROUPS + held.count)
    return tuple(
        sum(bit << at for at, bit in enumerate(bits[width * port : width * (port + 1)]))
        for port in ports
    )


def sentence(result: int, io_type: int, index: int, value: int | None, ranges: Ranges) -> str:
    """Return why a point was not read, or not written with `value`, or '' for SUCCESS.

    `ranges` are the ranges reported by the controller, empty while they are unknown.
    """
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
    has = [
        f'{held.start} to {held.start + held.count - 1}'
        for held in ranges
        if held.io_type == io_type and held.count > 0
    ]
    return f'the controller has {" and ".join(has)}' if has else 'unknown index'


def _no_value(io_type: int, index: int, ranges: Ranges) -> str:
    if io_type == IoType.ANALOG_OUTPUT:
        return "beyond the range of the controller's analogue outputs, in mV"
    if io_type != IoType.GROUP_OUTPUT:
        return 'must be 0 or 1'
    return f'must be 0 to {_most(index, ranges)}'


def _width(group: int) -> int:
    return WORD_BITS if group >= WORD_GROUPS else BYTE_BITS


def _most(group: int, ranges: Ranges) -> int:
    """Return the maximum value of a group of outputs, from its existing points."""
    width = _width(group)
    first = group % WORD_GROUPS * width
    outputs = [held for held in ranges if held.io_type == IoType.DIGITAL_OUTPUT]
    end = max((held.start + held.count for held in outputs), default=first + width)
    return int((1 << max(0, min(width, end - first))) - 1)


_RULES: dict[int, Callable[[int, int, Ranges], str]] = {
    IoResult.TYPE_UNSUPPORTED: _no_type,
    IoResult.TYPE_FEATURE_UNSUPPORTED: _not_by_type,
    IoResult.INDEX_FEATURE_UNSUPPORTED: lambda *_: 'not supported by this index',
    IoResult.INDEX_OUT_OF_RANGE: _no_index,
    IoResult.VALUE_OUT_OF_RANGE: _no_value,
}
