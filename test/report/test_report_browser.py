# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: it moves the arm, without errors and network requests."""

import io

import numpy as np
import pytest
from support.browser import browser_page
from support.recorded_run import usual_run

from epson_driver.error_texts import load_error_texts
from epson_driver.report.figures import figures
from epson_driver.report.page import page
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import load_robot_model

MODEL = load_robot_model('c3_a601s')
pytestmark = pytest.mark.slow  # ten seconds and more in a browser without a graphics card

HARMLESS = 'GPU stall due to ReadPixels'
"""A warning of Chromium about screenshots of WebGL without a graphics card."""


@pytest.fixture(scope='module')
def pages(tmp_path_factory):
    """Return two files: the report of one run and the comparison of two runs."""
    folder = tmp_path_factory.mktemp('pages')
    runs = []
    for name, options in (('a', {}), ('b', {'estop': 2.0})):
        path = usual_run(**options).write(folder / f'{name}.pcap')
        runs.append(read_trace(path, MODEL.limits, load_error_texts()))
    one, both = folder / 'one.html', folder / 'both.html'
    one.write_text(page([(runs[1], figures(runs[1]))], MODEL), encoding='utf-8')
    both.write_text(page([(run, figures(run)) for run in runs], MODEL), encoding='utf-8')
    return one, both


def colours(tab):
    """Return the picture of the arm."""
    from PIL import Image

    picture = Image.open(io.BytesIO(tab.locator('#scene').screenshot(timeout=120_000)))
    return np.asarray(picture.convert('RGB')).astype(int)


def move_slider(tab, time):
    tab.locator('#time').evaluate(
        '(e, v) => { e.value = v; e.dispatchEvent(new Event("input", {bubbles: true})); }',
        str(time),
    )
    tab.wait_for_timeout(300)


def test_slider_moves_the_arm_without_network_requests(pages):
    with browser_page() as (tab, messages, requested):
        tab.goto(f'file://{pages[0]}')
        tab.wait_for_selector('body[data-ready=yes]', timeout=120_000)
        move_slider(tab, 1.0)
        first = tab.locator('#joints tr:nth-child(2) td:nth-child(2)').inner_text()
        before = colours(tab)
        assert len(np.unique(before.reshape(-1, 3), axis=0)) > 100
        move_slider(tab, 2.0)
        assert tab.locator('#joints tr:nth-child(2) td:nth-child(2)').inner_text() != first
        changed = (np.abs(colours(tab) - before).max(axis=2) > 30).sum()
        assert changed > 500, 'the arm in the picture did not move'
        assert tab.locator('[data-lamp="E-stop"] b').inner_text() == 'released'
        move_slider(tab, 3.5)
        assert tab.locator('[data-lamp="E-stop"] b').inner_text() == 'pressed'
        assert '→' in tab.locator('#advice').inner_text()
        assert tab.locator('.plot canvas').count() == 6
        assert [text for text in messages if HARMLESS not in text] == []
        assert requested == [f'file://{pages[0]}']


COLOURS_BETWEEN_FRAMES = """() => {
    const from = document.querySelector('#scene'), to = document.createElement('canvas');
    [to.width, to.height] = [from.width, from.height];
    const drawn = to.getContext('2d', { willReadFrequently: true });
    drawn.drawImage(from, 0, 0);
    const { data } = drawn.getImageData(0, 0, to.width, to.height);
    return new Set(new Uint32Array(data.buffer)).size;
}"""
"""Counts the colours of the picture between two frames, as a printer takes it."""


def test_page_fits_a_phone_and_paper(pages):
    with browser_page(width=390, height=844) as (tab, _, _):
        tab.goto(f'file://{pages[1]}')
        tab.wait_for_selector('body[data-ready=yes]', timeout=120_000)
        assert tab.evaluate('() => document.documentElement.scrollWidth') == 390
        beyond = """() => [...document.querySelectorAll('td, th, .card *')]
            .filter((each) => each.getBoundingClientRect().right > innerWidth)
            .map((each) => each.outerHTML.slice(0, 100))"""
        assert tab.evaluate(beyond) == []
        paper = '() => getComputedStyle(document.querySelector(".card")).backgroundColor'
        light = tab.evaluate(paper)
        tab.emulate_media(color_scheme='dark')
        assert tab.evaluate(paper) != light
        tab.emulate_media(color_scheme='light')
        tab.wait_for_timeout(1000)
        assert tab.evaluate(COLOURS_BETWEEN_FRAMES) > 100
        width = '() => document.querySelector(".uplot").clientWidth'
        on_phone = tab.evaluate(width)
        tab.evaluate('() => dispatchEvent(new Event("beforeprint"))')
        assert 600 < tab.evaluate(width) < 700
        tab.evaluate('() => dispatchEvent(new Event("afterprint"))')
        assert tab.evaluate(width) == on_phone


def test_page_with_two_runs_can_be_opened_twice(pages):
    with browser_page() as (tab, messages, requested):
        for _ in range(2):
            tab.goto(f'file://{pages[1]}')
            tab.wait_for_selector('body[data-ready=yes]', timeout=120_000)
        assert tab.locator('.lamp').count() == 14
        tab.locator('#play').click()
        tab.wait_for_timeout(500)
        tab.locator('#play').click()
        assert tab.locator('#clock').inner_text().endswith(' s')
        assert [text for text in messages if HARMLESS not in text] == []
        assert {item.partition('#')[0] for item in requested} == {f'file://{pages[1]}'}
