# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel in a real browser: Debian's chromium, driven by playwright."""

import contextlib
import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip('websockets')

from support.browser import chromium
from support.cell import Cell
from support.panel_client import SWING_END, PanelProcess
from support.panel_page import Page

from epson_driver.processes.processes import free_ros_domain

pytestmark = pytest.mark.slow  # seconds, in a browser without a graphics card

SIZES = [(1024, 768, False), (1600, 1000, True), (390, 844, False)]
"""Widths and heights of windows, and whether they are dark."""


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    with closing(Cell(tmp_path_factory.mktemp('cell'))) as result:
        yield result.ready()


@pytest.fixture(scope='module')
def panel(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    result = PanelProcess(tmp_path_factory.mktemp('panel'), cell.domain)
    yield result
    assert result.end() == 0


@pytest.fixture(scope='module')
def default_timeouts(
    cell: Cell, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[PanelProcess]:
    """A panel with the time-outs that users get."""
    result = PanelProcess(tmp_path_factory.mktemp('default_timeouts'), cell.domain, patience=False)
    yield result
    assert result.end() == 0


@pytest.fixture(scope='module')
def flat() -> Iterator[Any]:
    """A browser without 3D views."""
    with chromium('--disable-3d-apis') as browser:
        yield browser


@pytest.fixture(scope='module')
def page(panel: PanelProcess) -> Iterator[Page]:
    with chromium() as browser:
        yield Page(browser, panel.address)


# Only one window can be armed: these tests come before the window that stays open.
@pytest.mark.parametrize(('width', 'height', 'dark'), SIZES)
def test_page_works_and_fits_without_webgl(
    width: int, height: int, dark: bool, panel: PanelProcess, flat: Any
) -> None:
    page = Page(flat, panel.address, {'width': width, 'height': height})
    with closing(page.page):
        page.page.emulate_media(color_scheme='dark' if dark else 'light')
        page.wait_for_text_of('#view-note', 'No 3D view: this browser has no WebGL')
        page.lamp('Mode', 'good')
        stop = page.page.locator('#stop').bounding_box()
        assert stop['height'] >= 64
        assert 0 <= stop['y'] <= height - stop['height']
        assert 0 <= stop['x'] <= width - stop['width']
        page.page.mouse.wheel(0, 5000)
        assert page.page.locator('#stop').bounding_box() == stop
        cut = page.page.evaluate(
            """() => [...document.querySelectorAll('main > section, #lamps b, #tool div, button')]
                .filter((each) => each.scrollWidth > each.clientWidth + 1)
                .map((each) => each.outerHTML.slice(0, 100))"""
        )
        assert cut == []
        assert page.page.evaluate('() => document.documentElement.scrollWidth') <= width
        page.wait(lambda: '.' in page.page.locator('.u-value').nth(1).inner_text(), 'a value')
        back = page.page.evaluate('() => getComputedStyle(document.body).backgroundColor')
        assert (sum(map(int, back[4:-1].split(','))) < 200) == dark
        page.armed()
        page.disarmed()


@pytest.mark.invariant(1)
def test_buttons_are_disabled_before_the_window_is_armed(page: Page, cell: Cell) -> None:
    cell.peer.enable()
    for label in ('Enable', 'Reset error', 'Execute', 'Move to its start, slowly'):
        button = page.button(label)
        assert button.is_disabled()
        button.dispatch_event('click')
        button.click(force=True)
    cell.peer.assert_still()


def test_3d_view_follows_the_arm_until_stop(page: Page, cell: Cell) -> None:
    import numpy as np

    page.lamp('Door', 'good')
    page.armed()
    page.button('Enable').click()
    page.wait_for_text('log', '~/enable: the arm is enabled')
    at_rest = page.picture()
    assert len(np.unique(at_rest.reshape(-1, 3), axis=0)) > 100
    assert np.count_nonzero(at_rest.sum(axis=2) < 250) > 200  # the arm's dark parts
    start = cell.peer.position()[0]
    page.button('Execute').click()
    page.lamp('Motion', 'good')
    page.wait(lambda: abs(cell.peer.position()[0] - start) > 0.05, 'motion')
    changed = np.abs(page.picture() - at_rest).sum(axis=2) > 60
    assert np.count_nonzero(changed) > 200
    page.page.keyboard.press('Escape')
    page.wait_for_text('log', 'swing: ')
    cell.peer.assert_still()
    page.disarmed()


@contextlib.contextmanager
def stopped(what: bytes) -> Iterator[None]:
    """Suspend the child browser processes whose command line contains `what`."""
    parents, result = {}, set()
    for item in Path('/proc').iterdir():
        with contextlib.suppress(OSError):
            if item.name.isdigit():
                words = (item / 'stat').read_text(encoding='utf-8').rpartition(') ')[2].split()
                parents[int(item.name)] = int(words[1])
                if what in (item / 'cmdline').read_bytes():
                    result.add(int(item.name))

    def own(process: int) -> bool:
        return process == os.getpid() or (process in parents and own(parents[process]))

    browsers = [process for process in result if own(process)]
    assert browsers
    for process in browsers:
        os.kill(process, signal.SIGSTOP)
    try:
        yield
    finally:
        for process in browsers:
            os.kill(process, signal.SIGCONT)


RENDERER, WHOLE_BROWSER = b'--type=renderer', b'chromium'
"""A frozen page suspends the renderer process, a sleeping computer all processes."""


def start_swing(page: Page, cell: Cell) -> None:
    """Start the swing trajectory and wait for motion."""
    page.armed()
    page.button('Enable').click()
    page.lamp('Enabled', 'good')
    page.button('Move to its start, slowly').click()
    page.wait_for_text('log', 'to the start of swing: ')
    page.button('Execute').click()
    cell.peer.wait_for_motion()


@pytest.mark.invariant(3)
@pytest.mark.parametrize('what', [RENDERER, WHOLE_BROWSER])
def test_frozen_window_stops_the_arm_before_the_end_of_its_motion(
    what: bytes, cell: Cell, panel: PanelProcess, flat: Any
) -> None:
    page = Page(flat, panel.address)
    with closing(page.page):
        page.lamp('Door', 'good')
        start_swing(page, cell)
        with stopped(what):
            end = cell.peer.wait_until_still()
        assert abs(end[0] - SWING_END) > 0.01
        page.wait_for_text('log', 'the armed window is frozen, hidden or disconnected')


@pytest.mark.invariant(3)
def test_undelivered_stop_shows_a_large_red_alarm(
    cell: Cell, default_timeouts: PanelProcess, flat: Any
) -> None:
    read_style = """(id) => {
        const each = document.querySelector(id), is = getComputedStyle(each);
        return [each.innerText, is.color, is.backgroundColor, is.fontSize];
    }"""
    page = Page(flat, default_timeouts.address)
    with closing(page.page):
        before = page.page.locator('#stop').bounding_box()
        for silent, place, why in (
            (cell.client, '#alarm', 'no reply from the driver within 0.5 s'),
            (default_timeouts.process, '#silence span', 'no reply from the panel'),
        ):
            silent.send(signal.SIGSTOP)
            try:
                page.page.keyboard.press('Escape')
                page.page.locator(place, has_text='STOP was not delivered').wait_for()
                text, colour, back, size = page.page.evaluate(read_style, place)
            finally:
                silent.send(signal.SIGCONT)
            assert text == f'STOP was not delivered: {why}. Press the E-stop.'
            assert (colour, back) == ('rgb(255, 255, 255)', 'rgb(179, 22, 14)')
            assert float(size.removesuffix('px')) >= 20
            assert page.page.locator('#stop').bounding_box() == before
            page.page.locator(place, has_text='STOP').wait_for(state='hidden')
            page.lamp('Link', 'good')


@pytest.mark.invariant(3)
def test_stop_without_a_driver_is_reported(tmp_path: Path, flat: Any) -> None:
    panel = PanelProcess(tmp_path, free_ros_domain())
    try:
        page = Page(flat, panel.address, link='')
        with closing(page.page):
            page.wait_for_text('advice', 'no driver found')
            assert page.button('Arm').is_disabled()
            page.page.keyboard.press('Escape')
            page.wait_for_text(
                'alarm', 'STOP was not delivered: no driver found. Press the E-stop.'
            )
    finally:
        panel.end()


@pytest.mark.invariant(6)
def test_page_turns_grey_when_the_panel_is_silent(page: Page, panel: PanelProcess) -> None:
    def shown() -> tuple[set[str], bool]:
        result = page.page.evaluate(
            """() => [[...document.querySelectorAll('.live, #acts')].map(
                          (each) => getComputedStyle(each).filter),
                      document.querySelector('#silence').checkVisibility()]"""
        )
        return set(result[0]), result[1]

    page.wait(lambda: shown() == ({'none'}, False), 'fresh')
    panel.process.send(signal.SIGSTOP)
    try:
        page.wait(lambda: shown() == ({'grayscale(1)'}, True), 'grey')
    finally:
        panel.process.send(signal.SIGCONT)
    page.wait(lambda: shown() == ({'none'}, False), 'fresh again')
    assert 'STOP does not work' not in page.page.locator('body').inner_text()


@pytest.mark.invariant(3)
def test_jog_ends_when_the_button_is_released_or_focus_is_lost(page: Page, cell: Cell) -> None:
    page.armed()
    page.button('Enable').click()
    page.lamp('Enabled', 'good')
    time.sleep(1.5)  # after a stop the driver requires a second without a stream
    start = cell.peer.position()[0]
    page.button('joint_1 plus').scroll_into_view_if_needed()
    where = page.button('joint_1 plus').bounding_box()
    for end in ('mouse up', 'window left'):
        page.page.mouse.move(where['x'] + 20, where['y'] + 20)
        page.page.mouse.down()
        page.wait(lambda start=start: cell.peer.position()[0] > start + 0.01, 'moved')
        if end == 'mouse up':
            page.page.mouse.up()
        else:
            page.page.evaluate('() => window.dispatchEvent(new Event("blur"))')
        cell.peer.wait_until_still()
        cell.peer.assert_still()
        assert page.page.locator('.held').count() == 0
        page.page.mouse.up()
        start = cell.peer.position()[0]
        time.sleep(1.2)


def test_point_is_taught_saved_and_approached(page: Page, cell: Cell) -> None:
    import numpy as np

    cell.peer.enable()
    page.armed()
    page.page.get_by_label('Each press moves').select_option('1')
    page.page.get_by_text('World', exact=True).click()
    page.page.locator('summary', has_text='Points').click()
    there = cell.peer.wait_until_still()
    page.page.get_by_label('Name of the point').fill('home')
    page.button('Teach here').click()
    with page.page.expect_download() as download:
        page.button('Save').click()
    saved = yaml.safe_load(Path(download.value.path()).read_text(encoding='utf-8'))
    assert list(saved) == ['home']
    shown = page.page.locator('#tool dd').all_inner_texts()
    np.testing.assert_allclose(
        list(saved['home'].values()), [float(item) for item in shown], atol=0.06
    )
    assert ''.join(saved['home']) == 'xyzuvw'
    page.button('Z plus').click()
    page.wait(lambda: np.abs(cell.peer.position() - there).max() > 1e-3, 'moved away')
    cell.peer.wait_until_still()
    page.button('Go to home').click()
    page.wait_for_text('log', 'to home: at the goal')
    np.testing.assert_allclose(cell.peer.wait_until_still(), there, atol=2e-3)
    page.button('Forget home').click()
    page.page.locator('#points-file').set_input_files(
        {'name': 'x.yaml', 'mimeType': 'application/yaml', 'buffer': b'pick: {x: 1, y: <b>}'}
    )
    page.wait_for_text_of('#notes', 'x.yaml has no points: pick must have x, y, z')
    assert page.text('points') == ''
    saved_again = b'pick: {x: 350.0, y: 20.0, z: -30.0}\n'
    page.page.locator('#points-file').set_input_files(
        {'name': 'x.yaml', 'mimeType': 'application/yaml', 'buffer': saved_again}
    )
    page.wait_for_text('points', '350.0 20.0 -30.0 0.0 0.0 0.0')


def test_taught_points_of_page_and_driver_have_markers(page: Page, cell: Cell) -> None:
    from epson_msgs.srv import TaughtPoints

    page.armed()
    page.page.evaluate(
        "() => { document.querySelector('#points').closest('details').open = true; }"
    )
    page.page.locator('#points-file').set_input_files(
        {
            'name': 'a.yaml',
            'mimeType': 'application/yaml',
            'buffer': b'mine: {x: 250, y: 0, z: 400}',
        }
    )
    page.wait_for_text('points', 'mine')
    shown = page.page.locator('#scene')
    before = page.picture()
    request = TaughtPoints.Request(action=TaughtPoints.Request.TEACH, name='theirs')
    with cell.peer.client(TaughtPoints, 'epson_driver/taught_points') as client:
        there = cell.peer.wait_until_still()
        assert cell.peer.complete(client.call_async(request)).success
        page.wait_for_text('points', 'theirs')
        assert {'mine', 'theirs'} <= {*shown.get_attribute('data-points').split()}
        page.page.locator('#points li', has_text='mine').hover()
        page.wait(lambda: (page.picture() != before).any(), 'a larger marker')
        page.button('Go to theirs').click()
        page.wait_for_text('log', 'to theirs: ')
        assert cell.peer.wait_until_still() == pytest.approx(there, abs=2e-3)
        request.action = TaughtPoints.Request.FORGET
        assert cell.peer.complete(client.call_async(request)).success
    page.wait(lambda: 'theirs' not in page.text('points'), 'no point of the driver')
    page.button('Forget mine').click()
    assert not {'mine', 'theirs'} & {*shown.get_attribute('data-points').split()}


def test_every_control_has_an_accessible_name(page: Page) -> None:
    unnamed = page.page.evaluate(
        """() => [...document.querySelectorAll('button, input, select')].filter((each) =>
            !each.hidden && !each.ariaLabel && !each.textContent.trim() && !each.labels?.length
        ).map((each) => each.outerHTML)"""
    )
    assert unnamed == []
    for role in (
        '#advice[role=status]',
        '#alarm[role=alert]',
        '#silence[role=alert]',
        'main',
        'h1',
    ):
        assert page.page.locator(role).count() == 1
    assert 'epson_driver' in page.page.title()


def test_page_requests_no_other_host_and_logs_no_errors(page: Page, panel: PanelProcess) -> None:
    own = f'://127.0.0.1:{panel.port}/'
    assert page.requests
    others = [url for url in page.requests if own not in url and not url.startswith('data:')]
    assert others == []
    assert page.errors == []
