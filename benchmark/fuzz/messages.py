# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Valid messages and lines, and their mutations.

The bytes are made with struct alone, from a separate table. Otherwise an error in the package's
layouts would be in the inputs, too. A mutation keeps most of the structure, because random bytes
would be rejected by their first four.
"""

import random
import struct
from collections.abc import Callable

TOPIC, REQUEST, REPLY = 1, 2, 3
POINT, POINT_FULL, STOP = 11, 14, -4

BODIES: dict[int, tuple[str, ...]] = {
    1: ('', '10i'),
    2: ('', '3i'),
    10: ('i10r',),
    11: ('i12r',),
    13: ('7i',),
    14: ('3i31r',),
    15: ('2i31r',),
    2001: ('3i10r',),
    2002: ('5i10r',),
    2003: ('i',),
    2004: ('2i',),
    2005: ('2i',),
    2006: ('i',),
    2007: ('i',),
    2008: ('2i',),
    2009: ('2i',),
    2010: ('i',),
    2011: ('2i',),
    65200: ('i',),
    65201: ('4i', '7i', '13i'),
    65202: ('4i', '5i', '9i'),
    65203: ('3i', '4i'),
    65204: ('5i', '8i'),
    65205: ('3i', '4i'),
    65206: ('6i', '12i'),
}
"""Type of a message → forms of its body: `i` is an int32, `r` a real, `3i` three of them."""

INTS = (
    *range(-5, 15),
    16, 32, 63, 64, 100, 199, 200, 201, 255, 256, 1000, 1001, 32767, 65535, 65536,
    200_101, 200_111, 200_112, 200_113, 200_114, 200_115, 200_120, 200_121, 200_130,
    2**31 - 1, -(2**31), -65536,
)  # fmt: skip
REALS = (
    0.0, -0.0, 0.01, 0.05, 0.1, -0.1, 0.3, 0.5, 1.0, -1.0, 1.5, 3.1, -3.1, 100.0, 1e6, -1e6, 1e30,
    1e-30, 1e-45, float('nan'), float('inf'), float('-inf'), 3.4e38, -3.4e38,
)  # fmt: skip

STATES = (10, 13, 15)
"""Message types sent unrequested by a state server."""

Chance = random.Random


def frame(kind: int, comm: int, code: int, body: bytes, order: str = '<') -> bytes:
    """Return a message with its header and its true length."""
    return struct.pack(order + '4i', 12 + len(body), kind, comm, code) + body


def body_of(chance: Chance, form: str, order: str, real: str, *, calm: bool) -> bytes:
    """Return a body of the given form. `calm`: with plausible numbers."""
    parts = []
    number = ''
    for sign in form:
        if sign.isdigit():
            number += sign
            continue
        count, number = int(number or '1'), ''
        if sign == 'i':
            ints = [chance.randrange(-4, 4) if calm else chance.choice(INTS) for _ in range(count)]
            parts.append(struct.pack(f'{order}{count}i', *ints))
        else:
            reals = [
                chance.uniform(-0.3, 0.3) if calm else chance.choice(REALS) for _ in range(count)
            ]
            parts.append(struct.pack(f'{order}{count}{real}', *reals))
    return b''.join(parts)


def message(chance: Chance, kinds: tuple[int, ...] = (), order: str = '<') -> bytes:
    """Return a valid message of one of the kinds, by default of any kind."""
    kind = chance.choice(kinds or tuple(BODIES))
    comm = TOPIC if kind in STATES and chance.random() < 0.8 else chance.choice((1, 2, 2, 2, 3))
    code = chance.choice((1, 2)) if comm == REPLY else 0
    real = 'd' if chance.random() < 0.05 else 'f'
    form = chance.choice(BODIES[kind])
    body = body_of(chance, form, order, real, calm=chance.random() < 0.6)
    if kind == 13 and chance.random() < 0.7:
        body = struct.pack(order + '7i', 1, 0, 0, 0, chance.randrange(2), 2, 1)
    return frame(kind, comm, code, body, order)


def point(chance: Chance, sequence: int, order: str = '<', *, duration: float = 0.0) -> bytes:
    """Return a point with every joint within 0.3 rad of zero."""
    joints = [round(chance.uniform(-0.3, 0.3), 3) for _ in range(6)]
    body = struct.pack(order + 'i12f', sequence, *joints, *[0.0] * 5, duration)
    return frame(POINT, REQUEST, 0, body, order)


def full_point(chance: Chance, sequence: int, seconds: float, order: str = '<') -> bytes:
    """Return a point in the form for a Motoman."""
    joints = [round(chance.uniform(-0.1, 0.1), 3) if sequence else 0.0 for _ in range(6)]
    body = struct.pack(order + '3i31f', 0, sequence, 7, seconds, *joints, *[0.0] * 24)
    return frame(POINT_FULL, REQUEST, 0, body, order)


def mutated(chance: Chance, data: bytes) -> bytes:
    """Return the bytes with one or a few changes."""
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        data = chance.choice(MUTATIONS)(chance, data)
    return data


def _flip(chance: Chance, data: bytes) -> bytes:
    if not data:
        return data
    changed = bytearray(data)
    changed[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _word(chance: Chance, data: bytes) -> bytes:
    """Replace a word, possibly of the header, by an int or a real."""
    if len(data) < 4:
        return data
    at = 4 * chance.randrange(len(data) // 4)
    order = chance.choice('<<<>')
    if chance.random() < 0.5:
        word = struct.pack(order + 'i', chance.choice(INTS))
    else:
        word = struct.pack(order + 'f', chance.choice(REALS))
    return data[:at] + word + data[at + 4 :]


def _header(chance: Chance, data: bytes) -> bytes:
    """Change the message type, communication type or reply code, with a correct length."""
    if len(data) < 16:
        return data
    words = list(struct.unpack_from('<4i', data))
    choices: tuple[tuple[int, ...], ...] = (tuple(BODIES), (0, 1, 2, 3, 4), (0, 1, 2, 3))
    which = chance.randrange(3)
    words[1 + which] = chance.choice(choices[which])
    return struct.pack('<4i', *words) + data[16:]


def _length(chance: Chance, data: bytes) -> bytes:
    if len(data) < 4:
        return data
    length = chance.choice(
        (len(data) - 4 + chance.randrange(-8, 9), chance.choice(INTS), chance.randrange(70_000))
    )
    return struct.pack('<i', length) + data[4:]


def _cut(chance: Chance, data: bytes) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _resized(chance: Chance, data: bytes) -> bytes:
    """Lengthen or shorten the body, and correct the length field."""
    if len(data) < 16:
        return data
    body = data[16:]
    body = (
        body[: chance.randrange(len(body) + 1)]
        if chance.random() < 0.5
        else body + chance.randbytes(chance.choice((1, 4, 8, 40, 400)))
    )
    return struct.pack('<i', 12 + len(body)) + data[4:16] + body


def _swapped(_chance: Chance, data: bytes) -> bytes:
    """Write every word in the other byte order."""
    whole = len(data) // 4 * 4
    words = (data[at : at + 4][::-1] for at in range(0, whole, 4))
    return b''.join(words) + data[whole:]


def _inserted(chance: Chance, data: bytes) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.randbytes(chance.choice((1, 2, 4, 16))) + data[at:]


def _removed(chance: Chance, data: bytes) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + data[at + chance.choice((1, 2, 4, 16)) :]


def _twice(_chance: Chance, data: bytes) -> bytes:
    return data + data if len(data) < 4000 else data


MUTATIONS: tuple[Callable[[Chance, bytes], bytes], ...] = (
    _flip, _flip, _word, _word, _word, _header, _header, _length, _cut, _resized, _swapped,
    _inserted, _removed, _twice,
)  # fmt: skip

# --- Remote Ethernet ----------------------------------------------------------------------------

WORDS = (
    '', '0', '1', '-1', '16', '99999999999999999999', '0x10', 'F', 'on', 'off', '1.5', 'nan',
    'inf', '"Print Tmr(0)"', '"Motor On"', '"Power High"', '"Speed 50"', '"Accel 50, 50"',
    '"On 1"', '"', '"Go P1"', '"' + 'x' * 300 + '"', 'press', 'open', 'close', 'auto', 'manual',
    'high', 'low', 'DI', 'DO', 'AI', 'flag', 'list', 'clear', 'cut', 'delay', 'for=1',
    'port=state', 'seconds=1e9', ' ', 'é', '\x00', '$', '#', '!', 'why',
)  # fmt: skip
"""Parameters of commands, valid and invalid."""


def command(chance: Chance, names: tuple[str, ...]) -> bytes:
    """Return a line of Remote Ethernet, valid or nearly so."""
    words = [chance.choice(names), *chance.choices(WORDS, k=chance.randrange(4))]
    line = '$' + ','.join(words)
    end = chance.choice(('\r\n', '\r\n', '\r\n', '\n', '\r', '', '\r\r\n'))
    return (line + end).encode()


def answer(chance: Chance, line: bytes) -> bytes:
    """Return an answer to a line of Remote Ethernet, valid or nearly so."""
    name = line.removeprefix(b'$').split(b',')[0].strip()
    value = chance.choice(
        (b'0', b'1,1,1', b'00100000001,0000', b'', b'20', b'99', b'9' * 40, b'\xff\xfe', b'-1')
    )
    first = chance.choice((b'#', b'#', b'#', b'#', b'!', b'$', b''))
    return first + name + b',' + value + chance.choice((b'\r\n', b'\r\n', b'\r\n', b'\n', b''))
