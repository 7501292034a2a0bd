# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Texts that take a while to make, kept in the user's cache folder under what they are made of."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path


def cached(made_of: Iterable[bytes], make: Callable[[], str]) -> str:
    """Return what `make` makes of these bytes, from the cache if it is there.

    A folder that cannot be read or written, or a file that is damaged, costs time and nothing
    else. Other processes see a file as a whole or not at all.
    """
    key = hashlib.sha256()
    for part in made_of:
        key.update(hashlib.sha256(part).digest())
    folder = _folder()
    path = folder / key.hexdigest()
    with contextlib.suppress(OSError, ValueError):
        digest, _, text = path.read_text('utf-8').partition('\n')
        if digest == _digest(text):
            return text
    text = make()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        number, name = tempfile.mkstemp(dir=folder)
        try:
            os.close(number)
            Path(name).write_text(f'{_digest(text)}\n{text}', 'utf-8')
            Path(name).replace(path)
        except OSError:
            Path(name).unlink(missing_ok=True)
    return text


def _folder() -> Path:
    chosen = Path(os.environ.get('XDG_CACHE_HOME', ''))  # a relative one counts as none
    try:
        home = chosen if chosen.is_absolute() else Path.home() / '.cache'
    except RuntimeError:  # a user without a home
        home = Path(os.devnull)  # nothing can be made in it
    return home / 'epson_driver'


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode('utf-8')).hexdigest()
