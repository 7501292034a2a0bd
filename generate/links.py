# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The shape of each link of a six-axis arm, in its own frame, mm.

Proportions are those of the C3 (overall sizes: the bounding boxes of the ROS 1 support package's
links); everything between the joints follows the chain, the rest `thickness`. What EPSON's
drawings show in detail, such as bolt patterns, is for the eye only.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from generate.dimensions import Dimensions
from generate.shapes import Solid, ball, bolts, box, casting, drum, mirrored

WHITE, DARK, METAL = 'white', 'dark', 'metal'

LEFT, RIGHT, BACK = 2, 3, 4
"""Parts that are mirror images of each other; all others are symmetric in themselves."""


@dataclass(frozen=True)
class Piece:
    """A solid, its colour, and the convex part of the collision geometry that it belongs to."""

    colour: str
    solid: Solid
    part: int = 0


def base_link(d: Dimensions) -> Iterator[Piece]:
    """Foot, column with the bearing of joint 1, and the connector box behind."""
    t, top = d.thickness, d.base
    foot = box((-92 * t, 90 * t), (-90 * t, 90 * t), (0.0, 20 * t), edge=5 * t)
    slot = [
        drum('z', (x * t, y * t, 0.0), 7 * t, (-1.0, 30 * t), sides=12, ends='none')
        for x in (-76, 76)
        for y in (-76, 76)
    ]
    for each in slot:
        foot -= each
    yield Piece(WHITE, foot)
    column = casting(
        drum('z', (0, 0, 0), 84 * t, (8 * t, 40 * t), edge=8 * t),
        drum('z', (0, 0, 0), 78 * t, (top - 40 * t, top - 9 * t), edge=4 * t),
    )
    yield Piece(WHITE, column, 1)
    yield Piece(DARK, drum('z', (0, 0, 0), 74 * t, (top - 12 * t, top + 1.0), ends='none'), 1)
    back = casting(
        box((-190 * t, -60 * t), (-64 * t, 64 * t), (0.0, 118 * t), edge=9 * t),
        box((-70 * t, -20 * t), (-70 * t, 70 * t), (0.0, top - 34 * t), edge=9 * t),
    )
    yield Piece(WHITE, back, BACK)
    yield Piece(DARK, box((-194 * t, -180 * t), (-54 * t, 54 * t), (14 * t, 106 * t), 3 * t), BACK)
    for y, z, r in (
        (-30, 80, 13),
        (6, 80, 13),
        (36, 80, 8),
        (-30, 42, 8),
        (0, 42, 8),
        (30, 42, 8),
    ):
        plug = drum(
            'x', (0, y * t, z * t), r * t, (-199.5 * t, -185 * t), edge=2.0, sides=16, ends='low'
        )
        yield Piece(METAL if r > 10 else DARK, plug, BACK)


def link_1(d: Dimensions) -> Iterator[Piece]:
    """Turret with two cheeks that hold the shoulder between them, and the motor's hump behind."""
    t, x, z = d.thickness, d.shoulder_x, d.shoulder_z
    yield Piece(DARK, drum('z', (0, 0, 0), 78 * t, (-8.5 * t, 6 * t), ends='none'))
    floor = min(58 * t, z - 63 * t)
    turret = casting(
        drum('z', (0, 0, 0), 82 * t, (3 * t, floor - 8 * t), edge=5 * t),
        drum('z', (0, 0, 0), 80 * t, (3 * t, floor), edge=10 * t),
    )
    yield Piece(WHITE, turret)
    rise = z - 123.5 * t
    hump = casting(
        drum('z', (-30 * t, 0, 0), 50 * t, (floor - 30 * t, floor + 26 * t + rise), edge=14 * t),
        box((-20 * t, 24 * t), (-60 * t, 60 * t), (floor - 30 * t, floor + 16 * t + rise), 10 * t),
    )
    yield Piece(WHITE, hump)
    for side in (LEFT, RIGHT):
        cheek = casting(
            drum('y', (x, 0, z), 56 * t, (57 * t, 95 * t), edge=8 * t, ends='high'),
            drum(
                'y',
                (-8 * t, 0, 48 * t),
                38 * t,
                (50 * t, 84 * t),
                edge=10 * t,
                sides=16,
                ends='high',
            ),
            drum(
                'y',
                (40 * t, 0, 36 * t),
                30 * t,
                (50 * t, 84 * t),
                edge=10 * t,
                sides=16,
                ends='high',
            ),
        )
        cap = drum('y', (x, 0, z), 43 * t, (90 * t, 99 * t), edge=2.0, sides=24, ends='high')
        heads = bolts('y', (x, 0, z), 36 * t, 8, 3.0 * t, (95 * t, 100.5 * t))
        hub = drum('y', (x, 0, z), 17 * t, (95 * t, 101 * t), edge=2.0, sides=16, ends='high')
        for colour, solid in ((WHITE, cheek), (DARK, cap), (DARK, hub)):
            yield Piece(colour, solid if side == LEFT else mirrored(solid), side)
        for head in heads:
            yield Piece(METAL, head if side == LEFT else mirrored(head), side)


def link_2(d: Dimensions) -> Iterator[Piece]:
    """Shoulder drum, a slab, and the fork that holds the elbow and lets the forearm in."""
    t, top = d.thickness, d.upper
    yield Piece(DARK, drum('y', (0, 0, 0), 55 * t, (-59 * t, 59 * t), ends='none'))
    cross = top - 162 * t
    slab = casting(
        drum('y', (0, 0, 0), 50 * t, (-53 * t, 53 * t), edge=4 * t),
        drum('y', (0, 0, max(cross, 66 * t)), 42.5 * t, (-53 * t, 53 * t), edge=10 * t, sides=20),
    )
    yield Piece(WHITE, slab)
    low = max(cross - 30 * t, 64 * t)
    bridge = casting(
        box((-36 * t, 36 * t), (-70 * t, 70 * t), (low, low + 40 * t), edge=12 * t),
        box((-44 * t, 44 * t), (-97 * t, 97 * t), (low + 14 * t, low + 42 * t), edge=12 * t),
    )
    yield Piece(WHITE, bridge, 1)
    for side in (LEFT, RIGHT):
        wing = casting(
            drum('y', (0, 0, top), 49 * t, (64 * t, 95 * t), edge=8 * t, ends='high'),
            box((-45 * t, 45 * t), (64 * t, 96 * t), (low + 11 * t, low + 44 * t), edge=10 * t),
        )
        cap = drum('y', (0, 0, top), 38 * t, (90 * t, 99 * t), edge=2.0, sides=24, ends='high')
        hub = drum('y', (0, 0, top), 14 * t, (95 * t, 100.5 * t), edge=2.0, sides=16, ends='high')
        heads = bolts('y', (0, 0, top), 31 * t, 8, 2.6 * t, (95 * t, 100.5 * t))
        for colour, solid in ((WHITE, wing), (DARK, cap), (DARK, hub)):
            yield Piece(colour, solid if side == LEFT else mirrored(solid), side)
        for head in heads:
            yield Piece(METAL, head if side == LEFT else mirrored(head), side)


def link_3(d: Dimensions) -> Iterator[Piece]:
    """Elbow between the fork's wings: motor behind, the bearing of joint 4 in front."""
    t, z = d.thickness, d.elbow_z
    yield Piece(DARK, drum('y', (0, 0, 0), 47 * t, (-66 * t, 66 * t), ends='none'))
    housing = casting(
        drum('y', (0, 0, 0), 54 * t, (-60 * t, 60 * t), edge=10 * t),
        drum('x', (0, 0, z), 53 * t, (-66 * t, 52 * t), edge=12 * t),
    )
    yield Piece(WHITE, housing)
    yield Piece(DARK, drum('x', (0, 0, z), 42 * t, (-82 * t, -60 * t), edge=9 * t, ends='low'))
    yield Piece(DARK, drum('x', (0, 0, z), 48 * t, (48 * t, 66 * t), ends='none'))
    for head in bolts('x', (0, 0, z), 33 * t, 6, 3.0 * t, (-83.5 * t, -78 * t)):
        yield Piece(METAL, head)


def link_4(d: Dimensions) -> Iterator[Piece]:
    """Forearm with the cable's hump on it, and the fork of the wrist."""
    t, end = d.thickness, d.forearm
    begin = 63 * t - d.elbow_x
    root = end - 78 * t
    tube = casting(
        drum('x', (0, 0, 0), 49 * t, (begin, begin + 22 * t), edge=8 * t),
        drum('x', (0, 0, 0), 43 * t, (root - 50 * t, root - 16 * t), edge=10 * t),
        box((root - 20 * t, root), (-50 * t, 50 * t), (-23 * t, 23 * t), edge=9 * t),
    )
    yield Piece(WHITE, tube)
    hump = casting(
        ball((begin + 30 * t, 0, 36 * t), 20 * t),
        ball((root - 42 * t, 0, 33 * t), 19 * t),
        ball((begin + 30 * t, 0, 10 * t), 34 * t),
        ball((root - 42 * t, 0, 10 * t), 30 * t),
    )
    yield Piece(DARK, hump)
    for side in (LEFT, RIGHT):
        wing = casting(
            drum('y', (end, 0, 0), 31 * t, (29 * t, 50 * t), edge=7 * t, ends='high'),
            box((root - 16 * t, root), (29 * t, 50 * t), (-23 * t, 23 * t), edge=8 * t),
        )
        cap = drum('y', (end, 0, 0), 24 * t, (46 * t, 54 * t), edge=2.0, sides=24, ends='high')
        hub = drum('y', (end, 0, 0), 9 * t, (50 * t, 55.5 * t), edge=1.6, sides=16, ends='high')
        for colour, solid in ((WHITE, wing), (DARK, cap), (METAL, hub)):
            yield Piece(colour, solid if side == LEFT else mirrored(solid), side)


def link_5(d: Dimensions) -> Iterator[Piece]:
    """The hand between the wrist's fork, with the bearing of joint 6."""
    t, face = d.thickness, d.wrist + d.flange - 9.2
    hand = casting(
        drum('y', (0, 0, 0), 29 * t, (-27 * t, 27 * t), edge=5 * t),
        drum('x', (0, 0, 0), 27 * t, (20 * t, face - 9.0), edge=4 * t, sides=32),
    )
    yield Piece(WHITE, hand)
    yield Piece(DARK, drum('y', (0, 0, 0), 25 * t, (-30 * t, 30 * t), sides=28, ends='none'))
    yield Piece(
        DARK, drum('x', (0, 0, 0), 25 * t, (face - 14.0, face + 1.5), sides=28, ends='none')
    )


def link_6(d: Dimensions) -> Iterator[Piece]:
    """The flange: a disc with a pilot bore and threaded holes."""
    t, face = d.thickness, d.flange
    disc = drum('x', (0, 0, 0), 30 * t, (face - 9.2, face), edge=1.2)
    disc -= drum('x', (0, 0, 0), 10 * t, (face - 5.0, face + 5.0), sides=24, ends='none')
    for hole in bolts('x', (0, 0, 0), 20 * t, 6, 2.6 * t, (face - 6.0, face + 5.0)):
        disc -= hole
    yield Piece(METAL, disc)


LINKS: dict[str, Callable[[Dimensions], Iterator[Piece]]] = {
    'base_link': base_link,
    'link_1': link_1,
    'link_2': link_2,
    'link_3': link_3,
    'link_4': link_4,
    'link_5': link_5,
    'link_6': link_6,
}
