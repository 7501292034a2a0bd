# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the docs say is what the code is."""

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WIDTH = 120
HIDDEN = {'.venv', 'build', 'install', 'node_modules'}
PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/*.md')])


@pytest.mark.parametrize('page', ['state_machines.md', 'controller.md'])
def test_state_machine_diagrams_are_those_of_the_code(page: str) -> None:
    generated = runpy.run_path(str(ROOT / 'docs' / 'make_diagrams.py'))['PAGES'][page]()
    written = (ROOT / 'docs' / page).read_text(encoding='utf-8')
    assert written == generated, 'run `python docs/make_diagrams.py`'
    assert 'stateDiagram-v2' in written


def test_the_api_reference_is_that_of_the_docstrings() -> None:
    made = runpy.run_path(str(ROOT / 'docs' / 'make_api.py'))
    written = made['PAGE'].read_text(encoding='utf-8')
    assert written == made['page'](), 'run `python docs/make_api.py`'
    assert '### Robot.move_joints' in written


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    targets = re.findall(r'\]\((?!https?:)([^)#:]+)[^)]*\)', page.read_text(encoding='utf-8'))
    for target in targets:
        assert (page.parent / target).exists(), f'{page.name} links to {target}'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_anchors_lead_to_a_heading(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    for target, anchor in re.findall(r'\]\((?!https?:)([^)#:]*)#([^)]+)\)', text):
        there = (page.parent / target if target else page).read_text(encoding='utf-8')
        headings = re.findall(r'(?m)^#+ (.*)$', there)
        anchors = {re.sub(r'[^\w\- ]', '', each.lower()).replace(' ', '-') for each in headings}
        assert anchor in anchors, f'{page.name} links to {target}#{anchor}'


def test_files_named_in_the_docs_exist() -> None:
    for page in PAGES:
        for name in re.findall(r'`((?:\w+/)+\w*\.py|test/[\w/]+)`', page.read_text('utf-8')):
            found = (ROOT / name).exists() or (ROOT / 'epson_driver' / name).exists()
            assert found, f'{page.name} names {name}'


def test_release_tools_read_the_changelog(tmp_path: Path) -> None:
    """What catkin_prepare_release does: it gives the forthcoming changes a version and a date."""
    changelog = pytest.importorskip('catkin_pkg.changelog')
    release = pytest.importorskip('catkin_pkg.package_version')
    copy = shutil.copy(ROOT / 'CHANGELOG.rst', tmp_path)
    read = changelog.get_changelog_from_path(copy, 'epson_driver')
    label = release.get_forthcoming_label(read.rst)
    assert label == 'Forthcoming'
    release.update_changelog_sections({'epson_driver': (copy, read, label)}, '7.8.9')
    versions = list(changelog.get_changelog_from_path(copy, 'epson_driver').foreach_version())
    assert next(content for version, _, content in versions if version == '7.8.9')


def tracked_pages() -> list[Path]:
    """Return every Markdown file of the repository."""
    listed = subprocess.run(
        ['git', 'ls-files', '--cached', '--others', '--exclude-standard', '*.md'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:  # unpacked, not cloned
        return [page for page in ROOT.rglob('*.md') if not HIDDEN & {*page.parts}]
    return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).exists()]


@pytest.mark.parametrize('page', tracked_pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_no_line_is_wider_than_120_columns(page: Path) -> None:
    lines = page.read_text(encoding='utf-8').splitlines()
    wide = [number for number, line in enumerate(lines, 1) if len(line) > WIDTH]
    assert not wide, f'{page}: lines {wide}'


def test_the_pages_that_matter_are_among_the_tracked_ones() -> None:
    found = {page.relative_to(ROOT).as_posix() for page in tracked_pages()}
    assert {'README.md', 'docs/README.md', 'benchmark/results/motion.md'} <= found


def test_the_index_has_every_page() -> None:
    index = (ROOT / 'docs' / 'README.md').read_text(encoding='utf-8')
    for page in ROOT.glob('docs/*.md'):
        assert page.name == 'README.md' or f']({page.name})' in index, page.name


def test_the_index_has_every_executable() -> None:
    from epson_driver.cli.executables import EXECUTABLES

    text = (ROOT / 'docs' / 'README.md').read_text(encoding='utf-8')
    for name in EXECUTABLES:
        assert f'`{name}`' in text, f'docs/README.md does not mention {name}'


def test_the_readme_is_read_to_the_end() -> None:
    """About 120 lines; what one must know before a robot moves is in the first of them."""
    lines = (ROOT / 'README.md').read_text(encoding='utf-8').splitlines()
    assert len(lines) <= 135
    assert 'not run on a real robot yet' in ' '.join(lines[:25]).lower()


def test_every_picture_is_shown_and_the_animation_is_small() -> None:
    text = ''.join(page.read_text(encoding='utf-8') for page in PAGES)
    for picture in ROOT.glob('docs/images/*'):
        assert f'images/{picture.name})' in text, f'nobody shows {picture.name}'
    assert (ROOT / 'docs' / 'images' / 'drive.webp').stat().st_size <= 1_500_000
