# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Number format of a controller: byte order and width of reals, which are not negotiated."""

from dataclasses import dataclass, field
from enum import Enum


class ByteOrder(Enum):
    """Byte order of every int and real. The value is `struct`'s prefix."""

    LITTLE = '<'
    BIG = '>'


class Real(Enum):
    """Width of `shared_real`. The value is `struct`'s code."""

    FLOAT32 = 'f'
    FLOAT64 = 'd'


@dataclass(frozen=True, slots=True)
class Dialect:
    """Byte order and real width of one controller. EPSON's RC620 (x86): little endian, float32."""

    byte_order: ByteOrder = ByteOrder.LITTLE
    real: Real = Real.FLOAT32
    number: int = field(init=False, repr=False, compare=False)
    """Index, 0 to 3, for values stored per dialect (`DIALECTS`)."""

    def __post_init__(self) -> None:
        number = 2 * (self.byte_order is ByteOrder.BIG) + (self.real is Real.FLOAT64)
        object.__setattr__(self, 'number', number)

    def __str__(self) -> str:
        return f'{self.byte_order.name.lower()} endian with {self.real.name.lower()}'


LITTLE_ENDIAN = Dialect()
BIG_ENDIAN = Dialect(ByteOrder.BIG)

DIALECTS = tuple(Dialect(order, real) for order in ByteOrder for real in Real)
"""All dialects by number."""
