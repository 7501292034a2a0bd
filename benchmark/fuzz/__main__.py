# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fuzz both roles and all ports: a million inputs, or a given number.

Requirements: no crash, no hang, no motion without a command, bounded memory, a paced log, and the
next valid connection works. Findings are written to build/fuzz as small cases. A case belongs in
test/fuzz/cases once it is fixed, where a test repeats it. Exit code 1 if anything was found.
"""

import argparse
import gc
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmark import ROOT
from benchmark.fuzz import socket_targets
from benchmark.fuzz.cases import Case
from benchmark.fuzz.runner import (
    MAX_GROWTH_BYTES,
    Figures,
    Fuzzer,
    Novelty,
    listening,
    resident,
    why_it_fails,
)
from benchmark.fuzz.targets import Target, in_process

FOUND = ROOT / 'build' / 'fuzz'
WARM_CASES = 3
ROUNDS = 50
"""Number of portions of inputs per target, so that an interrupted run has covered all targets."""

TOLD = 10
"""Portions between progress lines, if the output is not a terminal."""

SOCKET_SHARE = 0.02
"""Share of all inputs that is sent through real sockets to real processes, per process."""


def main() -> int:
    """Run the fuzzer. Returns 1 if something was found."""
    parser = argparse.ArgumentParser(prog='benchmark.fuzz', description=__doc__)
    parser.add_argument('--inputs', type=int, default=1_000_000)
    parser.add_argument('--seed', type=int, default=20)
    parser.add_argument('--only', default='', metavar='TEXT', help='targets whose names have it')
    parser.add_argument('--no-sockets', action='store_true', help='nothing through real sockets')
    parser.add_argument(
        '--case', type=Path, metavar='FILE', help='repeat a case, and nothing else'
    )
    arguments = parser.parse_args()
    shares = {
        target: fraction
        for target, fraction in in_process().items()
        if arguments.only in target.name
    }
    if arguments.case is not None:
        case = Case.read(arguments.case)
        target = next(item for item in shares if item.name == case.target)
        with listening(Novelty()):
            why = why_it_fails(target, case)
        print(why or 'all held')
        return int(bool(why))
    result: dict[str, Figures] = {}
    if shares:
        fuzz_in_process(shares, arguments.inputs, arguments.seed, result)
    if not arguments.no_sockets:
        count = max(int(arguments.inputs * SOCKET_SHARE), 1_000)
        for name, fuzz in socket_targets.TARGETS.items():
            if arguments.only in name:
                show(f'{name}: {count:,} inputs', end=True)
                result[name] = fuzz(count, arguments.seed)
    texts = [text for figures in result.values() for text in figures.found]
    for name, figures in result.items():
        rate = figures.inputs / max(figures.seconds, 1e-9)
        print(f'{name:60} {figures.inputs:9,} inputs {rate:9,.0f}/s {len(figures.found)} found')
    print(f'{sum(figures.inputs for figures in result.values()):,} inputs, {len(texts)} found')
    for text in texts:
        print(f'FOUND {text}')
    return int(bool(texts))


def fuzz_in_process(
    shares: dict[Target, float], inputs: int, seed: int, found: dict[str, Figures]
) -> None:
    """Give each target its share of the inputs, in turns, and check this process's memory."""
    fuzzers = {Fuzzer(target, seed, FOUND): fraction for target, fraction in shares.items()}
    total = sum(shares.values())
    for fuzzer in fuzzers:
        found[fuzzer.target.name] = fuzzer.figures
        fuzzer.run(lambda figures: figures.cases >= WARM_CASES)
    gc.collect()
    before, began = resident(), time.monotonic()
    for turn in range(1, ROUNDS + 1):
        for fuzzer, fraction in fuzzers.items():
            wanted = inputs * fraction / total * turn / ROUNDS
            if fuzzer.figures.inputs < wanted and not fuzzer.figures.found:
                fuzzer.run(reached(wanted))
        done = sum(figures.inputs for figures in found.values())
        rate = done / max(time.monotonic() - began, 1e-9)
        bad = sum(len(figures.found) for figures in found.values())
        text = f'{done:,} of {inputs:,} inputs, {rate:,.0f}/s, {bad} found'
        show(text, end=turn == ROUNDS or (turn % TOLD == 0 and not sys.stderr.isatty()))
    gc.collect()
    grown = resident() - before
    print(f'memory: {grown / 1e6:+.1f} MB after the first {WARM_CASES} cases of each target')
    if grown > MAX_GROWTH_BYTES:
        next(iter(found.values())).found.append(f'this process grew by {grown / 1e6:.0f} MB')


def reached(inputs: float) -> Callable[[Figures], bool]:
    """Return a condition that is true once a target has had `inputs` inputs."""
    return lambda figures: figures.inputs >= inputs


def show(text: str, *, end: bool) -> None:
    """Show progress, on a terminal always in the same line."""
    if sys.stderr.isatty():
        print(f'\r\033[K{text}', end='\n' if end else '', file=sys.stderr, flush=True)
    elif end:
        print(text, file=sys.stderr, flush=True)


if __name__ == '__main__':
    sys.exit(main())
