# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The name that somebody probably meant."""

import re
from collections.abc import Iterable
from difflib import get_close_matches

MIN_LIKENESS = 0.8
"""How much two names must have in common, as difflib counts it: 1 is the same."""


ADDRESS = re.compile('add?ress|host(name)?')
"""Words for what our names call ip."""


def near_name(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is nearest to one, underscores and case aside; None: none is."""
    plain = {_plain(each): each for each in known}
    near = get_close_matches(_plain(name), plain, 1, MIN_LIKENESS)
    return plain[near[0]] if near else None


def _plain(name: str) -> str:
    return ADDRESS.sub('ip', name.replace('_', '').replace('-', '').lower())
