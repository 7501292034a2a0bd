# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ranges of the numbers in statements and functions, for both the linter and the machine."""

from math import inf

from epson_driver.spel.errors import ErrorNumber, SpelError
from epson_driver.spel.values import LONGEST_STRING

PORTS = (201, 216)
FILES = (30, 63)
_TASKS = (1, 267)
_CHARACTERS = (0, LONGEST_STRING)
_LONGEST = 1e7  # maximum time in a statement, s
_MAX = 32767
"""Maximum of numbers for which the manual states no limit, because it depends on robot or I/O."""

RANGES: dict[str, tuple[tuple[float, float] | None, ...]] = {
    name: ranges
    for names, ranges in (
        ('speed', ((1, 100),) * 3),
        ('speedfactor', ((1, 100),)),
        ('speeds', ((0.1, 2000),) * 3),
        ('speedr', ((0.1, 1000),)),
        ('accel', ((1, _MAX),) * 6),
        ('accels', ((0.1, 25000),) * 6),
        ('accelr', ((0.1, 5000),) * 2),
        ('weight inertia', ((0, _MAX),) * 2),
        ('on off', ((0, _MAX), (0, _LONGEST))),
        ('sw oport in inw setsw', ((0, _MAX),)),
        ('setin', ((0, _MAX), (0, 255))),
        ('setinw', ((0, _MAX), (-32768, 65535))),
        ('tool pallet palletclr', ((0, 15),)),
        ('tlset tlclr local localclr', ((1, 15),)),
        ('arch', ((0, 6),)),
        ('columns rows', ((1, _MAX),)),
        ('redim', ((0, inf),)),
        ('arch(', ((0, 6), (1, 2))),
        ('tmreset tmr signal syncunlock', ((0, 63),)),
        ('waitsig synclock', ((0, 63), (0, _LONGEST))),
        ('wait tmout', ((0, _LONGEST),)),
        ('memon memoff memsw', ((0, 1023),)),
        ('memout', ((0, 127), (0, 255))),
        ('memin', ((0, 127),)),
        ('memoutw', ((0, 63), (-32768, 65535))),
        ('meminw', ((0, 63),)),
        ('out', ((0, _MAX), (0, 255))),
        ('outw', ((0, _MAX), (-32768, 65535))),
        ('setnet opennet closenet chknet lof', (PORTS,)),
        ('waitnet', (PORTS, (0, _LONGEST))),
        ('aopen ropen wopen', (None, FILES)),
        ('close flush eof', (FILES,)),
        ('p plabel', ((0, 999),)),
        ('hand', (None, (1, 2))),
        ('plocal', (None, (0, 15))),
        ('where', ((0, 15),)),
        ('sqr', ((0, inf),)),
        ('asin acos', ((-1, 1),)),
        ('lshift rshift bset bclr btst', (None, (0, 31))),
        ('chr$', ((1, 255),)),
        ('space$ tab$', (_CHARACTERS,)),
        ('left$ right$ lset$ rset$', (None, _CHARACTERS)),
        ('mid$', (None, (1, inf), _CHARACTERS)),
        ('time', ((0, 2),)),
        ('taskinfo', (_TASKS, (0, 4))),
        ('taskstate taskdone quit halt resume taskwait', (_TASKS,)),
        ('err erl era erf$', ((0, _TASKS[1]),)),
        ('xqt', ((1, 32),)),
        ('c', ((0, 7),)),
        ('d', ((0, 100),)),
    )
    for name in names.split()
}
"""Name in lower case → ranges of the arguments. `arch(` is the function, and `arch` the
statement."""


def key_of(name: str) -> str:
    called = f'{name.lower()}('
    return called if called in RANGES else name.lower()


def limits(key: str, place: int) -> tuple[float, float] | None:
    """Return the minimum and maximum of the argument with index `place`, or None if unlimited."""
    ranges = RANGES.get(key, ())
    return ranges[place] if place < len(ranges) else None


def outside(key: str, place: int, value: float) -> str:
    """Return an error text if `value` is out of range, else ''."""
    low, high = limits(key, place) or (-inf, inf)
    if low <= value <= high:
        return ''
    return f'{value:.10g} ' + (
        f'is not in {low:g}..{high:.10g}' if high < inf else f'is below {low:g}'
    )


def refuse(name: str, key: str, place: int, value: float) -> None:
    wrong = f'{name}: {outside(key, place, value)}'
    if (limits(key, place) or _TASKS)[1] == _TASKS[1]:
        raise SpelError(ErrorNumber.TASK_NUMBER, wrong)
    raise SpelError(ErrorNumber.ARGUMENT, wrong)
