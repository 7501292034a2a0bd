# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""editor/projects.py: new names, and which files belong to a project."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from epson_driver.editor.projects import Project, Projects, RenameError
from epson_driver.inputs.rc_files import Block, header_fault, sealed
from epson_driver.spel.project_data import points_of
from epson_driver.spel.values import Point

WHEN = datetime(2026, 1, 2, tzinfo=UTC)
MAIN = """\
Function main
  String text$
  Go pick
  On Gripper
  Help text$
Fend
Function Help(text$ As String)
  Print text$
Fend
"""


def written(folder: Path) -> Path:
    """Write a project with a point and an I/O label, the latter's text in Shift-JIS."""
    (folder / 'main.prg').write_text(MAIN)
    point = Point('xy', (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), ('r',))
    text = points_of({3: point}, {3: 'pick'}, WHEN)
    (folder / 'robot1.pts').write_bytes(text.encode())
    about = 'グリッパー'.encode('shift_jis').decode('latin-1')
    label = Block(
        'Label1', [('nBit', '9'), ('sLabel', '"Gripper"'), ('sDescription', f'"{about}"')]
    )
    text = sealed(Block('', [Block('OutputBitLabels', [label])]), WHEN)
    (folder / 'IOLabels.dat').write_bytes(text.encode('latin-1'))
    return folder


def test_a_point_and_an_io_label_change_in_all_files_with_their_headers(tmp_path: Path) -> None:
    project = Project(written(tmp_path))
    for old, new in (('pick', 'grasp'), ('Gripper', 'Vacuum')):
        (symbol,) = project.symbols.names[old.lower()]
        for name, edits in project.renamed(symbol, new).items():
            path = tmp_path / name
            encoding = 'shift_jis' if name == 'IOLabels.dat' else 'ascii'
            lines = path.read_bytes().decode(encoding).split('\n')
            for place, text in reversed(edits):
                line = lines[place.line]
                lines[place.line] = line[: place.start] + text + line[place.end :]
            path.write_bytes('\n'.join(lines).encode(encoding))
    assert 'Go grasp\n  On Vacuum' in (tmp_path / 'main.prg').read_text()
    for name in ('robot1.pts', 'IOLabels.dat'):
        assert header_fault((tmp_path / name).read_bytes()) == ''
    _, problems = Project(tmp_path).problems(None)
    assert not any(problems.values())


@pytest.mark.parametrize(
    ('old', 'new', 'text'),
    [
        ('pick', 'Go', 'Go is a reserved word of SPEL'),
        ('pick', 'P7', 'starts with a letter'),
        ('pick', 'a b', 'starts with a letter'),
        ('pick', 'help', 'help is another function already: main.prg:7'),
        ('pick', 'a23456789012345678', 'a point has at most 16 characters'),
        ('Help', 'help2$', 'only names of strings end in'),
        ('Help', 'text', ''),
        ('main', 'first', 'the controller starts main by its name'),
        ('Help', 'Main2', 'the controller starts Main2 by its name'),
        ('Help', 'bgMain', 'the controller starts bgMain by its name'),
        ('P3', 'pick2', 'is the number of a point'),
    ],
)
def test_rename_to_an_invalid_name_is_refused(tmp_path: Path, old, new, text) -> None:
    project = Project(written(tmp_path))
    symbol = project.symbols.names[old.lower()][0]
    if text:
        with pytest.raises(RenameError, match=text):
            project.renamed(symbol, new)
    else:
        assert [len(edits) for edits in project.renamed(symbol, new).values()] == [2]


def test_files_outside_of_the_workspace_belong_to_no_project(tmp_path: Path) -> None:
    inside, outside = tmp_path / 'a', tmp_path / 'ab'
    inside.mkdir()
    outside.mkdir()
    (inside / 'link').symlink_to(written(outside))
    projects = Projects([inside])
    assert projects.of(outside / 'main.prg') is None
    assert projects.of(inside / 'link' / 'main.prg') is None
    assert projects.of(inside / '..' / 'ab' / 'main.prg') is None
    (inside / 'main.prg').symlink_to(outside / 'main.prg')
    (inside / 'own.prg').write_text('Function own\nFend\n')
    project = projects.of(inside / 'own.prg')
    assert project is not None
    assert list(project.texts) == ['own.prg']


def test_program_that_no_project_lists_is_a_separate_project(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text('Function main\nFend\n')
    (tmp_path / 'old.prg').write_text('Function main\nFend\n')
    program = Block('ProgramFile1', [('sName', '"main.prg"')])
    text = sealed(Block('', [('nProgramFileCount', '1'), program]), WHEN)
    (tmp_path / 'a.sprj').write_bytes(text.encode())
    projects = Projects([tmp_path])
    main, old = (projects.of(tmp_path / name) for name in ('main.prg', 'old.prg'))
    assert main is not None
    assert old is not None
    assert 'old.prg' not in main.texts
    assert 'main.prg' not in old.texts


def test_text_open_in_the_editor_replaces_the_file_until_closed(tmp_path: Path) -> None:
    project = Project(written(tmp_path))
    project.set('main.prg', 'Function other\nFend\n')
    assert [item.name for item in project.symbols.files['main.prg'].symbols] == ['other']
    project.read()
    assert project.texts['main.prg'] == 'Function other\nFend\n'
    project.close('main.prg')
    assert project.texts['main.prg'] == MAIN
    (tmp_path / 'main.prg').unlink()
    project.read()
    assert project.texts == {}


def test_problems_are_those_of_a_new_project_after_each_change(tmp_path: Path) -> None:
    """Files that have not changed are not parsed again."""
    project = Project(written(tmp_path))
    texts = (
        MAIN.replace('Help text$\n', 'Help text$ Go\n'),
        '#define LAST 3\n' + MAIN.replace('Go pick', 'Go gone\n  Assist 1\n  If LAST'),
        MAIN,
    )
    other = 'Function Assist(n As Integer)\n  Go pick :Z(n\nFend\n'
    for text, more in zip(texts, (other, other, other.replace('(n\n', '(n)\n')), strict=True):
        project.set('main.prg', text)
        project.set('other.prg', more)
        again = project.problems(8)[1]
        new = Project(tmp_path)
        new.set('main.prg', text)
        new.set('other.prg', more)
        assert again == new.problems(8)[1]
    parsed = dict(project._parsed)
    project.set('main.prg', MAIN + "' end\n")
    project.problems(8)
    assert project._parsed['other.prg'] is parsed['other.prg']


def test_spel_yaml_beside_the_project_has_the_version(tmp_path: Path) -> None:
    (tmp_path / 'main.prg').write_text('Function main\n  UByte b\n  b = 200\n  Print b\nFend\n')
    project = Project(tmp_path)
    rules = []
    for text, version in (('rc620', None), ('rc700a', None), ('rc700a', 6)):
        (tmp_path / 'spel.yaml').write_text(f'controller: {text}\n')
        rules.append([item.rule for item in project.problems(version)[1]['main.prg']])
    assert rules == [['version'], [], ['version']]
    (tmp_path / 'spel.yaml').write_text('controller: rc620\nports: 5\n')
    (problem,) = project.problems(6)[1]['spel.yaml']
    assert problem.position.line == 2
    assert 'must have lines ITEM: VALUE' in problem.text
    assert [item.rule for item in project.problems(6)[1]['main.prg']] == ['version']
