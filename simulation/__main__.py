# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Play worlds, and print the first violation of an invariant (docs/reliability.md)."""

import argparse
import hashlib
import secrets
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from simulation.events import Event, events_of
from simulation.oracles import BrokenError
from simulation.shrink import shrunk
from simulation.world import World, quiet

KEPT = 200
"""Maximum number of seeds that are kept for variation, because they reached a new situation."""


def main() -> int:
    parser = argparse.ArgumentParser(prog='python -m simulation', description=__doc__)
    parser.add_argument('--seed', help='one world: a number, or numbers joined by dots')
    parser.add_argument(
        '--count', type=int, default=1, help='number of seeds, starting with --seed'
    )
    parser.add_argument('--minutes', type=float, help='play new seeds for this time')
    parser.add_argument('--log', action='store_true', help='print all that happened')
    parser.add_argument('--no-shrink', action='store_true', help='do not shorten failing worlds')
    arguments = parser.parse_args()
    tally = Tally()
    for seed in _seeds(arguments, tally):
        world, events = World(seed), events_of(seed)
        with quiet():
            error = played(world, events)
        tally.take(seed, world)
        if arguments.log:
            print('\n'.join(world.log))
            print(hashlib.sha256('\n'.join(world.log).encode()).hexdigest())
        if error is not None:
            print(f'{seed}@{_commit()}: {error}', flush=True)
            if not arguments.no_shrink:
                report(seed, shrunk(seed, events, error))
    print(tally)
    return int(tally.failed > 0)


def played(world: World, events: list[Event]) -> BrokenError | None:
    """Play a world and return the violated invariant, or None."""
    try:
        world.play(events)
    except BrokenError as error:
        return error
    return None


def report(seed: str, events: list[Event]) -> None:
    world = World(seed)
    with quiet():
        played(world, events)
    print('\nThe story, times in s:')
    print('\n'.join(f'    {line}' for line in world.log))
    print('\nAs a test:\n')
    print(f'    def test_seed_{seed.replace(".", "_")}():')
    print(f"        World('{seed}').play([")
    for event in events:
        print(f'            Event({event.after!r}, {event.kind!r}, {event.parameters!r}),')
    print('        ])\n', flush=True)


class Tally:
    """Counts of worlds and events, and the situations reached."""

    def __init__(self) -> None:
        self.worlds = self.events = self.failed = 0
        self.robot_seconds = 0.0
        self.situations: set[tuple[str, ...]] = set()
        self.kept: list[str] = []
        self._began = time.process_time()

    def take(self, seed: str, world: World) -> None:
        self.worlds += 1
        self.events += world.events
        self.failed += world.broken is not None
        self.robot_seconds += world.loop.time() - 1000.0
        if not world.situations <= self.situations:
            self.situations |= world.situations
            self.kept = [*self.kept, seed][-KEPT:]

    def __str__(self) -> str:
        used = time.process_time() - self._began
        return (
            f'{self.worlds} worlds, {self.events} events, {self.robot_seconds:.0f} s of the robot '
            f'in {used:.0f} s of the processor, {len(self.situations)} situations, '
            f'{self.failed} failed'
        )


def _seeds(arguments: argparse.Namespace, tally: Tally) -> Iterator[str]:
    if arguments.minutes is None:
        first, *others = (arguments.seed or '1').split('.')
        for number in range(int(first), int(first) + arguments.count):
            yield '.'.join([str(number), *others])
        return
    ends = time.monotonic() + 60.0 * arguments.minutes
    number = int(arguments.seed) if arguments.seed else secrets.randbelow(2**32)
    while time.monotonic() < ends:
        number += 1
        yield str(number)
        if tally.kept and time.monotonic() < ends:
            yield f'{tally.kept[number % len(tally.kept)]}.{number % 1000}'


def _commit() -> str:
    run = subprocess.run(
        ['git', 'describe', '--always', '--dirty'],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    )
    return run.stdout.strip() or 'unknown'


if __name__ == '__main__':
    sys.exit(main())
