# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel in a browser, with a simulated controller that has no program loaded (`remote`)."""

import re
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

pytest.importorskip('websockets')

from support.browser import chromium
from support.cell import Cell
from support.panel_client import PanelProcess
from support.panel_page import Page

pytestmark = pytest.mark.slow

SIZE = {'width': 1280, 'height': 900}


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    folder = tmp_path_factory.mktemp('cell')
    with closing(
        Cell(folder, '--controller=remote', controller='remote', require_planned_speed=True)
    ) as result:
        yield result.ready()


@pytest.fixture(scope='module')
def page(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    panel = PanelProcess(tmp_path_factory.mktemp('panel'), cell.domain)
    with chromium() as browser:
        yield Page(browser, panel.address, SIZE)
    assert panel.end() == 0


def test_step_and_move_to_a_point_or_to_the_start_are_one_motion_each(
    page: Page, cell: Cell
) -> None:
    page.armed()
    page.button('Enable').click()
    page.lamp('Enabled', 'good')
    start = cell.peer.wait_until_still()
    page.page.locator('summary', has_text='Points').click()
    page.page.get_by_label('Name of the point').fill('here')
    page.button('Teach here').click()
    page.page.get_by_label('Each press moves').select_option('5')
    page.button('joint_2 plus').click()
    page.wait_for_text('log', 'step of 2: ')
    moved = np.degrees(cell.peer.wait_until_still() - start)
    np.testing.assert_allclose(moved, [0, 5, 0, 0, 0, 0], atol=0.05)
    page.page.get_by_label('Each press moves').select_option('1')
    page.button('joint_2 minus').click()  # slower than the controller can move by its plan
    page.wait(lambda: abs(cell.peer.position()[1] - start[1] - np.radians(4)) < 1e-3, '1° back')
    page.page.get_by_label('Each press moves').select_option('5')
    page.page.get_by_label('Each press moves').select_option('10')
    page.page.get_by_text('World', exact=True).click()
    height = page.page.locator('#tool dd').nth(2)
    before = float(height.inner_text())
    page.button('Z plus').click()
    page.wait(lambda: abs(float(height.inner_text()) - before - 10.0) < 0.15, '10 mm higher')
    page.button('Go to here').click()
    page.wait_for_text('log', 'to here: ')
    np.testing.assert_allclose(cell.peer.wait_until_still(), start, atol=2e-3)
    page.button('Move to its start, slowly').click()
    page.wait_for_text('log', 'to the start of swing: ')
    assert page.page.locator('body.armed').count() == 1
    assert 'panel disarmed' not in page.text('log')


def test_unsupported_actions_are_disabled_with_the_reason(page: Page) -> None:
    page.armed()
    assert page.button('Execute').is_disabled()
    page.wait_for_text_of('#no-plans', 'the controller accepts no points and times')
    assert page.page.locator('#speed').is_disabled()
    held = page.page.locator('#step option').first
    assert held.inner_text() == 'while held'
    assert held.is_disabled()
    page.wait_for_text_of('#no-streams', 'the arm follows no streams')
    page.page.locator('summary', has_text='Simulated pendant').click()
    assert page.page.locator('[data-press="Motors on"]').is_disabled()
    page.wait_for_text_of('#no-login', 'needs a Remote Ethernet login')


@pytest.mark.invariant(1)
def test_server_refuses_a_request_that_the_page_should_have_disabled(
    page: Page, cell: Cell
) -> None:
    page.armed()
    page.page.evaluate("""() => {
        for (const each of document.querySelectorAll('#execute')) each.disabled = false;
    }""")
    page.button('Execute').click()
    page.wait_for_text_of('#notes', 'the controller accepts no points and times')
    cell.peer.assert_still()


def test_estop_of_the_simulated_controller_is_pressed_and_reset(page: Page) -> None:
    page.armed()
    page.page.locator('[data-press="E-stop press"]').click()
    page.lamp('E-stop', 'bad')
    page.disarmed()
    page.wait_for_text('advice', 'release the E-stop, then press Arm, then Reset error')
    page.armed()
    page.page.locator('[data-press="E-stop release"]').click()
    page.armed()
    page.button('Reset error').click()
    page.lamp('E-stop', 'good')
    page.button('Enable').click()
    page.lamp('Enabled', 'good')
    page.disarmed()


def test_panel_connects_once_and_never_logs_in(page: Page, cell: Cell) -> None:
    page.lamp('Door', 'good')
    log = cell.controller.log.read_text(encoding='utf-8')
    assert 'only one may be logged in' not in log
    assert len(re.findall('remote client .* connected', log)) == 2, log  # driver and panel
