# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""I/O points: addresses, groups, limits and safe values."""

import pytest

from epson_driver.profiles.io_profile import IoProfile, read_io_profile
from epson_driver.sim_controller.io.io_points import IoError, IoPoints
from epson_driver.simple_message import IoRange, IoResult, IoType

DI, DO = IoType.DIGITAL_INPUT, IoType.DIGITAL_OUTPUT
AI, AO = IoType.ANALOG_INPUT, IoType.ANALOG_OUTPUT
GI, GO, FLAG = IoType.GROUP_INPUT, IoType.GROUP_OUTPUT, IoType.FLAG


@pytest.fixture
def points() -> IoPoints:
    return IoPoints(IoProfile())


def outputs(points: IoPoints) -> list[int]:
    return [points.read(DO, index) for index in range(points.profile.digital_outputs)]


@pytest.mark.parametrize(('io_type', 'value'), [(DI, 1), (AI, 2500), (GI, 0x5A)])
def test_input_is_set_from_outside_only(points: IoPoints, io_type: IoType, value: int) -> None:
    with pytest.raises(IoError, match='an input cannot be written') as error:
        points.write(io_type, 1, value)
    assert error.value.result is IoResult.TYPE_FEATURE_UNSUPPORTED
    assert points.read(io_type, 1) == 0
    points.set_input(io_type, 1, value)
    assert points.read(io_type, 1) == value


def test_group_has_8_or_16_points_lowest_first(points: IoPoints) -> None:
    points.write(GO, 1, 0b1000_0001)
    assert [index for index, value in enumerate(outputs(points)) if value] == [8, 15]
    assert points.read(GO, 1000) == 0x8100
    points.write(DO, 3, 1)
    assert (points.read(GO, 0), points.read(GO, 1000)) == (0b1000, 0x8108)
    points.set_input(GI, 1000, 0xABCD)
    assert [points.read(GI, port) for port in range(3)] == [0xCD, 0xAB, 0]
    points.set_input(DI, 23, 1)
    assert points.read(GI, 1001) == 0x80


def test_flags_are_read_and_written_as_ports(points: IoPoints) -> None:
    points.write_port(FLAG, 31, 16, 0xF00F)
    assert points.read(FLAG, 511) == 1
    assert points.read_port(FLAG, 63, 8) == 0xF0
    with pytest.raises(IoError, match='flag port 32 of 16 bits: there are 512 points'):
        points.read_port(FLAG, 32, 16)
    with pytest.raises(IoError, match='an input cannot be written'):
        points.write_port(DI, 0, 8, 1)
    with pytest.raises(IoError, match='there are 2 points'):
        points.read_port(AI, 0, 8)


UNSUPPORTED, INDEX, VALUE = (
    IoResult.TYPE_UNSUPPORTED,
    IoResult.INDEX_OUT_OF_RANGE,
    IoResult.VALUE_OUT_OF_RANGE,
)


@pytest.mark.parametrize(
    ('address', 'value', 'result', 'sentence'),
    [
        ((0, 0), 1, UNSUPPORTED, 'type 0: unknown type of I/O, must be 1 to 7'),
        ((8, 0), 1, UNSUPPORTED, 'type 8: unknown type of I/O, must be 1 to 7'),
        ((-1, -1), 1, UNSUPPORTED, 'type -1: unknown type of I/O, must be 1 to 7'),
        ((2, 16), 1, INDEX, 'DO 16: this controller has digital outputs 0 to 15'),
        ((2, -1), 1, INDEX, 'DO -1: this controller has digital outputs 0 to 15'),
        ((2, 3), 2, VALUE, 'DO 3 = 2: must be 0 to 1'),
        ((2, 3), -1, VALUE, 'DO 3 = -1: must be 0 to 1'),
        ((4, 2), 0, INDEX, 'AO 2: this controller has analogue outputs 0 to 1'),
        ((4, 0), 10_001, VALUE, 'AO 0 = 10001 mV: must be -10000 to 10000 mV'),
        ((4, 0), -10_001, VALUE, 'AO 0 = -10001 mV: must be -10000 to 10000 mV'),
        (
            (6, 2),
            1,
            INDEX,
            'GO 2: this controller has groups of outputs 0 to 1 and 1000 to 1000',
        ),
        ((6, 999), 1, INDEX, 'GO 999: this controller has groups of outputs 0 to 1 and'),
        (
            (6, 1),
            256,
            VALUE,
            'DO port 1 of 8 bits = 256: must be 0 to 255, it has the 8 points 8 to 15',
        ),
        ((6, 1000), -1, VALUE, 'DO port 0 of 16 bits = -1: must be 0 to 65535'),
        ((7, 512), 1, INDEX, 'flag 512: this controller has flags 0 to 511'),
        ((7, 0), 2, VALUE, 'flag 0 = 2: must be 0 to 1'),
    ],
)
def test_error_names_address_value_and_limit(
    points: IoPoints, address: tuple[int, int], value: int, result: IoResult, sentence: str
) -> None:
    calls: list[None] = []
    points.listen(lambda: calls.append(None))
    with pytest.raises(IoError) as error:
        points.write(*address, value)
    assert str(error.value).startswith(sentence)
    assert error.value.result is result
    assert calls == []
    if result is not VALUE:
        with pytest.raises(IoError) as error:
            points.read(*address)
        assert error.value.result is result


def test_unknown_type_of_io_is_an_error() -> None:
    points = IoPoints(IoProfile(analog_inputs=0, digital_outputs=12))
    with pytest.raises(IoError, match='AI 0: it has no analogue inputs') as error:
        points.read(AI, 0)
    assert error.value.result is IoResult.TYPE_UNSUPPORTED
    assert AI not in {range_.io_type for range_ in points.ranges()}


def test_incomplete_group_has_only_its_points() -> None:
    points = IoPoints(IoProfile(digital_outputs=12))
    assert [range_ for range_ in points.ranges() if range_.io_type == GO] == [
        IoRange(GO, 0, 2, 3),
        IoRange(GO, 1000, 1, 3),
    ]
    points.write(GO, 1, 0xF)
    assert outputs(points) == [0] * 8 + [1] * 4
    with pytest.raises(IoError, match='= 16: must be 0 to 15, it has the 4 points 8 to 11'):
        points.write(GO, 1, 0x10)
    with pytest.raises(IoError, match='must be 0 to 4095'):
        points.write(GO, 1000, 0x1000)
    assert outputs(points) == [0] * 8 + [1] * 4


@pytest.mark.parametrize(
    ('io_type', 'start', 'count'),
    [(DI, 0, 25), (DI, 23, 2), (DI, 0, 0), (DI, 5, -1), (GI, 1, 1000), (GI, 1000, 3), (GI, 3, 1)],
)
def test_invalid_range_is_refused(
    points: IoPoints, io_type: IoType, start: int, count: int
) -> None:
    with pytest.raises(IoError) as error:
        points.check_range(io_type, start, count)
    assert error.value.result is IoResult.INDEX_OUT_OF_RANGE


def test_listener_is_called_once_per_change(points: IoPoints) -> None:
    calls: list[int] = []
    stop = points.listen(lambda: calls.append(points.read(GO, 0)))
    points.write(GO, 0, 0b111)
    assert calls == [7]
    points.write(GO, 0, 0b111)
    points.write(DO, 0, 1)
    assert calls == [7]
    points.set_input(DI, 0, 1)
    assert calls == [7, 7]
    stop()
    stop()
    points.write(DO, 0, 0)
    assert calls == [7, 7]


SAFE = {
    'safe': {'DO3': 1, 'AO1': 2.5},
    'keep_on_reset': ['DO0', 'AO0'],
    'keep_on_link_loss': ['DO1'],
}


def safe_points() -> IoPoints:
    """Return points with safe values that are not 0, all of them changed."""
    points = IoPoints(read_io_profile(SAFE, 'cell.yaml'))
    assert outputs(points) == [0, 0, 0, 1] + [0] * 12
    assert (points.read(AO, 0), points.read(AO, 1)) == (0, 2500)
    points.write(GO, 1000, 0xFFF7)
    points.write(AO, 0, 5000)
    points.write(AO, 1, -5000)
    points.write(FLAG, 7, 1)
    points.set_input(DI, 2, 1)
    return points


def state(points: IoPoints) -> tuple[int, ...]:
    addresses = ((GO, 1000), (AO, 0), (AO, 1), (FLAG, 7), (DI, 2))
    return tuple(points.read(*address) for address in addresses)


def test_reset_sets_safe_values_except_kept_outputs() -> None:
    points = safe_points()
    points.reset()
    assert state(points) == (0b1001, 5000, 2500, 1, 1)


def test_boot_keeps_only_inputs() -> None:
    points = safe_points()
    points.boot()
    assert state(points) == (0b1000, 0, 2500, 0, 1)


def test_outputs_become_safe_when_the_last_client_that_wrote_has_gone() -> None:
    points = safe_points()
    reader, first, second = object(), object(), object()
    points.client_wrote(first)
    points.client_wrote(second)
    points.client_wrote(second)
    for gone in (reader, first, first):
        points.client_gone(gone)
    assert state(points) == (0xFFF7, 5000, -5000, 1, 1)
    points.client_gone(second)
    assert state(points) == (0b1010, 0, 2500, 1, 1)
    points.write(GO, 1000, 0xFFF7)
    for gone in (first, second):
        points.client_gone(gone)
    assert points.read(GO, 1000) == 0xFFF7


def test_reset_of_one_output_ignores_keep_on_reset() -> None:
    points = safe_points()
    points.reset_point(DO, 0)
    points.reset_point(DO, 3)
    points.reset_point(AO, 1)
    points.reset_point(FLAG, 7)
    assert state(points) == (0xFFFE, 5000, 2500, 0, 1)
    points.reset_point(GO, 0)
    assert points.read(GO, 1000) == 0xFF08
    for io_type in (DI, AI, GI):
        with pytest.raises(IoError, match='an input cannot be reset') as error:
            points.reset_point(io_type, 0)
        assert error.value.result is IoResult.TYPE_FEATURE_UNSUPPORTED


@pytest.mark.parametrize('io_type', [DO, AO, GO, FLAG])
def test_output_is_not_set_from_outside(points: IoPoints, io_type: IoType) -> None:
    with pytest.raises(IoError, match='no input') as error:
        points.set_input(io_type, 0, 1)
    assert error.value.result is IoResult.TYPE_FEATURE_UNSUPPORTED
    assert points.read(io_type, 0) == 0
