# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Typed access to the keys of a model file. Errors name file, key, value and rule."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.inputs import JOINT_NAMES, InputError, number, printable, shown
from epson_driver.motion import Array

CONFIDENCES = ('high', 'medium', 'low')
"""Best first."""

Range = tuple[float, float, str]
"""Smallest and largest value, and their unit."""


@dataclass(frozen=True)
class Provenance:
    """Where the numbers of a quantity come from, and how far each of them can be trusted.

    `confidence` has one entry per joint, or a single one for a quantity that is not per joint.
    """

    source: str
    confidence: tuple[str, ...]

    @property
    def worst(self) -> str:
        """The lowest confidence of all its numbers."""
        return max(self.confidence, key=CONFIDENCES.index)


class Reader:
    """The keys of one file, checked for type, length and range."""

    def __init__(self, path: Path) -> None:
        self._file = printable(path)

    def error(self, key: str, value: object, rule: str) -> InputError:
        """Return the error for a value that breaks a rule."""
        return InputError(f'{self._file}: {key} = {shown(value)}: {rule}')

    def get(self, block: Any, key: str, kind: type, where: str = '') -> Any:
        """Return the value of a key that must be there and of one type."""
        if not isinstance(block, dict):
            raise self.error(where.rstrip('.') or 'the file', block, 'must be a mapping')
        if key not in block:
            raise InputError(f'{self._file}: {where}{key} is missing')
        if not isinstance(block[key], kind):
            raise self.error(where + key, block[key], f'must be a {kind.__name__}')
        return block[key]

    def names(self, block: Any, key: str) -> tuple[str, ...]:
        """Return a list of joint names, at least one."""
        value = self.get(block, key, list)
        names: tuple[str, ...] = JOINT_NAMES.checked(value, f'{self._file}: {key}')
        return names

    def choices(
        self, block: Any, key: str, allowed: tuple[str, ...], count: int
    ) -> tuple[str, ...]:
        """Return one word per joint; without the key, the first of the allowed words for each."""
        if not isinstance(block, dict) or key not in block:
            return (allowed[0],) * count
        words = self.get(block, key, list)
        if len(words) != count or not all(word in allowed for word in words):
            rule = f'must be a list of one per joint, each of {", ".join(allowed)}'
            raise self.error(key, words, rule)
        return tuple(words)

    def numbers(
        self,
        block: Any,
        key: str,
        where: str,
        count: int,
        range_: Range,
        of: str = 'one per joint',
    ) -> Array:
        """Return `count` numbers within a range."""
        values = self.get(block, key, list, where + '.')
        if len(values) != count:
            raise self.error(f'{where}.{key}', values, f'must have {count} numbers, {of}')
        for value in values:
            self._number(value, f'{where}.{key}', range_)
        return np.array(values, dtype=float)

    def number(self, block: Any, key: str, where: str, range_: Range) -> float:
        """Return one number within a range."""
        return self._number(self.get(block, key, object, where + '.'), f'{where}.{key}', range_)

    def vectors(self, block: Any, key: str, where: str, count: int, range_: Range) -> Array:
        """Return `count` vectors of three numbers within a range, shape (count, 3)."""
        rows = self.get(block, key, list, where + '.')
        if len(rows) != count:
            raise self.error(f'{where}.{key}', rows, f'must have {count} vectors, one per joint')
        for row in rows:
            if not isinstance(row, list) or len(row) != 3:
                raise self.error(f'{where}.{key}', row, 'must have 3 numbers, x, y and z')
            for value in row:
                self._number(value, f'{where}.{key}', range_)
        return np.array(rows, dtype=float)

    def provenance(self, block: Any, where: str, count: int = 1) -> Provenance:
        """Return `source` and `confidence` of a quantity that has `count` numbers."""
        confidence = block.get('confidence')
        entries = confidence if isinstance(confidence, list) else [confidence] * count
        if len(entries) != count or any(entry not in CONFIDENCES for entry in entries):
            rule = f'must be one of {", ".join(CONFIDENCES)}'
            more = ', or a list of one per joint' if count > 1 else ''
            raise self.error(f'{where}.confidence', confidence, rule + more)
        return Provenance(self.get(block, 'source', str, where + '.'), tuple(entries))

    def _number(self, value: object, key: str, range_: Range) -> float:
        checked: float = number(*range_).checked(value, f'{self._file}: {key}')
        return checked
