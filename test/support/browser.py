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


class _Playwright:
    """Playwright while a browser is open. A thread can run only one, and no other event loop."""

    def __init__(self) -> None:
        self._users = 0

    def __enter__(self) -> Any:
        if not self._users:
            api = pytest.importorskip('playwright.sync_api', reason='not there: make browser')
            self._context = api.sync_playwright()
            self._api = self._context.__enter__()
        self._users += 1
        return self._api

    def __exit__(self, *_: object) -> None:
        self._users -= 1
        if not self._users:
            self._context.__exit__()


_playwright = _Playwright()


@contextmanager
def chromium(*arguments: str) -> Iterator[Any]:
    """Yield a browser. Skips the test without chromium or playwright."""
    if CHROMIUM is None:
        pytest.skip('no browser test: apt install --no-install-recommends chromium')
    with _playwright as api:
        browser = api.chromium.launch(
            executable_path=CHROMIUM, args=['--no-sandbox', *arguments], timeout=120_000
        )
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def browser_page(
    width: int = 900, height: int = 700
) -> Iterator[tuple[Any, list[str], list[str]]]:
    """Yield a tab, its console messages and errors, and the requested addresses."""
    messages: list[str] = []
    requested: list[str] = []
    with chromium() as browser:
        tab = browser.new_page(viewport={'width': width, 'height': height})
        tab.set_default_timeout(120_000)
        tab.on('console', lambda message: messages.append(f'{message.type}: {message.text}'))
        tab.on('pageerror', lambda error: messages.append(f'error: {error}'))
        tab.on('request', lambda request: requested.append(request.url))
        yield tab, messages, requested
