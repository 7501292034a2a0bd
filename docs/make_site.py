# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Build all pages of the repository as a site that needs no network: `make docs`.

The pages keep their relative paths, so that links between them stay valid. Linked files (profiles,
robot models, the licence) get a generated page, and folders a list of their files. Two whole
pages are generated from code and data. No page sends requests to other hosts: fonts are local, and
diagrams are rendered here. The site, including its search, works from files without a server.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import make_api
import make_tables
import mmdr

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / 'build'
SOURCE = BUILD / 'site_source'
SITE = BUILD / 'site'
CONFIGURATION = BUILD / 'zensical.toml'

INDEX = 'docs/README.md'
WORKER = 'iframe-worker.js'
PAGES = ('*.md', 'docs/*.md', 'examples/*.md', 'benchmark/*.md', 'variants/*/*.md')
MADE_PAGES: dict[str, Callable[[], Iterable[str]]] = {
    'docs/python_api.md': make_api.page,
    'docs/licences.md': make_tables.licences,
}
PICTURES = ('.png', '.webp', '.svg')

LINK = re.compile(r'(!?\[[^\]]*\])\((?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?\)')
DIAGRAM = re.compile(r'(?ms)^```mermaid\n(.*?)^```\n')
SECTION = re.compile(r'(?m)^## (.*)$')
NESTED = re.compile(r'(?m)^ {2,3}(?=\* )')

LANGUAGES = {'.yaml': 'yaml', '.yml': 'yaml', '.rst': 'rst', '.py': 'python', '.xml': 'xml'}


def main() -> int:
    """Build the site. Return the exit code of the builder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--source-only', action='store_true', help='only write the source folder')
    arguments = parser.parse_args()
    write_source()
    if arguments.source_only:
        return 0
    shutil.rmtree(SITE, ignore_errors=True)
    zensical = [sys.executable, '-m', 'zensical', 'build', '--strict', '--config-file']
    built = subprocess.run([*zensical, CONFIGURATION], cwd=BUILD, check=False)  # noqa: S603 - our own words
    if built.returncode == 0:
        print(f'the site is in {SITE.relative_to(ROOT)}: open index.html there')
    return built.returncode


def write_source() -> None:
    """Write the pages and the configuration that the site is built from."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    texts = {
        page: page.read_text('utf-8') for pattern in PAGES for page in sorted(ROOT.glob(pattern))
    }
    texts |= {ROOT / name: ''.join(made()) for name, made in MADE_PAGES.items()}
    wanted: set[Path] = set()
    for page, text in texts.items():
        wanted |= set(_targets(page, text))
        nested = NESTED.sub(' ' * 4, text)  # the builder takes fewer for the same list
        _write(page, _drawn(page, _linked(page, nested)))
    for target in sorted(wanted - set(texts)):
        if target.suffix in PICTURES:
            copy = SOURCE / target.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(target, copy)
        elif target.is_dir():
            _write(target / 'index.md', _folder(target))
        else:
            _write(target.with_name(target.name + '.md'), _file(target))
    _write(ROOT / WORKER, (ROOT / 'docs' / WORKER).read_text(encoding='utf-8'))
    CONFIGURATION.write_text(configuration(), encoding='utf-8')


def configuration() -> str:
    """Return zensical.toml."""
    sections = ''.join(
        f'  {{ {json.dumps(title)} = {json.dumps(pages)} }},\n' for title, pages in navigation()
    )
    return f"""\
[project]
site_name = "epson_driver"
site_description = "ROS 2 driver for EPSON and other simple-message robot controllers"
docs_dir = "{SOURCE.name}"
site_dir = "{SITE.name}"
use_directory_urls = false
nav = [
  {{ "epson_driver" = "README.md" }},
  {{ "Documentation" = "{INDEX}" }},
{sections}  {{ "Made from code and data" = {json.dumps(list(MADE_PAGES))} }},
]

[project.theme]
font = false
features = ["navigation.indexes", "content.code.copy"]

[[project.extra.polyfills]]
path = "{WORKER}"
type = "text/javascript"
async = false
defer = false

[project.plugins.search]

[project.plugins.offline]
"""


def navigation() -> Iterator[tuple[str, list[str]]]:
    """Yield the title and the pages of each list of the index."""
    text = (ROOT / INDEX).read_text(encoding='utf-8')
    parts = SECTION.split(text)
    for title, body in zip(parts[1::2], parts[2::2], strict=True):
        pages = []
        for _, target, _ in LINK.findall(body):
            place = (ROOT / INDEX).parent / target
            name = place.resolve().relative_to(ROOT).as_posix()
            pages.append(name if place.suffix == '.md' else f'{name}.md')
        if pages and title.startswith('You '):
            yield title, list(dict.fromkeys(pages))


def _targets(page: Path, text: str) -> Iterator[Path]:
    for _, target, _ in LINK.findall(text):
        yield (page.parent / target).resolve()


def _linked(page: Path, text: str) -> str:
    """Return a page whose links to files and folders point to their generated pages."""

    def link(found: re.Match[str]) -> str:
        shown, target = found[1], found[2]
        anchor = re.sub('-+', '-', found[3] or '').removesuffix('-')  # as the builder makes them
        place = page.parent / target
        if place.is_dir():
            target = f'{target.rstrip("/")}/index.md'
        elif place.suffix not in ('.md', *PICTURES):
            target = f'{target}.md'
        return f'{shown}({target}{anchor})'

    return LINK.sub(link, text)


def _drawn(page: Path, text: str) -> str:
    """Return a page with rendered diagrams."""
    count = 0

    def draw(found: re.Match[str]) -> str:
        nonlocal count
        count += 1
        picture = page.with_name(f'{page.stem}_{count}.svg')
        drawn: str = mmdr.render(found[1]).svg()
        width = re.findall(r'viewBox="\S+ \S+ (\S+) \S+"', drawn)[0]
        _write(picture, drawn.replace('width="100%"', f'width="{width}"', 1))  # its own size
        return f'![Diagram {count}]({picture.name})\n'

    return DIAGRAM.sub(draw, text)


def _folder(folder: Path) -> str:
    names = sorted(item.name + '/' * item.is_dir() for item in folder.iterdir())
    return f'# {folder.relative_to(ROOT)}\n\n' + ''.join(f'* `{name}`\n' for name in names)


def _file(file: Path) -> str:
    text = file.read_text(encoding='utf-8').rstrip('\n')
    language = LANGUAGES.get(file.suffix, 'text')
    return f'# {file.relative_to(ROOT)}\n\n````{language}\n{text}\n````\n'


def _write(place: Path, text: str) -> None:
    target = SOURCE / place.relative_to(ROOT)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    sys.exit(main())
