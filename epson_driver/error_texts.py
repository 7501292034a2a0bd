# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Meanings and remedies of controller error numbers, read from config/errors/NAME.yaml.

The simulated controller reports these numbers. The driver adds the meanings and remedies.
"""

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from epson_driver.inputs import InputError, count, near_names, printable, read_yaml, shown
from epson_driver.share import share_path

NO_ERROR = 0
NO_TEXTS = 'none'
"""Name of the empty table, for controllers whose error numbers are not listed."""


class ErrorText(NamedTuple):
    """Meaning and remedy of an error number, and their source.

    `confirmed`: whether a document confirms both. `source`: a keyword, explained at the top of the
    file.
    """

    meaning: str
    remedy: str = ''
    confirmed: bool = True
    source: str = ''


class ErrorTexts(dict[int, ErrorText]):
    def phrase(self, number: int) -> str:
        """Return a number with its meaning, for use in a sentence: `4031 (motion attempted …)`.

        An unconfirmed meaning is marked as such. A number without a text is returned without a
        meaning.
        """
        text = self.get(number)
        if text is None or number == NO_ERROR:
            return str(number)
        doubt = '' if text.confirmed else ', not confirmed'
        return f'{number} ({text.meaning}{doubt})'

    def advice(self, number: int, otherwise: str) -> str:
        text = self.get(number)
        return text.remedy if text is not None and text.remedy else otherwise


@cache
def load_error_texts(name: str = 'epson') -> ErrorTexts:
    """Load config/errors/NAME.yaml, or an empty table for 'none'."""
    if name == NO_TEXTS:
        return ErrorTexts()
    known = {path.stem: path for path in share_path('config', 'errors').glob('*.yaml')}
    if name not in known:
        names = near_names(name, [*sorted(known), NO_TEXTS])
        raise InputError(f'no error texts are named {printable(name)}: must be {", ".join(names)}')
    return read_error_texts(known[name])


def read_error_texts(path: Path) -> ErrorTexts:
    data = read_yaml(path)
    file = printable(path)
    rows = data.get('errors') if isinstance(data, dict) else None
    if not isinstance(rows, list):
        raise InputError(f'{file}: errors must be a list')
    texts = ErrorTexts()
    for index, row in enumerate(rows):
        number, text = _row(f'{file}: errors[{index}]', row)
        if number in texts:
            raise InputError(f'{file}: number {number} occurs twice')
        texts[number] = text
    return texts


_KEYS = {'number': int, 'meaning': str, 'remedy': str, 'confirmed': bool, 'source': str}
_NUMBER = count(-(2**31), 2**31 - 1)  # int32 on the wire


def _row(where: str, row: Any) -> tuple[int, ErrorText]:
    if not isinstance(row, dict) or set(row) != set(_KEYS):
        raise InputError(f'{where} = {shown(row)}: must have {", ".join(_KEYS)}')
    for key, kind in _KEYS.items():
        if type(row[key]) is not kind:
            raise InputError(f'{where}.{key} = {shown(row[key])}: must be {kind.__name__}')
    number = _NUMBER.checked(row['number'], f'{where}.number')
    return number, ErrorText(*(row[key] for key in list(_KEYS)[1:]))
