# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""No argument of an executable ends in a traceback: 2 and a sentence, 1 for a bad file."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

PLAN = str(Path(__file__).parents[2] / 'config' / 'trajectories' / 'around_pillar_11_points.yaml')
PROGRAM = str(Path(__file__).parents[2] / 'controller_program')
DIGITS = '9' * 400
TOO_LONG = '9' * 5000  # more than Python reads

HOSTS = ('', ' ', 'a..b', '.', 'x' * 64, 'a\nb', 'a\0b', '\udc80', '999.1.1.1', '1.2.3.4.5', 'a b')
NUMBERS = (DIGITS, TOO_LONG, 'nan', '-inf', '-1e300', '', 'x', '1_0', '٣', '0x10')
FILES = (
    '',
    '/tmp',
    '/dev/zero',
    '/nowhere/x.yaml',
    '[/red]x.yaml',
    'a\nb.yaml',
    'a\0b.yaml',
    'x' * 300,
    'x' * 300 + '.yaml',
    '\udc80.yaml',
)

TABLE = (
    ('pendant', HOSTS, '--host={}', 'status'),
    ('pendant', NUMBERS, '--port={}', 'status'),
    ('pendant', NUMBERS, '--timeout={}', 'status'),
    ('pendant', NUMBERS, 'io', 'out', '{}', 'x'),
    ('pendant', ('nan', 'inf', 'x', TOO_LONG[:30] + 'x'), 'disturb', '1', '{}'),
    ('sim_controller', HOSTS, '--host={}'),
    ('sim_controller', NUMBERS, '--motion-port={}'),
    ('sim_controller', NUMBERS, '--state-period={}'),
    ('sim_controller', NUMBERS, '--look-ahead={}'),
    ('sim_controller', NUMBERS, '--seed={}'),
    ('sim_controller', NUMBERS, '--fault={}'),
    ('sim_controller', NUMBERS, '--start={}'),
    ('sim_controller', (DIGITS, TOO_LONG, 'nan', '-inf', '', 'x'), '--start={},0,0,0,0,0'),
    ('sim_controller', FILES, '--robot={}'),
    ('sim_controller', FILES, '--controller={}'),
    ('replay', FILES, '{}'),
    ('replay', HOSTS, '--host={}', PLAN),
    ('replay', NUMBERS, '--state-port={}', PLAN),
    ('replay', NUMBERS, '--speed={}', PLAN),
    ('smooth', FILES, '{}'),
    ('smooth', FILES, PLAN, '--robot={}'),
    ('smooth', NUMBERS, PLAN, '--rate={}'),
    ('smooth', (*NUMBERS, '1e-300', '0'), PLAN, '--look-ahead={}'),
    ('smooth', NUMBERS, PLAN, '--path-tolerance={}'),
    ('smooth', ('x.foo', '/tmp', '', '\udc80'), PLAN, '--picture={}'),
    ('robots', FILES[1:], '{}'),  # without a name it lists all
    ('spel', FILES, 'check', '{}'),
    ('spel', FILES, 'test', '{}'),
    ('spel', NUMBERS, 'check', PLAN, '--version={}'),
    ('spel', FILES, 'run', '{}'),
    ('spel', FILES, 'run', '--fast', PROGRAM, '--robot={}'),
    ('spel', FILES, 'run', '--fast', PROGRAM, '--controller={}'),
    ('spel', NUMBERS, 'run', '--fast', PROGRAM, '--seconds={}'),
    ('spel', NUMBERS, 'run', PROGRAM, '--remote-port={}'),
    ('spel', (*NUMBERS, '=1', 'NOWHERE=1'), 'run', '--fast', PROGRAM, '--define={}'),
    ('demo', FILES, '--trajectory={}'),
    ('demo', (*NUMBERS, '0'), '--seed={}'),
    ('demo', (*NUMBERS, '0'), '--seeds={}'),
    ('demo', ('x.foo', '/tmp', ''), '--picture={}'),
)
BAD_FILE = {'demo': 1}
"""What ends with 1 for a bad file; the others end with 2, as their pages say."""


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    ('name', 'values', 'words'),
    [(name, values, words) for name, values, *words in TABLE],
    ids=[f'{name} {" ".join(words)[-30:]}' for name, _, *words in TABLE],
)
def test_inv7_whatever_an_argument_is_it_is_refused_in_a_sentence(
    name: str,
    values: tuple[str, ...],
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    main = import_module(f'epson_driver.cli.{name}').main
    for value in values:
        monkeypatch.setattr(sys, 'argv', [name, *(word.replace('{}', value) for word in words)])
        try:
            code = main()
        except SystemExit as end:
            code = end.code
        said = capsys.readouterr()
        sentence = ' '.join((said.out + said.err).split())
        assert code in (2, BAD_FILE.get(name, 2)), (value[:50], sentence)
        assert 'error: ' in sentence or 'demo failed: ' in sentence
        assert len(sentence) < 3000
    assert not list(tmp_path.iterdir())


@pytest.mark.invariant(7)
@pytest.mark.parametrize('name', ['client', 'jog', 'panel'])
@pytest.mark.parametrize('words', [('-r', 'no remapping'), ('-p', 'x'), ('-p', ':=3')])
def test_inv7_whatever_a_ros_argument_is_it_is_refused_in_a_sentence(
    name: str,
    words: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if name == 'panel':
        pytest.importorskip('viser')
    monkeypatch.setattr(sys, 'argv', [name, '--ros-args', *words])
    assert import_module(f'epson_driver.cli.{name}').main() == 1
    said = capsys.readouterr().err
    assert said.startswith(f'epson_driver {name}: ')
    assert 'Failed to parse ROS arguments' in said
    assert words[1] in said
