# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The instructions of docs/new_robot.md work."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from epson_driver.processes import processes
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.model import OTHER_KEYS, _keys

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs' / 'new_robot.md').read_text(encoding='utf-8')
BLOCKS = re.findall(r'```(\w+)\n(.*?)```', PAGE, re.DOTALL)


def test_page_explains_every_key_of_a_model_file() -> None:
    keys = {*OTHER_KEYS, *_keys(('revolute',)).values()}
    assert keys - {'name', 'like'} <= set(re.findall(r'`([a-z_0-9]+)[:`]', PAGE))


def test_model_file_of_the_page_works_in_sim_controller(tmp_path: Path) -> None:
    (mine,) = (text for language, text in BLOCKS if language == 'yaml')
    path = str(tmp_path / 'my_arm.yaml')
    Path(path).write_text(mine, 'utf-8')
    lines = [line.split('#')[0].split() for _, block in BLOCKS for line in block.splitlines()]
    assert ['epson_driver', 'robots', './my_arm.yaml'] in lines
    shown = subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'robots', path],
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stdout.startswith('# my_arm: ')

    assert ['epson_driver', 'sim_controller', '--robot', './my_arm.yaml'] in lines
    controller = processes.sim_controller(tmp_path / 'controller.log', '--robot', path)
    try:
        assert controller.ports().motion > 0
    finally:
        controller.end()


def test_python_example_of_the_page_runs() -> None:
    (example,) = (text for language, text in BLOCKS if language == 'python')
    names: dict[str, object] = {}
    exec(example, names)
    np.testing.assert_allclose(np.asarray(names['xyz']) * 1e3, [0.0, 526.777, 431.777], atol=1e-3)


@pytest.mark.parametrize('command', [text for kind, text in BLOCKS if kind == 'sh'])
def test_options_of_the_page_exist(command: str) -> None:
    for line in command.splitlines():
        words = shlex.split(line, comments=True)
        if words[:2] == ['epson_driver', 'sim_controller']:
            assert words[2] == '--robot'
        if words[:1] == ['make']:
            assert f'\n{words[1]}:' in (ROOT / 'Makefile').read_text(encoding='utf-8')


def test_all_models_have_plausible_units() -> None:
    """A limit in degrees instead of rad would be far from that of any EPSON arm."""
    for name in robot_models():
        limits = load_robot_model(name).limits
        revolute = np.array(limits.units) == 'rad'
        assert np.all(np.abs(limits.position_max[revolute]) <= 4 * np.pi)
        assert np.all(np.abs(limits.position_min[~revolute]) <= 0.5)
        assert np.all(limits.velocity[~revolute] <= 3.0)
        assert np.all(limits.velocity[revolute] <= 65.0)
