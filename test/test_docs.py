# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the docs say is what the code is."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/*.md')])


@pytest.mark.parametrize('page', ['state_machines.md', 'controller.md'])
def test_state_machine_diagrams_are_those_of_the_code(page: str) -> None:
    generated = runpy.run_path(str(ROOT / 'docs' / 'make_diagrams.py'))['PAGES'][page]()
    written = (ROOT / 'docs' / page).read_text(encoding='utf-8')
    assert written == generated, 'run `python docs/make_diagrams.py`'
    assert 'stateDiagram-v2' in written


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    targets = re.findall(r'\]\((?!https?:)([^)#:]+)[^)]*\)', page.read_text(encoding='utf-8'))
    for target in targets:
        assert (page.parent / target).exists(), f'{page.name} links to {target}'


def test_files_named_in_the_docs_exist() -> None:
    for page in (ROOT / 'docs' / 'architecture.md', ROOT / 'docs' / 'invariants.md'):
        for name in re.findall(r'`((?:\w+/)+\w*\.py|test/[\w/]+)`', page.read_text('utf-8')):
            found = (ROOT / name).exists() or (ROOT / 'epson_driver' / name).exists()
            assert found, f'{page.name} names {name}'


def test_readme_names_every_parameter_and_executable() -> None:
    from epson_driver.cli.executables import EXECUTABLES
    from epson_driver.node.parameters import TABLE

    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    for name in [*EXECUTABLES, *(row.name for row in TABLE)]:
        assert f'`{name}`' in text, f'README.md does not mention {name}'
