# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Stub answers, ports without SetNet, files, and connected ports of one program."""

from itertools import product
from pathlib import Path

import pytest
from support.examples import one_in
from support.spel_harness import on_controller

from epson_driver.sim_controller.spel_run import TestResult
from epson_driver.spel import ProgramEnvironment
from epson_driver.spel.files import Answer, Files


def run(body: str, around: ProgramEnvironment | None = None, more: str = '') -> TestResult:
    """Run a main with these statements."""
    return on_controller(f'Function main\n{body}\nFend\n{more}', around)


def lines(result: TestResult) -> list[str]:
    assert result.error == ''
    return result.printed.splitlines()


VISION = """
  Boolean found
  Real x, y, u
  Integer i
  For i = 1 To 3
    VRun find
    VGet find.Geom01.RobotXYU(i), found, x, y, u
    Print i, found, x, y, u, Cnv_QueLen(1)
  Next
  VGet find.Geom01.Found, found
  Print found
  P1 = Cnv_QueGet(1) +X(1)
  Print CX(P1), SF_GetParam$(3)
  Wait Cnv_QueLen(1, 2) = 0, 0.1
  Print TW
"""


def test_stub_answers_are_used_in_order_and_the_last_repeats() -> None:
    stubs: dict[str, list[Answer]] = {
        'VRun': [None],
        'vget find.geom01.robotxyu': [[1, 250.0, 40.5, 90], [0, 1, 2, 3]],
        'VGet': [1],
        'Cnv_QueLen': [2, 1, 0],
        'Cnv_QueGet': [[5, 6, 7]],
        'SF_GetParam$': ['name'],
    }
    result = run(VISION, ProgramEnvironment(stubs))
    assert lines(result) == [
        '1 -1 250 40.5 90 2', '2 0 1 2 3 1', '3 0 1 2 3 0', '-1', '6 name', '0'
    ]  # fmt: skip


WRITES = """
  AOpen "data.csv" As #30
  Print #30, 5
  Close #30
  WOpen "new\\\\b.txt" As #30
  Print #30, "b"
  Close #30
  String first$, last$
  ROpen "DATA.csv" As #30
  Input #30, first$
  Input #30, last$
  Print first$, last$, FileExists("new/b.txt")
  Del "old.txt"
  Print FileExists("old.txt")
"""


@pytest.mark.parametrize('keep', [True, False])
def test_files_are_written_to_the_folder_only_with_keep(tmp_path: Path, keep: bool) -> None:
    (tmp_path / 'Data.csv').write_bytes(b'1\r\n')
    (tmp_path / 'old.txt').write_bytes(b'')
    (tmp_path / 'new').mkdir()
    result = run(WRITES.replace('\\\\', '\\'), ProgramEnvironment(files=Files(tmp_path, keep)))
    assert lines(result) == ['1 5 -1', '0']
    assert (tmp_path / 'Data.csv').read_bytes() == (b'1\r\n5\r\n' if keep else b'1\r\n')
    assert (tmp_path / 'new/b.txt').exists() is keep
    assert (tmp_path / 'old.txt').exists() is not keep


POINTS = """
  P1 = XY(1, 2, 3, 4)
  SavePoints "Robot1.pts"
  ClearPoints
  LoadPoints "robot1.pts"
  SavePoints "new.pts"
  SavePoints "robot1.pts"
  Print PDef(1)
  Del "old.pts"
  Print FileExists("old.pts")
"""


def test_taught_points_are_not_overwritten(tmp_path: Path) -> None:
    for name in ('robot1.pts', 'old.pts'):
        (tmp_path / name).write_text('taught')
    result = run(POINTS, ProgramEnvironment(files=Files(tmp_path, keep=True)))
    assert lines(result) == ['-1', '0']
    assert {item.name for item in tmp_path.iterdir()} == {'robot1.pts', 'old.pts', 'new.pts'}
    assert (tmp_path / 'robot1.pts').read_text() == (tmp_path / 'old.pts').read_text() == 'taught'


SOURCES = ['main.prg', 'x.inc', 'p.sprj', 'IOLabels.dat']


SPELLED = ('{}', '{}/.', './{}', './/{}//./', 'sub/../{}', '{}\\', '{}\\.', '/{}', 'C:{}')


@pytest.mark.parametrize(
    'statement',
    one_in(
        3,
        [
            'WOpen "{0}" As #30',
            'AOpen "{0}" As #30',
            'Del "{0}"',
            'Copy "other.txt", "{0}"',
            'SavePoints "{0}"',
        ],
    ),
)
def test_program_cannot_change_its_sources(tmp_path: Path, statement: str) -> None:
    sources = dict.fromkeys(SOURCES, b'source')
    for element, content in (sources | {'other.txt': b'other'}).items():
        (tmp_path / element).write_bytes(content)
    for name, spelled in product(SOURCES, SPELLED):
        for case in (name, name.upper()):
            text = statement.format(spelled.format(case))
            (tmp_path / 'sub').mkdir(exist_ok=True)
            run(f'  {text}\n', ProgramEnvironment(files=Files(tmp_path, keep=True)))
            assert {source: (tmp_path / source).read_bytes() for source in SOURCES} == sources, (
                text
            )
    assert {item.name for item in tmp_path.iterdir()} <= {*SOURCES, 'other.txt', 'sub', 'new.txt'}


@pytest.mark.parametrize(
    'name', ['../a.txt', 'C:\\\\a.txt', '/a.txt', 'main.prg', 'IOLabels.dat', 'link/a.txt']
)
def test_program_cannot_write_outside_its_folder(tmp_path: Path, name: str) -> None:
    project, elsewhere = tmp_path / 'project', tmp_path / 'elsewhere'
    project.mkdir()
    elsewhere.mkdir()
    (project / 'link').symlink_to(elsewhere)
    result = run(f'  WOpen "{name}" As #30\n', ProgramEnvironment(files=Files(project, keep=True)))
    assert result.error.startswith('error 9993: ')
    assert {item.name for item in tmp_path.rglob('*')} == {'project', 'elsewhere', 'link'}


def test_file_size_is_limited() -> None:
    body = '  WOpen "a" As #30\n  Do\n    Print #30, Space$(255)\n  Loop\n'
    assert run(body).error.startswith(('error 2556: ', 'error 9993: '))
