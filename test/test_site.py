# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`make docs` builds every page with valid links and without requests to other hosts."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
from support.browser import browser_page

ROOT = Path(__file__).parents[1]
SITE = ROOT / 'build' / 'site'
FETCHING = {
    'script': 'src',
    'img': 'src',
    'link': 'href',
    'iframe': 'src',
    'source': 'src',
    'video': 'src',
    'audio': 'src',
    'object': 'data',
    'embed': 'src',
}
"""Elements whose target a browser fetches automatically."""

NOT_FETCHED = {'canonical', 'next', 'prev'}
"""Relations of links that browsers do not fetch."""


class Page(HTMLParser):
    """The fetched files, the links and the anchors of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.links: list[str] = []
        self.places: set[str] = set()
        self.classes: set[str] = set()
        self.feed(file.read_text(encoding='utf-8'))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or '' for name, value in attrs}
        self.classes |= set(given.get('class', '').split())
        self.places |= {given[name] for name in ('id', 'name') if name in given}
        if tag in FETCHING and not NOT_FETCHED & set(given.get('rel', '').split()):
            self.fetched += [given[FETCHING[tag]]] if FETCHING[tag] in given else []
        if tag == 'a' and 'href' in given:
            self.links.append(given['href'])


@pytest.fixture(scope='module')
def pages() -> dict[Path, Page]:
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
    return {file: Page(file) for file in SITE.rglob('*.html')}


@pytest.mark.slow
def test_links_within_the_site_are_valid(pages: dict[Path, Page]) -> None:
    wrong = []
    for file, page in pages.items():
        for link in page.links:
            if re.match(r'[a-z]+:', link) or file.name == '404.html':
                continue
            target, _, place = unquote(link).partition('#')
            there = (file.parent / target).resolve() if target else file
            there = there / 'index.html' if there.is_dir() else there
            known = pages[there].places if there in pages else {place}
            if not there.is_file() or (place and place not in known):
                wrong.append((file.relative_to(SITE).as_posix(), link))
    assert not wrong


@pytest.mark.slow
def test_pages_fetch_nothing_from_other_hosts(pages: dict[Path, Page]) -> None:
    """This includes fonts, scripts, pictures, and mermaid's script on pages with diagrams."""
    for file, page in pages.items():
        assert not [item for item in page.fetched if re.match(r'(https?:)?//', item)], file
        assert 'mermaid' not in page.classes, file
        assert 'data-md-component="source"' not in file.read_text(encoding='utf-8'), file
    for sheet in SITE.rglob('*.css'):
        fetched = re.findall(
            r'(?:url\(|@import)\s*["\']?((?:https?:)?//[^)"\']+)', sheet.read_text()
        )
        assert not fetched, sheet


@pytest.mark.slow
@pytest.mark.usefixtures('pages')
def test_search_works_without_a_server() -> None:
    with browser_page() as (tab, messages, requested):
        tab.goto((SITE / 'docs' / 'safety.html').as_uri())
        tab.keyboard.press('/')
        tab.get_by_placeholder('Search').last.fill('virtual time')
        tab.get_by_role('option').filter(has_text='Architecture').first.wait_for()
        assert not [line for line in messages if 'error' in line]
        assert not [address for address in requested if not address.startswith('file:')]
