# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs a target's cases, with a growing corpus and checks for hangs, memory and failures."""

import contextlib
import logging
import os
import random
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from benchmark.fuzz.cases import Case, reduced
from benchmark.fuzz.targets import Target

HANG_S = 30.0
"""CPU time of this process after which a case counts as hung, s. A normal one takes a tenth of a
second."""

CORPUS_SIZE = 500
FOUND_AT_MOST = 5
"""Maximum number of findings per target: more would be similar."""

MAX_GROWTH_BYTES = 60_000_000
"""Maximum growth of this process, bytes, after the first cases of each target."""

PAGE_BYTES = os.sysconf('SC_PAGE_SIZE')


class HangError(Exception):
    """A case did not end."""


@dataclass
class Figures:
    """Results of a target."""

    inputs: int = 0
    cases: int = 0
    seconds: float = 0.0
    corpus: int = 0
    found: list[str] = field(default_factory=list)


class Novelty(logging.Handler):
    """Records which lines of code log. An input that makes a new line log joins the corpus."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.seen: set[tuple[str, int]] = set()
        self.new = False

    def emit(self, record: logging.LogRecord) -> None:
        """Record the location of a log call, without formatting its text."""
        place = (record.pathname, record.lineno)
        if place not in self.seen:
            self.seen.add(place)
            self.new = True


@contextlib.contextmanager
def listening(novelty: Novelty) -> Iterator[None]:
    """Redirect the package's log to `novelty` within the block."""
    log = logging.getLogger('epson_driver')
    level, propagate = log.level, log.propagate
    log.addHandler(novelty)
    log.setLevel(logging.INFO)
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(novelty)
        log.setLevel(level)
        log.propagate = propagate


@contextlib.contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Raise HangError if the block computes longer. Only in the main thread.

    The limit applies to this process's CPU time, so a busy machine causes no false alarm. Nothing
    in a case waits for another process.
    """

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise HangError(f'not done after {seconds:g} s')

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def seeded(seed: int, name: str, number: int) -> random.Random:
    """Return the random generator of a case, determined by seed, target and number."""
    return random.Random(f'{seed}/{name}/{number}')


def why_it_fails(target: Target, case: Case) -> str:
    """Run a case and return the failed check, or ''."""
    try:
        with no_longer_than(HANG_S):
            target.run(case)
    except Exception as error:  # noqa: BLE001 - this is the failure searched for
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f'{Path(where.filename).name}:{where.lineno}'
        return f'{type(error).__name__}: {error} ({place})'
    return ''


class Fuzzer:
    """Fuzzes one target with a seed. Failing cases are reduced and written to `folder`.

    Each case is drawn from its own generator and a corpus that depends on the previous cases. The
    same seed repeats the whole run.
    """

    def __init__(self, target: Target, seed: int, folder: Path | None) -> None:
        self.target = target
        self.figures = Figures()
        self._seed = seed
        self._folder = folder
        self._corpus: list[bytes] = []
        self._novelty = Novelty()

    def run(self, until: Callable[[Figures], bool]) -> None:
        """Run cases until a condition holds, at least one."""
        with listening(self._novelty):
            while True:
                self._one()
                if until(self.figures) or len(self.figures.found) >= FOUND_AT_MOST:
                    return

    def _one(self) -> None:
        figures, novelty = self.figures, self._novelty
        chance = seeded(self._seed, self.target.name, figures.cases)
        case = self.target.case(chance, self._corpus)
        novelty.new = False
        began = time.perf_counter()
        why = why_it_fails(self.target, case)
        figures.seconds += time.perf_counter() - began
        figures.inputs += case.inputs
        figures.cases += 1
        if novelty.new:
            self._keep(chance, case)
        if why:
            self._found(case, why)

    def _keep(self, chance: random.Random, case: Case) -> None:
        """Add inputs of a new kind of case to the corpus."""
        sent = [step[2] for step in case.steps if step[0] == 'send' and step[2]]
        self._corpus += chance.sample(sent, min(len(sent), 10))
        del self._corpus[:-CORPUS_SIZE]
        self.figures.corpus = len(self._corpus)

    def _found(self, case: Case, why: str) -> None:
        kind = why.partition(':')[0]
        small = reduced(
            case, lambda other: why_it_fails(self.target, other).partition(':')[0] == kind
        )
        text = f'{self.target.name}: {why_it_fails(self.target, small) or why}'
        self.figures.found.append(text)
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            words = ''.join(sign if sign.isalnum() else '_' for sign in self.target.name)
            path = self._folder / f'{words}_{self._seed}_{self.figures.cases}.json'
            path.write_text(small.as_text(), encoding='utf-8')
            self.figures.found[-1] += f' [{path.name}]'


def resident() -> int:
    """Return the resident memory of this process, bytes."""
    text = Path('/proc/self/statm').read_text(encoding='ascii')
    return int(text.split()[1]) * PAGE_BYTES
