# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A case: the steps performed on a target, so that it can be stored and repeated.

A step is a word and its arguments: `send PORT BYTES`, `wait SECONDS`, `open PORT`, `do WHAT`.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Step = tuple[Any, ...]
"""A word and its arguments: text, numbers and bytes."""


class FoundError(AssertionError):
    """A failed check, with the reason as text."""


@dataclass(frozen=True)
class Case:
    """The steps performed on a target."""

    target: str
    steps: tuple[Step, ...]

    @property
    def inputs(self) -> int:
        """Number of messages, lines or pieces of them."""
        return sum(step[0] == 'send' for step in self.steps)

    def as_text(self) -> str:
        """Return it as JSON: bytes in hexadecimal, a step on a line."""
        steps = ',\n  '.join(json.dumps([_written(part) for part in step]) for step in self.steps)
        return f'{{"target": {json.dumps(self.target)},\n "steps": [\n  {steps}]}}\n'

    @staticmethod
    def read(path: Path) -> 'Case':
        """Return the case of a file."""
        data = json.loads(path.read_text(encoding='utf-8'))
        steps = tuple(tuple(_read(part) for part in step) for step in data['steps'])
        return Case(data['target'], steps)


def _written(part: Any) -> Any:
    return {'hex': part.hex()} if isinstance(part, bytes) else part


def _read(part: Any) -> Any:
    return bytes.fromhex(part['hex']) if isinstance(part, dict) else part


def reduced(case: Case, fails: Callable[[Case], bool], most: int = 400) -> Case:
    """Return a smaller case that still fails, after at most `most` trials."""
    steps, fraction, trials = list(case.steps), 2, 0
    while fraction <= 2 * len(steps) and trials < most:
        size = max(len(steps) // fraction, 1)
        for start in range(0, len(steps), size):
            trials += 1
            fewer = steps[:start] + steps[start + size :]
            if fewer and fails(Case(case.target, tuple(fewer))):
                steps = fewer
                break
            if trials >= most:
                break
        else:
            if size == 1:
                break
            fraction *= 2
    return Case(case.target, tuple(steps))
