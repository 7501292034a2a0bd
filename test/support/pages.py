# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Pages of the docs as tests read them."""

import re

CONTINUED = re.compile(r'\n +(?![*\-|`] |\d+\. |```)(?=\S)')


def unwrapped(text: str) -> str:
    """Return a page with each item of its lists on one line."""
    return CONTINUED.sub(' ', text)


def items(text: str) -> list[tuple[str, list[str]]]:
    """Return the items of a list, each with its sub-items."""
    result: list[tuple[str, list[str]]] = []
    for line in unwrapped(text).splitlines():
        if line.startswith('* '):
            result.append((line.removeprefix('* '), []))
        elif line.startswith('  * '):
            result[-1][1].append(line.removeprefix('  * '))
    return result
