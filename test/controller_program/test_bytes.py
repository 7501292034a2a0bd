# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""bytes.prg converts floats and longs to bytes and back exactly like `struct`."""

import math
import random
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.spel_harness import ScriptedHost

from epson_driver.spel import Array, Machine, Timing, build, read_project

FOLDER = Path(__file__).parents[2] / 'controller_program'
FILES = read_project(FOLDER)

BATCH = 500
MANY = pytest.param(100_000, marks=pytest.mark.slow, id='100,000 values')
SOME = pytest.param(4_000, id='4,000 values')

DRIVER = f"""#include "globals.inc"
Global Double g_in({BATCH - 1})
Global Long g_long({BATCH - 1})
Global Integer g_bytes({4 * BATCH - 1}), g_ok({BATCH - 1})
Function Start
  BytesInit
Fend
Function PackAll
  Integer i, place(0)
  place(0) = 150
  For i = 0 To {BATCH - 1}
    g_ok(i) = PackFloat(g_in(i), ByRef g_bytes(), 4 * i, ByRef place(), 0)
  Next i
Fend
Function UnpackAll
  Integer i
  Double x
  For i = 0 To {BATCH - 1}
    x = g_in(i)
    g_ok(i) = UnpackFloat(ByRef g_bytes(), 4 * i, ByRef x)
    g_in(i) = x
  Next i
Fend
Function PackLongs
  Integer i
  For i = 0 To {BATCH - 1}
    PackLong(g_long(i), ByRef g_bytes(), 4 * i)
  Next i
Fend
Function UnpackLongs
  Integer i
  For i = 0 To {BATCH - 1}
    g_long(i) = UnpackLong(ByRef g_bytes(), 4 * i)
  Next i
Fend
"""


class BytesHarness:
    """bytes.prg with a program that calls it for a batch of values."""

    def __init__(self) -> None:
        self.host = ScriptedHost()
        self.machine = Machine(
            build({**FILES, 'driver.prg': DRIVER}), self.host, Timing(endless=10**9)
        )
        names = [variable.name for variable in self.machine.world.program.variables]
        shared = dict(zip(names, self.machine.world.g, strict=True))
        self.arrays = {name: held for name, held in shared.items() if isinstance(held, Array)}
        self.call('Start')

    def call(self, name: str) -> None:
        """Run a function to its end."""
        self.machine.start(name, clear=False)
        while 1 in self.machine.world.tasks:
            self.machine.advance(self.machine.time + 10.0)
        assert self.host.failures == [], str(self.host.failures[0])

    def pack(self, values: list[float]) -> list[bytes | None]:
        """Return four bytes for each value, None for a refused one."""
        self.arrays['g_in'].d[:] = values
        self.arrays['g_bytes'].d[:] = [99] * (4 * BATCH)
        self.call('PackAll')
        result: list[bytes | None] = []
        for number, ok in enumerate(self.arrays['g_ok'].d):
            four = bytes(self.arrays['g_bytes'].d[4 * number : 4 * number + 4])
            if not ok:
                assert four == bytes([99] * 4)
            result.append(four if ok else None)
        return result

    def unpack(self, values: list[bytes]) -> list[float | None]:
        """Return the value of each four bytes, None for refused bytes."""
        self.arrays['g_bytes'].d[:] = list(b''.join(values))
        self.arrays['g_in'].d[:] = [123.5] * BATCH
        self.call('UnpackAll')
        result: list[float | None] = []
        for value, ok in zip(self.arrays['g_in'].d, self.arrays['g_ok'].d, strict=True):
            if not ok:
                assert value == 123.5
            result.append(float(value) if ok else None)
        return result


@pytest.fixture(scope='module')
def harness() -> BytesHarness:
    return BytesHarness()


def as_float(bits: int) -> float:
    return struct.unpack('<f', struct.pack('<I', bits))[0]


def packed(value: float) -> bytes | None:
    """Return a value packed by struct, with +0 for -0, or None if it is too large."""
    try:
        four = struct.pack('<f', value)
    except OverflowError:
        return None
    return b'\0\0\0\0' if value == 0.0 else four


SPECIAL = [
    *(as_float(bits) for bits in (0, 1, 2, 0x007F_FFFF, 0x0080_0000, 0x0080_0001, 0x7F7F_FFFF)),
    *(-as_float(bits) for bits in (1, 0x007F_FFFF, 0x0080_0000, 0x7F7F_FFFF)),
    -0.0,
    1.0,
    -1.0,
    2.0 - 2**-24,  # a tie that carries into the exponent
    2.0 - 2**-25,
    1.0 + 2**-24,  # a tie to even, downwards
    1.0 + 3 * 2**-24,  # and upwards
    1.0 + 2**-24 + 2**-50,
    2.0**-126 - 2**-150,  # a tie from the largest denormal into the normal ones
    2.0**-150,  # a tie between 0 and the smallest
    math.nextafter(2.0**-150, 1.0),
    3 * 2.0**-150,
    1e-300,
    5e-324,
    2.0**128 - 2**104,  # the largest
    2.0**128 - 2**103,  # a tie above the maximum
    math.nextafter(2.0**128 - 2**103, 0.0),
    2.0**128,
    1e300,
    -1e300,
    math.pi,
    0.1,
]


def values(count: int) -> Iterator[list[float]]:
    """Yield batches: special ones, floats of any bits, ties and their neighbours, doubles."""
    chance = random.Random(16)
    yield (SPECIAL * (BATCH // len(SPECIAL) + 1))[:BATCH]
    for _ in range(count // BATCH):
        batch = []
        while len(batch) < BATCH:
            bits = chance.getrandbits(32)
            value = as_float(bits)
            if not math.isfinite(value):
                continue
            kind = chance.randrange(4)
            if kind == 1:  # half way to the next one
                value += math.copysign(math.ulp(value) / 2, value)
                following = as_float((bits & 0x7FFF_FFFF) + 1)
                if math.isfinite(following):
                    value = math.copysign((abs(as_float(bits)) + following) / 2, value)
                if chance.random() < 0.3:
                    value = math.nextafter(value, chance.choice([0.0, math.inf]))
            elif kind == 2:
                value = chance.uniform(-4.0, 4.0)
            elif kind == 3:
                value = math.ldexp(chance.uniform(-1.0, 1.0), chance.randint(-160, 135))
            batch.append(value)
        yield batch


@pytest.mark.parametrize('count', [SOME, MANY])
def test_floats_are_packed_like_struct(harness: BytesHarness, count: int) -> None:
    for batch in values(count):
        for value, result in zip(batch, harness.pack(batch), strict=True):
            assert result == packed(value), value.hex()


@pytest.mark.parametrize('count', [SOME, MANY])
def test_floats_are_unpacked_like_struct(harness: BytesHarness, count: int) -> None:
    chance = random.Random(17)
    special = [0, 1, 0x8000_0001, 0x007F_FFFF, 0x0080_0000, 0x7F7F_FFFF, 0x7F80_0000]
    special += [0xFF80_0000, 0x7FC0_0000, 0x7F80_0001, 0xFFFF_FFFF, 0x3F80_0000, 0x8000_0000]
    for _ in range(count // BATCH):
        bits = special + [chance.getrandbits(32) for _ in range(BATCH - len(special))]
        for item, result in zip(
            bits, harness.unpack([struct.pack('<I', bit) for bit in bits]), strict=True
        ):
            value = as_float(item)
            if not math.isfinite(value):
                assert result is None, hex(item)
            else:
                assert result is not None
                assert struct.pack('<d', result) == struct.pack('<d', value), hex(item)


@pytest.mark.parametrize('count', [SOME, MANY])
def test_longs_survive_a_round_trip(harness: BytesHarness, count: int) -> None:
    chance = random.Random(18)
    special = [0, 1, -1, -4, 2**31 - 1, -(2**31), 255, 256, -256, 0x00FF_FFFF, -0x0100_0000]
    for _ in range(count // BATCH):
        longs = special + [chance.randrange(-(2**31), 2**31) for _ in range(BATCH - len(special))]
        harness.arrays['g_long'].d[:] = longs
        harness.call('PackLongs')
        written = bytes(harness.arrays['g_bytes'].d)
        assert written == struct.pack(f'<{BATCH}i', *longs)
        harness.arrays['g_long'].d[:] = [0] * BATCH
        harness.call('UnpackLongs')
        assert harness.arrays['g_long'].d == longs


def test_conversion_of_a_number_takes_few_statements(harness: BytesHarness) -> None:
    """A controller has time for some hundred statements per message at 100 Hz."""
    angles = [0.5 + 1e-4 * number for number in range(BATCH)]
    before = harness.machine.statements
    harness.pack(angles)
    assert (harness.machine.statements - before) / BATCH < 30
    before = harness.machine.statements
    harness.unpack([struct.pack('<f', angle) for angle in angles])
    assert (harness.machine.statements - before) / BATCH < 20


def test_files_are_ascii_with_crlf() -> None:
    for path in sorted(FOLDER.iterdir()):
        content = path.read_bytes()
        assert content.isascii(), path.name
        assert content.count(b'\n') == content.count(b'\r\n') > 0, path.name
