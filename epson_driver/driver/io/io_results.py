# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Results of I/O requests as sentences with address, value and limit."""

from collections.abc import Callable, Sequence

from epson_driver.simple_message import IoRange, IoResult, IoType

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
"""From this index on a group has 16 bits, below it 8 (docs/io.md)."""

INPUTS = (IoType.DIGITAL_INPUT, IoType.ANALOG_INPUT, IoType.GROUP_INPUT)

Ranges = Sequence[IoRange]


def sentence(result: int, io_type: int, index: int, value: int | None, ranges: Ranges) -> str:
    """Return why a point was not read, or not written with `value`, or '' for SUCCESS.

    `ranges` are those that the controller says it has; empty while that is not known.
    """
    if result == IoResult.SUCCESS:
        return ''
    rule = _RULES.get(result)
    why = rule(io_type, index, ranges) if rule else f'result {result}, which has no meaning here'
    return f'{address(io_type, index, value)}: {why}'


def address(io_type: int, index: int, value: int | None) -> str:
    """Return how a sentence names a point that was to be read, or written with `value`."""
    name = NAMES[IoType(io_type)] if io_type in NAMES else f'type {io_type}, index'
    return f'{name} {index}' if value is None else f'{name} {index} = {value}'


def _no_type(io_type: int, _index: int, _ranges: Ranges) -> str:
    if io_type in NAMES:
        return f'the controller has no {NAMES[IoType(io_type)]}'
    return f'there is no such type, only {min(NAMES)} to {max(NAMES)}'


def _not_by_type(io_type: int, _index: int, _ranges: Ranges) -> str:
    return 'an input cannot be written' if io_type in INPUTS else 'its type cannot do this'


def _no_index(io_type: int, _index: int, ranges: Ranges) -> str:
    there = [
        f'{held.start} to {held.start + held.count - 1}'
        for held in ranges
        if held.io_type == io_type and held.count > 0
    ]
    return f'the controller has {" and ".join(there)}' if there else 'there is no such index'


def _no_value(io_type: int, index: int, ranges: Ranges) -> str:
    if io_type == IoType.ANALOG_OUTPUT:
        return "beyond the range of the controller's analogue outputs, in mV"
    if io_type != IoType.GROUP_OUTPUT:
        return 'must be 0 or 1'
    width = 16 if index >= WORD_GROUPS else 8
    first = (index % WORD_GROUPS) * width
    outputs = [held for held in ranges if held.io_type == IoType.DIGITAL_OUTPUT]
    end = max((held.start + held.count for held in outputs), default=first + width)
    bits = max(0, min(width, end - first))
    return f'must be 0 to {(1 << bits) - 1}'


_RULES: dict[int, Callable[[int, int, Ranges], str]] = {
    IoResult.TYPE_UNSUPPORTED: _no_type,
    IoResult.TYPE_FEATURE_UNSUPPORTED: _not_by_type,
    IoResult.INDEX_FEATURE_UNSUPPORTED: lambda *_: 'this index cannot do this',
    IoResult.INDEX_OUT_OF_RANGE: _no_index,
    IoResult.VALUE_OUT_OF_RANGE: _no_value,
    IoResult.NO_SUBSCRIPTION: lambda *_: 'no subscription begins there',
    IoResult.TOO_MUCH: lambda *_: 'more than one client may subscribe to',
}
