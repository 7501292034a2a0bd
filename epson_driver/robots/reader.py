# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Typed access to the keys of a model. Errors name file, line, key, value and rule."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from epson_driver.inputs import (
    JOINT_NAMES,
    InputError,
    near_name,
    number,
    printable,
    shown,
    yaml_line,
)
from epson_driver.motion import Array
from epson_driver.robots.catalogue import Layer

MARKS = ('confirmed', 'one source', 'derived', 'estimated')
"""Confidence of a number, best first. confirmed: by EPSON for this model, or by two sources.
derived: computed from confirmed numbers or from a sister model. estimated: a proxy or a guess."""

Range = tuple[float, float, str]
"""Smallest and largest value, and their unit."""


@dataclass(frozen=True)
class Provenance:
    """Source of a quantity.

    `marks`: confidence (see MARKS) of the quantity's number, or of the number of each joint.
    """

    source: str
    marks: tuple[str, ...]

    @property
    def worst(self) -> str:
        return max(self.marks, key=MARKS.index)


class Reader:
    """The keys of one model, checked for type, length and range.

    Later layers override earlier ones.
    """

    def __init__(self, layers: Sequence[Layer]) -> None:
        self._own = layers[-1]
        self._from = {key: layer for layer in layers for key in layer.values}
        self._sources: dict[str, tuple[Layer, Any]] = {}
        for layer in layers:
            if not layer.where and layer is self._own:  # inherited sources are for other values
                for key in layer.values:
                    self._sources.pop(key.partition('_')[0], None)
            for key, source in self._in(layer, 'sources', {}, dict).items():
                self._sources[key] = layer, source

    def error(self, key: str, value: object, rule: str) -> InputError:
        layer = self._from.get(key, self._own)
        return self._error(layer, (key,), f'{key} = {shown(value)}: {rule}')

    def check_keys(self, known: Sequence[str]) -> None:
        for key, layer in self._from.items():
            if key in known:
                continue
            quantity = key.partition('_')[0]
            units = [item for item in known if item.startswith(quantity + '_')]
            near = near_name(key, known)
            hint = f'; did you mean {near}?' if near else f'; known are {", ".join(known)}'
            rule = f'unit missing or wrong: must be {" or ".join(units)}'
            raise self._error(layer, (key,), f'{key}: {rule if units else f"unknown key{hint}"}')

    def check_sources(self, known: Sequence[str]) -> None:
        for key, (layer, _) in self._sources.items():
            if key not in known:
                rule = f'must be one of {", ".join(known)}'
                raise self._error(layer, ('sources', key), f'sources.{key}: {rule}')

    def has(self, key: str) -> bool:
        return key in self._from

    def has_source(self, quantity: str) -> bool:
        return quantity in self._sources

    def get(self, key: str, kind: type, otherwise: Any = None) -> Any:
        """Return the value of a key, or `otherwise`. Raises InputError if both are missing."""
        if key not in self._from:
            if otherwise is not None:
                return otherwise
            raise InputError(f'{printable(self._own.path)}: {key} is missing')
        return self._in(self._from[key], key, None, kind)

    def names(self, key: str, count: int) -> tuple[str, ...]:
        """Return a list of `count` joint names. The default is joint_1 and so on."""
        value = self.get(key, list, [f'joint_{number}' for number in range(1, count + 1)])
        try:
            names: tuple[str, ...] = JOINT_NAMES.checked(value, key)
        except InputError:
            raise self.error(key, value, JOINT_NAMES.text) from None
        if len(names) != count:
            raise self.error(key, value, f'must have {count} names, one per joint')
        return names

    def choices(self, key: str, allowed: tuple[str, ...], count: int) -> tuple[str, ...]:
        """Return one of the allowed values for each joint.

        The default is the first allowed value.
        """
        words = self.get(key, list, [allowed[0]] * count)
        if len(words) != count or not all(word in allowed for word in words):
            rule = f'must be a list of one per joint, each of {", ".join(allowed)}'
            raise self.error(key, words, rule)
        return tuple(words)

    def numbers(
        self,
        key: str,
        count: int,
        range_: Range,
        of: str = 'one per joint',
        *,
        unknown: bool = False,
    ) -> Array:
        """Return `count` numbers within a range. With `unknown`, null is allowed and gives NaN."""
        values = self.get(key, list)
        if len(values) != count:
            raise self.error(key, values, f'must have {count} numbers, {of}')
        return np.array(
            [
                np.nan if unknown and value is None else self._number(key, value, range_)
                for value in values
            ]
        )

    def number(self, key: str, range_: Range) -> float:
        return self._number(key, self.get(key, object), range_)

    def vectors(self, key: str, count: int, range_: Range, each: tuple[str, ...]) -> Array:
        rows = self.get(key, list)
        if len(rows) != count:
            raise self.error(key, rows, f'must have {count} lists, one per joint')
        for row in rows:
            if not isinstance(row, list) or len(row) != len(each):
                raise self.error(key, row, f'must have {len(each)} numbers, {" and ".join(each)}')
            for value in row:
                self._number(key, value, range_)
        return np.array(rows, dtype=float).reshape(count, len(each))

    def provenance(self, quantity: str, count: int = 1) -> Provenance:
        layer, source = self._sources.get(quantity, (self._own, None))
        if source is None:
            return Provenance(f'{printable(self._own.path.name)}, without a source', (MARKS[1],))
        key = f'sources.{quantity}'
        mark, text = source if isinstance(source, list) and len(source) == 2 else ('', '')
        marks: list[str] = mark if isinstance(mark, list) else [mark] * count
        if len(marks) != count or any(item not in MARKS for item in marks):
            more = ' (or a list of one per joint)' if count > 1 else ''
            rule = f'must be [MARK, source], with one of {", ".join(MARKS)}{more}'
            raise self._error(layer, ('sources', quantity), f'{key} = {shown(source)}: {rule}')
        return Provenance(str(text), tuple(marks))

    def _in(self, layer: Layer, key: str, otherwise: Any, kind: type) -> Any:
        value = layer.values.get(key, otherwise)
        if not isinstance(value, kind):
            rule = f'must be a {kind.__name__}'
            raise self._error(layer, (key,), f'{key} = {shown(value)}: {rule}')
        return value

    def _number(self, key: str, value: object, range_: Range) -> float:
        try:
            checked: float = number(*range_).checked(value, key)
        except InputError:
            raise self.error(key, value, number(*range_).text) from None
        return checked

    def _error(self, layer: Layer, keys: tuple[str, ...], text: str) -> InputError:
        line = yaml_line(layer.path, (*layer.where, *keys))
        place = f'{printable(layer.path)}{f", line {line}" if line else ""}'
        return InputError(f'{place}: {text}')
