# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A real browser for tests of pages: Debian's chromium, driven by playwright."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = (
    shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which('google-chrome')
)


@contextmanager
def browser_page(
    width: int = 900, height: int = 700
) -> Iterator[tuple[Any, list[str], list[str]]]:
    """Yield a tab, what its console and its errors say, and the addresses it asks for.

    Skips the test where there is no browser or no playwright.
    """
    api = pytest.importorskip(
        'playwright.sync_api', reason='no browser test: pip install playwright'
    )
    if CHROMIUM is None:
        pytest.skip('no browser test: chromium is not installed (apt-get install chromium)')
    told: list[str] = []
    requested: list[str] = []
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=['--no-sandbox'], timeout=120_000
        )
        try:
            tab = browser.new_page(viewport={'width': width, 'height': height})
            tab.set_default_timeout(120_000)
            tab.on('console', lambda message: told.append(f'{message.type}: {message.text}'))
            tab.on('pageerror', lambda error: told.append(f'error: {error}'))
            tab.on('request', lambda request: requested.append(request.url))
            yield tab, told, requested
        finally:
            browser.close()
