# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""spel.yaml: its keys, its errors, and what overrides it."""

from pathlib import Path

import pytest

from epson_driver.inputs import InputError
from epson_driver.spel import NetSettings, Settings, read_settings
from epson_driver.spel.lint import check

EVERY_KEY = """robot: ls3_b401s
controller: rc700a
ports:
  201: 192.168.0.1:2000
  202: :2001:cr
stubs:
  VRun:
  VGet find.Geom01.RobotXYU: [[1, 250.0], [0, 0]]
tools:
  1: [0, 0, 50, 0]
locals:
  2: [100, 0, 0, 0, 0, 180]
setup: HomeSet 0, 0, 0, 0
"""


def written(folder: Path, text: str) -> Path:
    (folder / 'spel.yaml').write_text(text)
    return folder


def test_every_key_is_read(tmp_path: Path) -> None:
    settings = read_settings(written(tmp_path, EVERY_KEY))
    assert (settings.robot, settings.controller) == ('ls3_b401s', 'rc700a')
    assert settings.ports == {
        201: NetSettings('192.168.0.1', 2000),
        202: NetSettings('', 2001, '\r'),
    }
    assert settings.stubs == {'VRun': [None], 'VGet find.Geom01.RobotXYU': [[1, 250.0], [0, 0]]}
    assert settings.statements == (
        'TLSet 1, XY(0, 0, 50, 0); Local 2, XY(100, 0, 0, 0, 0, 180); HomeSet 0, 0, 0, 0'
    )


@pytest.mark.parametrize('text', [None, '', '# nothing\n'])
def test_missing_or_empty_file_has_the_defaults(tmp_path: Path, text: str | None) -> None:
    folder = tmp_path if text is None else written(tmp_path, text)
    settings = read_settings(folder)
    assert (settings.robot, settings.ports, settings.statements) == (None, {}, '')


def test_overrides_replace_single_items(tmp_path: Path) -> None:
    words = ['ports.201=:3000', 'tools.3=[1, 2, 3, 4]', 'robot=t3_401s']
    settings = read_settings(written(tmp_path, EVERY_KEY), words)
    assert settings.robot == 't3_401s'
    assert settings.ports == {201: NetSettings('', 3000), 202: NetSettings('', 2001, '\r')}
    assert sorted(settings.tools) == [1, 3]


def test_model_file_is_found_beside_the_project(tmp_path: Path) -> None:
    settings = read_settings(written(tmp_path, 'robot: arm.yaml\n'), [])
    assert settings.robot == str(tmp_path / 'arm.yaml')


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('- 1\n', 'must have lines KEY: VALUE'),
        ('port:\n  201: a:1\n', 'line 1: port: must be one of .*: did you mean ports'),
        (
            'ports: a:1\n',
            "line 1: ports = 'a:1': must have lines ITEM: VALUE, where each item must be from 201",
        ),
        ('ports:\n  200: a:1\n', "line 2: ports.200: '200' must be from 201 to 216"),
        ('ports:\n  x: a:1\n', "line 2: ports.x: 'x' must be from 201 to 216"),
        ('ports:\n  201: a:70000\n', "line 2: ports.201 = 'a:70000': must be ADDRESS:PORT"),
        ('ports:\n  201: 2000\n', 'line 2: ports.201 = 2000: must be ADDRESS:PORT'),
        ('stubs:\n  VRunn: 1\n', "line 2: stubs.VRunn: 'VRunn' must be a word of SPEL"),
        ('stubs:\n  "": 1\n', "'' must be a word of SPEL"),
        ('stubs:\n  VRun: {a: 1}\n', 'stubs.VRun = .*: must be a value, or a list'),
        ('tools:\n  1: [1, 2]\n', r'line 2: tools.1 = \[1, 2\]: must be \[X, Y, Z, U\]'),
        ('tools:\n  1: [1, 2, 3, true]\n', r'must be \[X, Y, Z, U\]'),
        ('locals:\n  0: [1, 2, 3, 4]\n', "locals.0: '0' must be from 1 to 15"),
        ('setup: "a\\nb"\n', 'line 1: setup = .*: must be one line of statements'),
        ('robot: 5\n', 'line 1: robot = 5: must be a robot model'),
    ],
)
def test_invalid_settings_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_settings(written(tmp_path, text))


@pytest.mark.parametrize(
    ('word', 'message'),
    [
        ('ports.201', "--set ports.201 = ''|--set ports.201 = None"),
        ('robot.x=5', '--set robot.x: robot has no items'),
        ('tools.1=[1, 2', '--set tools.1 = .*: not YAML'),
        ('speed=5', '--set speed: must be one of robot, controller'),
    ],
)
def test_invalid_overrides_are_refused(tmp_path: Path, word: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_settings(tmp_path, [word])


NEEDS = """Function main
  VRun find
  OpenNet #201 As Server
  SetNet #202, "", 2000
  OpenNet #202 As Server
Fend
"""


def test_check_names_the_missing_lines_of_spel_yaml() -> None:
    problems = check({'main.prg': NEEDS}, settings=Settings())
    assert [(problem.position.line, problem.text.split(': ', 1)[1]) for problem in problems] == [
        (2, 'to run it, add `VRun: RESULT` under `stubs:` in spel.yaml'),
        (3, 'to run it, add `201: ADDRESS:PORT` under `ports:` in spel.yaml'),
    ]
    settings = Settings(ports={201: NetSettings('', 2001)}, stubs={'vrun find': [None]})
    assert check({'main.prg': NEEDS}, settings=settings) == []
