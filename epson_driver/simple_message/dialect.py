# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How a controller writes numbers: byte order and width of reals are its own, not negotiated."""

from dataclasses import dataclass, field
from enum import Enum


class ByteOrder(Enum):
    """Order of the bytes of every int and real, with `struct`'s prefix as its value."""

    LITTLE = '<'
    BIG = '>'


class Real(Enum):
    """Width of `shared_real`, with `struct`'s code as its value."""

    FLOAT32 = 'f'
    FLOAT64 = 'd'


@dataclass(frozen=True, slots=True)
class Dialect:
    """Byte order and real width of one controller. EPSON's RC620 (x86): little endian, float32."""

    byte_order: ByteOrder = ByteOrder.LITTLE
    real: Real = Real.FLOAT32
    number: int = field(init=False, repr=False, compare=False)
    """0 to 3: its place in what is kept for each dialect (`DIALECTS`)."""

    def __post_init__(self) -> None:
        number = 2 * (self.byte_order is ByteOrder.BIG) + (self.real is Real.FLOAT64)
        object.__setattr__(self, 'number', number)

    def __str__(self) -> str:
        return f'{self.byte_order.name.lower()} endian with {self.real.name.lower()}'


LITTLE_ENDIAN = Dialect()
BIG_ENDIAN = Dialect(ByteOrder.BIG)

DIALECTS = tuple(Dialect(order, real) for order in ByteOrder for real in Real)
"""All there are, by their number."""
