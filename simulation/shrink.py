# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Finds the smallest event list that still fails in the same way."""

from simulation.events import Event
from simulation.oracles import BrokenError
from simulation.world import World, quiet

MAX_PLAYS = 300


def shrunk(seed: str, events: list[Event], error: BrokenError) -> list[Event]:
    """Return a list in which every event is needed for the same failure.

    Halves are removed first, then ever smaller parts (delta debugging, Zeller 2002).
    """
    left, size = MAX_PLAYS, max(len(events) // 2, 1)
    while True:
        at = 0
        removed = False
        while at < len(events) and left:
            fewer = [*events[:at], *events[at + size :]]
            if at + size < len(events):  # the following event keeps its time
                gone = sum(event.after for event in events[at : at + size])
                follows = events[at + size]
                later = Event(round(follows.after + gone, 4), follows.kind, follows.parameters)
                fewer[at] = later
            left -= 1
            if _fails(seed, fewer, error):
                events, removed = fewer, True
            else:
                at += size
        if not left or (size == 1 and not removed):
            return events
        if not removed:
            size = max(size // 2, 1)


def _fails(seed: str, events: list[Event], error: BrokenError) -> bool:
    world = World(seed)
    with quiet():
        try:
            world.play(events)
        except BrokenError as result:
            return str(result)[:12] == str(error)[:12]
    return False
