# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The page of the panel in a real browser, for tests."""

import io
import time
from collections.abc import Callable
from typing import Any

from support.ros_peer import PATIENCE

VIEW = {'width': 1100, 'height': 420}
"""Small: without a graphics card every pixel is computed."""

MILLISECONDS = PATIENCE * 1e3


class Page:
    """A page of the panel, with its requests and errors."""

    def __init__(
        self, browser: Any, address: str, size: dict[str, int] = VIEW, link: str = 'good'
    ) -> None:
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page = browser.new_page(viewport=size)
        self.page.set_default_timeout(MILLISECONDS)
        self.page.on('request', lambda request: self.requests.append(request.url))
        self.page.on('websocket', lambda socket: self.requests.append(socket.url))
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))
        self.page.on('console', self._on_console)
        self.page.goto(address)
        try:
            if link:
                self.lamp('Link', link)
        except Exception as error:
            shown = self.page.locator('body').inner_text()
            error.add_note(f'requests {self.requests}, errors {self.errors}, text {shown!r}')
            raise

    def _on_console(self, message: Any) -> None:
        if message.type == 'error':
            self.errors.append(message.text)

    def lamp(self, name: str, colour: str) -> None:
        """Wait until a lamp has a colour."""
        self.page.wait_for_selector(f'[data-lamp="{name}"][data-colour="{colour}"]')

    def button(self, label: str) -> Any:
        return self.page.get_by_role('button', name=label, exact=True)

    def armed(self) -> None:
        """Arm the window, if it is not armed."""
        if self.button('Arm').is_visible():
            self.button('Arm').click()
        self.page.wait_for_selector('body.armed')

    def disarmed(self) -> None:
        """Disarm the window."""
        self.button('Disarm').click()
        self.page.wait_for_selector('body:not(.armed)')

    def text(self, part: str) -> str:
        result: str = self.page.locator(f'[data-part={part}]').first.inner_text()
        return result

    def wait(self, true: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + PATIENCE
        while not true():
            assert time.monotonic() < until, f'not: {what}'
            self.page.wait_for_timeout(100)

    def wait_for_text_of(self, place: str, text: str) -> None:
        result = self.page.locator(place)
        self.wait(lambda: text in result.inner_text(), f'{text!r} in {place}')

    def wait_for_text(self, part: str, text: str) -> None:
        self.wait(lambda: text in self.text(part), f'{text!r} in {part}: {self.text(part)}')

    def picture(self) -> Any:
        """Return the 3D view as an array of pixels."""
        import numpy as np
        from PIL import Image

        taken = self.page.locator('canvas').first.screenshot(timeout=MILLISECONDS)
        return np.asarray(Image.open(io.BytesIO(taken)).convert('RGB')).astype(int)
