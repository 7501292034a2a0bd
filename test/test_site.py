# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`make docs` builds every page with valid links and without requests to other hosts."""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest
from support.browser import browser_page

ROOT = Path(__file__).parents[1]
SITE = ROOT / 'build' / 'site'
FETCHED = re.compile(r'<(?:script|img|link|iframe|source|video|audio|object|embed)\b[^>]*>')
"""Elements whose target a browser fetches automatically."""

NOT_FETCHED = re.compile(r'rel="?(?:canonical|next|prev)')
"""Relations of links that browsers do not fetch."""


@pytest.fixture(scope='module')
def pages():
    """Build the site. Return its pages by file."""
    pytest.importorskip('zensical', reason='make docs installs it, and make test-all')
    run = subprocess.run(
        [sys.executable, ROOT / 'docs' / 'make_site.py'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return {file: file.read_text(encoding='utf-8') for file in SITE.rglob('*.html')}


@pytest.mark.slow
def test_links_within_the_site_are_valid(pages):
    places = {
        file: set(re.findall(r'\b(?:id|name)="?([^"> ]+)', text)) for file, text in pages.items()
    }
    wrong = []
    for file, text in pages.items():
        for link in re.findall(r'<a\b[^>]*\bhref="?([^"> ]+)', text):
            if re.match(r'[a-z]+:', link) or file.name == '404.html':
                continue
            target, _, place = unquote(link).partition('#')
            there = (file.parent / target).resolve() if target else file
            there = there / 'index.html' if there.is_dir() else there
            if not there.is_file() or (place and place not in places.get(there, {place})):
                wrong.append((file.relative_to(SITE).as_posix(), link))
    assert not wrong


@pytest.mark.slow
def test_pages_fetch_nothing_from_other_hosts(pages):
    """This includes fonts, scripts, pictures, and mermaid's script on pages with diagrams."""
    for file, text in pages.items():
        fetched = [item for item in FETCHED.findall(text) if not NOT_FETCHED.search(item)]
        other = r'\b(?:src|href|data)="?(?:https?:)?//'
        assert not [item for item in fetched if re.search(other, item)], file
        assert not re.search(r'class="?[^">]*\bmermaid\b', text), file
        assert 'data-md-component="source"' not in text, file
    for sheet in SITE.rglob('*.css'):
        other = r'(?:url\(|@import)\s*["\']?(?:https?:)?//'
        assert not re.search(other, sheet.read_text()), sheet


@pytest.mark.slow
@pytest.mark.usefixtures('pages')
def test_search_works_without_a_server():
    with browser_page() as (tab, messages, requested):
        tab.goto((SITE / 'docs' / 'safety.html').as_uri())
        tab.keyboard.press('/')
        tab.get_by_placeholder('Search').last.fill('virtual time')
        tab.get_by_role('option').filter(has_text='Architecture').first.wait_for()
        assert not [line for line in messages if 'error' in line]
        assert not [address for address in requested if not address.startswith('file:')]
