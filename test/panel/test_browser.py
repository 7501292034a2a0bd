# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel in a real browser: Debian's chromium, driven by playwright."""

import contextlib
import importlib.util
import io
import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('viser')

from support.cell import Cell
from support.panel_client import PanelProcess
from support.ros_peer import PATIENCE

from epson_driver.panel.panel import STOP

CHROMIUM = shutil.which('chromium') or shutil.which('google-chrome')

pytestmark = [
    pytest.mark.slow,  # seconds, in a browser without a graphics card
    pytest.mark.skipif(
        CHROMIUM is None,
        reason='there is no browser: apt install --no-install-recommends chromium',
    ),
    pytest.mark.skipif(
        importlib.util.find_spec('playwright') is None,
        reason='playwright is not installed: make browser',
    ),
]

VIEW = {'width': 1180, 'height': 420}
"""Small: without a graphics card every pixel is computed."""

MILLISECONDS = PATIENCE * 1e3


class Page:
    """A page of the panel, and everything that it asked for and complained about."""

    def __init__(self, browser: Any, address: str) -> None:
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page = browser.new_page(viewport=VIEW)
        self.page.set_default_timeout(MILLISECONDS)
        self.page.on('request', lambda request: self.requests.append(request.url))
        self.page.on('websocket', lambda socket: self.requests.append(socket.url))
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))
        self.page.on('console', self._on_console)
        self.page.goto(address)
        try:
            self.lamp('Link', 'good')
        except Exception as error:
            shown = self.page.locator('body').inner_text()
            error.add_note(f'asked for {self.requests}, complained {self.errors}, shows {shown!r}')
            raise

    def _on_console(self, message: Any) -> None:
        if message.type == 'error':
            self.errors.append(message.text)

    def lamp(self, name: str, colour: str) -> None:
        """Wait until a lamp has a colour."""
        self.page.wait_for_selector(f'[data-lamp="{name}"][data-colour="{colour}"]')

    def button(self, label: str) -> Any:
        return self.page.get_by_role('button', name=label, exact=True)

    def text(self, part: str) -> str:
        found: str = self.page.locator(f'[data-part={part}]').first.inner_text()
        return found

    def wait(self, true: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + PATIENCE
        while not true():
            assert time.monotonic() < until, f'not: {what}'
            self.page.wait_for_timeout(100)

    def wait_for_text(self, part: str, text: str) -> None:
        self.wait(lambda: text in self.text(part), f'{text!r} in {part}: {self.text(part)}')

    def picture(self) -> Any:
        """Return the 3D view as an array of pixels."""
        import numpy as np
        from PIL import Image

        taken = self.page.locator('canvas').first.screenshot(timeout=MILLISECONDS)
        return np.asarray(Image.open(io.BytesIO(taken)).convert('RGB')).astype(int)


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    found = Cell(tmp_path_factory.mktemp('cell'))
    try:
        yield found.ready()
    finally:
        found.close()


@pytest.fixture(scope='module')
def panel(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    found = PanelProcess(Path(tmp_path_factory.mktemp('panel')), cell.domain)
    yield found
    assert found.end() == 0


@pytest.fixture(scope='module')
def page(panel: PanelProcess) -> Iterator[Page]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=['--no-sandbox'], timeout=MILLISECONDS
        )
        yield Page(browser, panel.address)
        browser.close()


@pytest.mark.invariant(1)
def test_nothing_can_be_pressed_before_it_is_armed(page: Page, cell: Cell) -> None:
    cell.peer.enable()
    for label in ('Enable', 'Reset error', 'Execute', 'Go to its start, slowly'):
        button = page.button(label)
        assert button.is_disabled()
        button.dispatch_event('click')
        button.click(force=True)
    cell.peer.assert_still()


def test_the_view_is_not_empty_and_follows_the_arm_until_stop(page: Page, cell: Cell) -> None:
    import numpy as np

    page.lamp('Door', 'good')
    page.button('Arm').click()
    page.wait(lambda: not page.button('Enable').is_disabled(), 'armed')
    page.button('Enable').click()
    page.wait_for_text('log', '~/enable: the arm is enabled')
    at_rest = page.picture()
    assert len(np.unique(at_rest.reshape(-1, 3), axis=0)) > 100
    assert np.count_nonzero(at_rest.sum(axis=2) < 250) > 200  # the arm's dark parts
    page.button('Execute').click()
    cell.peer.wait_for_motion()
    page.lamp('Motion', 'good')
    began = cell.peer.position()[0]
    page.wait(lambda: abs(cell.peer.position()[0] - began) > 0.05, 'a part of the way')
    changed = np.abs(page.picture() - at_rest).sum(axis=2) > 60
    assert np.count_nonzero(changed) > 200
    assert page.button(STOP).bounding_box()['height'] >= 64
    page.page.keyboard.press('Escape')
    page.wait_for_text('log', 'swing: ')
    cell.peer.assert_still()
    page.button('Disarm').click()


def renderers() -> list[int]:
    """Return the processes that draw the pages of browsers on this machine."""
    found = []
    for each in Path('/proc').iterdir():
        with contextlib.suppress(OSError):
            if each.name.isdigit() and b'--type=renderer' in (each / 'cmdline').read_bytes():
                found.append(int(each.name))
    return found


@pytest.mark.invariant(3)
def test_an_armed_page_whose_process_is_stopped_is_disarmed_and_its_goal_canceled(
    page: Page, cell: Cell
) -> None:
    page.button('Arm').click()
    page.wait(lambda: not page.button('Execute').is_disabled(), 'armed')
    page.button('Go to its start, slowly').click()
    page.wait_for_text('log', 'to the start of swing: ')
    page.button('Execute').click()
    cell.peer.wait_for_motion()
    stopped = renderers()
    for each in stopped:
        os.kill(each, signal.SIGSTOP)
    try:
        cell.peer.wait_until_still()
    finally:
        for each in stopped:
            os.kill(each, signal.SIGCONT)
    page.wait_for_text('log', 'the armed window is frozen, hidden or cut off')


@pytest.mark.invariant(6)
def test_an_estop_is_seen_with_its_reason_and_what_to_do(page: Page) -> None:
    page.button('press').click()
    page.lamp('E-stop', 'bad')
    page.wait_for_text('advice', 'release the E-stop')
    page.button('release').click()
    page.wait_for_text('log', 'pendant: E-stop release')
    page.button('reset').click()
    page.lamp('E-stop', 'good')


@pytest.mark.invariant(6)
def test_a_page_whose_panel_is_silent_turns_grey_and_says_so(
    page: Page, panel: PanelProcess
) -> None:
    def shown() -> tuple[str, bool]:
        found = page.page.evaluate(
            """() => [getComputedStyle(document.querySelector('.ed-live')).filter,
                      getComputedStyle(document.querySelector('.ed-gone')).visibility
                          === 'visible']"""
        )
        return found[0], found[1]

    page.wait(lambda: shown() == ('none', False), 'fresh')
    panel.process.send(signal.SIGSTOP)
    try:
        page.wait(lambda: 'grayscale' in shown()[0] and shown()[1], 'grey')
    finally:
        panel.process.send(signal.SIGCONT)
    page.wait(lambda: shown() == ('none', False), 'fresh again')


def test_it_asked_nobody_else_and_complained_about_nothing(
    page: Page, panel: PanelProcess
) -> None:
    own = f'://127.0.0.1:{panel.port}/'
    assert page.requests
    others = [url for url in page.requests if own not in url and not url.startswith('data:')]
    assert others == []
    assert page.errors == []
