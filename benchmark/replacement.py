# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How long a goal takes that replaces another one in mid-motion, compared with its own time.

`python -m benchmark.replacement`: driver and smooth controller, in virtual time, so that a busy
machine changes nothing; planning takes what the row says. Goals and moments are drawn, 12 of each
kind: `again`, what is left of the old one; `curve`, points to elsewhere; `one` point.
"""

import argparse
import logging
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from support.driver_harness import SlowPlanner
from support.event_loop import run
from support.replacement_runs import Replacement, replacement

KINDS = ('again', 'curve', 'one')
DELAYS: dict[str, tuple[float, ...]] = {
    '0 ms': (0.0,),
    '15 ms': (0.015,),
    '15 ms, one in 25 takes 80 ms': (*[0.015] * 24, 0.08),
    '60 ms': (0.06,),
    '120 ms': (0.12,),
}


def played(seed: int, kind: str, delays: tuple[float, ...], *, on_the_way: bool) -> Replacement:
    """Replace a goal once."""
    found: list[Replacement] = []

    async def play(patch: pytest.MonkeyPatch) -> None:
        planner = SlowPlanner(*delays)
        found.append(
            await replacement(patch, seed, on_the_way=on_the_way, new=kind, planner=planner)
        )

    with pytest.MonkeyPatch.context() as patch:
        run(play(patch))
    return found[0]


def geometric_mean(values: list[float]) -> float:
    """Return the geometric mean of positive values."""
    return float(np.exp(np.mean(np.log(values))))


def row(name: str, results: list[Replacement]) -> str:
    """Return a row of the table."""
    there = [result.there / result.planned for result in results]
    ended = [result.took / result.planned for result in results]
    kinds = [geometric_mean(there[start :: len(KINDS)]) for start in range(len(KINDS))]
    means = ' | '.join(f'{value:.3f}' for value in (geometric_mean(there), *kinds))
    rests = sum(result.rests for result in results)
    worst = max(result.worst for result in results)
    return f'| {name} | {means} | {geometric_mean(ended):.3f} | {rests} | {worst:.6f} |'


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=12)
    parser.add_argument('--only', default='', help='rows whose name has this in it')
    arguments = parser.parse_args()
    seeds = range(arguments.seeds)
    logging.disable(logging.WARNING)
    print('| planning takes | arm stands / planned |', *[f'{kind} |' for kind in KINDS], end='')
    print(' result / planned | rests | largest share of a limit |')
    print('| --- |', *['---: |'] * (len(KINDS) + 4))
    for name, delays in DELAYS.items():
        for on_the_way in (True, False) if name == '0 ms' else (True,):
            how = name if on_the_way else f'{name}, replace_goals: stop'
            if arguments.only not in how:
                continue
            results = [
                played(seed, kind, delays, on_the_way=on_the_way)
                for seed in seeds
                for kind in KINDS
            ]
            print(row(how, results), flush=True)


if __name__ == '__main__':
    main()
