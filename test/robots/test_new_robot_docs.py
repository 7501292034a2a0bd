# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/new_robot.md: its table is that of the models, and what it says to do works."""

import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from epson_driver.cli import processes
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.share import share_file

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs' / 'new_robot.md').read_text(encoding='utf-8')
BLOCKS = re.findall(r'```(\w+)\n(.*?)```', PAGE, re.DOTALL)


def test_the_table_is_that_of_the_models() -> None:
    make = runpy.run_path(str(ROOT / 'docs' / 'make_tables.py'))
    assert make['page']('new_robot.md') == PAGE, 'run `python docs/make_tables.py`'
    rows = re.findall(r'^\| \[(\w+)\]\(.*?\) \|(.*)\|$', PAGE, re.MULTILINE)
    assert [name for name, _ in rows] == list(robot_models())
    low = {name for name, row in rows if '**low**' in row}
    assert 'vt6_a901s' in low
    assert 'gx4_c251s' not in low


def test_every_key_of_a_model_file_is_explained() -> None:
    data = yaml.safe_load(share_file('config', 'robots', 'gx4_c251s.yaml').read_text('utf-8'))
    explained = set(re.findall(r'`([a-z_0-9]+)`', PAGE))
    assert set(data) - {'limits', 'chain'} <= explained
    for part in ('limits.position', '.acceleration', 'chain.origins', 'chain.axes'):
        assert f'`{part}`' in PAGE


def test_the_commands_lead_to_a_controller_of_ones_own_robot(tmp_path: Path) -> None:
    lines = [line.split('#')[0].split() for _, block in BLOCKS for line in block.splitlines()]
    (copy,) = (line for line in lines if line[:1] == ['cp'])
    mine = tmp_path / Path(copy[2]).name
    shutil.copy(ROOT / copy[1], mine)
    text = mine.read_text(encoding='utf-8')
    mine.write_text(text.replace(f'name: {Path(copy[1]).stem}', f'name: {mine.stem}'), 'utf-8')

    assert ['epson_driver', 'robots', mine.stem] in lines
    shown = subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'robots', str(mine)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stdout.startswith(f'# {mine.stem}: ')

    assert ['epson_driver', 'sim_controller', '--robot', mine.stem] in lines
    controller = processes.sim_controller(tmp_path / 'controller.log', '--robot', str(mine))
    try:
        assert controller.ports().motion > 0
    finally:
        controller.end()


def test_what_the_page_shows_in_python_runs() -> None:
    (example,) = (text for language, text in BLOCKS if language == 'python')
    names: dict[str, object] = {}
    exec(example, names)
    np.testing.assert_allclose(np.asarray(names['xyz']) * 1e3, [0.0, 526.777, 431.777], atol=1e-3)


@pytest.mark.parametrize('command', [text for kind, text in BLOCKS if kind == 'sh'])
def test_options_on_the_page_exist(command: str) -> None:
    for line in command.splitlines():
        words = shlex.split(line, comments=True)
        if words[:2] == ['epson_driver', 'sim_controller']:
            assert words[2] == '--robot'
        if words[:1] == ['make']:
            assert f'\n{words[1]}:' in (ROOT / 'Makefile').read_text(encoding='utf-8')


def test_the_models_of_the_page_have_no_wrong_units() -> None:
    """A limit in degrees by mistake would be far from what any EPSON arm does."""
    for name in robot_models():
        limits = load_robot_model(name).limits
        revolute = np.array(limits.units) == 'rad'
        assert np.all(np.abs(limits.position_max[revolute]) <= 4 * np.pi)
        assert np.all(np.abs(limits.position_min[~revolute]) <= 0.5)
        assert np.all(limits.velocity[~revolute] <= 3.0)
        assert np.all(limits.velocity[revolute] <= 65.0)
