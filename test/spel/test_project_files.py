# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Files of RC+ projects: reading, writing, and their use by programs."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from support.spel_harness import ScriptedHost

from epson_driver.inputs import InputError
from epson_driver.inputs.rc_files import Block, header_fault, parsed, rendered, sealed
from epson_driver.spel import Machine, ProgramError, build
from epson_driver.spel.lint import check
from epson_driver.spel.project_data import decoded, read_project

WHEN = datetime(2015, 3, 10, 10, 42, 32, 383000, tzinfo=UTC)
NO_POINTS = Block('', [('sVersion', '"2.0.0"'), ('nNumberOfPoints', '0')])


def point(number: int, label: str, place: tuple[float, ...], **more: int) -> str:
    axes = ''.join(f'\tr{axis}={value}\n' for axis, value in zip('XYZUVW', place, strict=True))
    rest = ''.join(f'\t{key}={value}\n' for key, value in more.items())
    return f'Point{number + 1} {{\n\tnNumber={number}\n\tsLabel="{label}"\n{axes}{rest}}}\n'


POINTS = (
    'sVersion="2.0.0"\nnNumberOfPoints=3\n'
    + point(0, 'pick', (100, 200, -30, 45, 0, 0), nHand=2, nLocal=0)
    + point(3, 'place', (1, 2, 3, 4, 0, 0), nHand=1, nLocal=1)
    + point(5, 'later', (0, 0, 0, 0, 0, 0), nUndefined=262143)
)
LABELS = (
    'InputBitLabels {\n\tnNumberOfLabels=1\n\tLabel1 {\n\t\tnBit=3\n\t\tsLabel="part"\n\t}\n}\n'
    'OutputWordLabels {\n\tLabel1 {\n\t\tnWord=1\n\t\tsLabel="lamps"\n\t}\n}\n'
)


def project(body: str, **files: str) -> dict[str, str]:
    return {
        'main.prg': f'Function main\n{body}\nFend',
        'robot1.pts': POINTS,
        'IOLabels.dat': LABELS,
        **files,
    }


def lines(body: str) -> list[str]:
    host = ScriptedHost()
    machine = Machine(build(project(body)), host)
    machine.start()
    machine.advance(1.0)
    assert host.failures == []
    return host.text.splitlines()


def test_empty_point_file_has_the_checksum_of_rc_plus() -> None:
    """Two public projects contain this file, with size 133 and checksum 23853."""
    text = sealed(NO_POINTS, WHEN, '00-50-56-37-DD-C3')
    assert 'DS:0000000133,CS:23853,' in text
    assert text.startswith('ENVT0100,LM:2015/03/10 10:42:32:383,')
    assert header_fault(text.encode()) == ''
    assert header_fault(text.replace('\r\n', '\n').encode()) == ''
    assert header_fault(text.replace('=0', '=1').encode()) == 'its header has another checksum'
    assert header_fault((text + 'a=1\r\n').encode()) == 'its header has another size'
    assert 'no header' in header_fault(rendered(NO_POINTS).encode())


def test_project_file_is_written_back_unchanged() -> None:
    text = sealed(Block('', [Block('A', [('sPath', r'"C:\\X\\"'), Block('B', [])])]), WHEN)
    assert rendered(parsed('a.sprj', text)) == text


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('a=1\nnonsense\n', r'robot1\.pts:2:1: error: cannot be read: expected key=value'),
        ('}\n', r'robot1\.pts:1:1: error: cannot be read: \} without a block'),
        ('\nA {\n', r'robot1\.pts:2:1: error: cannot be read: the block A has no end: \}'),
        ('Point1 {\nnNumber=x\n}\n', "robot1.pts:2:1: .* nNumber='x': must be a number"),
        ('Point1 {\nnNumber=1e999\n}\n', "robot1.pts:2:1: .* nNumber='1e999': must be a number"),
        ('Point1 {\nnNumber=4000\n}\n', r'pts:2:1: .* point number 4000 is not in 0\.\.999'),
    ],
)
def test_invalid_project_file_is_reported_with_file_and_line(text: str, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        build({'main.prg': 'Function main\nFend', 'robot1.pts': text})


def test_project_file_without_programs_is_refused() -> None:
    """All 52 public files have the number. A truncated file must not build an empty program."""
    message = r'p\.sprj:1:1: error: cannot be read: expected nProgramFileCount=1 or more'
    with pytest.raises(ProgramError, match=message):
        build({'main.prg': 'Function main\nFend', 'p.sprj': 'sRCVersion="7.0.5"\n'})


def test_points_are_found_by_number_and_label() -> None:
    assert lines('Print CX(pick), CZ(P0), CU(place), PDef(1), PDef(3)') == ['100 -30 4 0 -1']
    assert lines('pick = XY(1, 2, 3, 4)\nPrint CX(P0)') == ['1']
    assert lines('Integer i\ni = 3\nPrint CX(Pi)') == ['1']  # p345
    assert lines('Print pick') == [
        ' X:  100.000 Y:  200.000 Z:  -30.000 U:   45.000 V:    0.000 W:    0.000 /L /0'
    ]


@pytest.mark.parametrize(
    ('text', 'z'),
    [('pick :Z(0)', 0), ('pick +Z(5)', -25), ('pick -Z(5) /R', -35), ('pick /R :Z(1)', 1)],
)
def test_point_expression_can_start_with_a_label(text: str, z: float) -> None:
    assert lines(f'P9 = {text}\nPrint CZ(P9)') == [f'{z}']


def test_only_files_listed_in_the_project_are_read(tmp_path: Path) -> None:
    listed = (
        'nProgramFileCount=1\n'
        'ProgramFile1 {\n\tsName="MAIN.prg"\n}\nIncludeFile1 {\n\tsName="a.inc"\n}\n'
        'PointFile1 {\n\tsName="old.pts"\n\tnRobot=1\n\tbDefault=False\n}\n'
        'PointFile2 {\n\tsName="robot1.pts"\n\tnRobot=1\n\tbDefault=True\n}\n'
        'PointFile3 {\n\tsName="robot2.pts"\n\tnRobot=2\n\tbDefault=True\n}\n'
    )
    texts = {'p.sprj': listed, 'main.prg': 'Function main\nFend', 'copy.prg': '', 'a.inc': ''}
    texts |= {'old.pts': POINTS, 'robot1.pts': '', 'robot2.pts': '', 'IOLabels.dat': LABELS}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert list(read_project(tmp_path)) == [
        'main.prg', 'a.inc', 'robot1.pts', 'old.pts', 'IOLabels.dat', 'p.sprj'
    ]  # fmt: skip
    assert read_project(tmp_path / 'p.sprj') == read_project(tmp_path)
    (tmp_path / 'main.prg').unlink()
    assert 'copy.prg' in read_project(tmp_path)
    (tmp_path / 'copy.prg').unlink()
    with pytest.raises(InputError, match=r'has no \.prg file'):
        read_project(tmp_path)


@pytest.mark.parametrize(
    ('text', 'encoding'),
    [
        ('Print "Größe"', 'cp1252'),
        ('Print "Größe"', 'utf-8'),
        ('Print "日本語のテキスト、これはコメントです"', 'shift_jis'),
        ('Print "机器人开始运动，等待信号"', 'gb18030'),
        ('Print "機器人開始運動等待訊號"', 'big5'),
        ('Print "로봇이 움직입니다"', 'cp949'),
    ],
)
def test_code_page_is_detected_from_the_content(text: str, encoding: str) -> None:
    assert decoded(text.encode(encoding)) == text


def test_all_files_of_a_project_have_one_code_page(tmp_path: Path) -> None:
    """A label of two characters is too short to detect a code page, unlike the programs."""
    program = "Function main\n  Go 開啟 ' 機器人開始運動等待訊號，本程式實作讀寫設備方式\nFend\n"
    (tmp_path / 'main.prg').write_bytes(program.encode('big5'))
    (tmp_path / 'robot1.pts').write_bytes('Point1 {\nsLabel="開啟"\n}\n'.encode('big5'))
    assert decoded('開啟'.encode('big5')) != '開啟'
    files = read_project(tmp_path)
    assert files['main.prg'] == program
    assert '"開啟"' in files['robot1.pts']


def test_check_reports_an_invalid_header() -> None:
    found = [item for item in check(project('')) if item.rule == 'project-file']
    assert {item.position.file for item in found} == {'robot1.pts', 'IOLabels.dat'}
    assert all(item.warning for item in found)


def found(files: dict[str, str]) -> list[tuple[str, bool]]:
    return [(item.text.split(':')[0], item.warning) for item in check(files)]


ALONE = """Function main
  Jump Origin +X(5) C0
  home1 = XY(1, 2, 3, 4)
  Wait Sw(Part) = On
  On Gripper
  Go home1
  Local 3, (Corner:P1), (Side:home1), X
Fend
"""


def test_labels_of_missing_files_are_warnings() -> None:
    problems = found({'main.prg': ALONE})
    assert all(warning and ' the label of a' in text for text, warning in problems)
    labels = [text.split()[0] for text, _ in problems]
    assert labels == ['Origin', 'home1', 'Part', 'Gripper', 'Corner', 'Side']
    assert found({'main.prg': ALONE.replace('Gripper', 'Griper(2)')})[3][1] is False
    host = ScriptedHost()
    machine = Machine(build({'main.prg': ALONE.replace('Jump Origin +X(5) C0', '')}), host)
    machine.start()
    machine.advance(1.0)
    assert 'the I/O label Part has no number' in str(host.failures[0])
    machine = Machine(build({'main.prg': 'Function main\n  Go Origin\nFend'}), ScriptedHost())
    machine.start()
    machine.advance(1.0)
    (view,) = machine.tasks()
    assert 'Origin is not defined' in machine.world.aborted[view.number].text


def test_labels_missing_in_present_files_are_errors() -> None:
    names = project(ALONE.removeprefix('Function main\n').removesuffix('Fend\n'))
    assert [warning for _, warning in found(names)].count(False) == 5


def test_constructs_of_published_projects_are_accepted() -> None:
    """DUNE/CE-RTS uses `AsInteger`, and SMC_LEHR uses Static variables of a file."""
    program = (
        'Static Integer m_state\nGlobal Static UByte mode\nFunction Set(value AsInteger)\n'
        'm_state = value; mode = m_state\nPrint m_state, mode\nFend\n'
        'Function main\nSet(3)\nFend\n'
    )
    machine = Machine(build({'main.prg': program}), host := ScriptedHost())
    machine.start()
    machine.advance(0.1)
    assert host.text.split() == ['3', '3']
    assert ('AsInteger', True) in found({'main.prg': program})
