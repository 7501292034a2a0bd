# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points: RC+ and YAML files, teaching, and moves to them."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver import EpsonPoint, Robot, RobotError, aio
from epson_driver.aio import ArgumentError
from epson_driver.inputs.rc_files import Block, header_fault, parsed, sealed

WHEN = datetime(2024, 5, 6, 7, 8, 9, tzinfo=UTC)
ORDER = (
    'nNumber sLabel sDescription nUndefined rX rY rZ rU rV rW rR rS rT nLocal nHand nElbow nWrist '
    'nJ1Flag nJ2Flag nJ4Flag nJ6Flag rJ1Angle rJ4Angle bSimVisible'
)


def block(turn, **values):
    defaults = dict.fromkeys(ORDER.split(), '0') | {'sLabel': '""', 'sDescription': '""'}
    defaults |= {'nHand': '2', 'nElbow': '1', 'nWrist': '1', 'nUndefined': '448'}
    return Block(f'Point{turn}', [*(defaults | values).items()])


FILE = sealed(
    Block(
        '',
        [
            ('sVersion', '"2.0.0"'),
            ('nDisplayMode', '2'),
            ('nNumberOfPoints', '4'),
            block(1, sLabel='"pick"', rX='200.000122070313', rY='-1.5258786334016E-05', rZ='-30'),
            block(2, nNumber='3', rX='150', rY='200', rZ='-40.500', rU='90', nJ4Flag='1'),
            block(3, nNumber='7', sLabel='"later"', nUndefined='262143'),
            block(4, nNumber='9', sLabel='"tray"', rX='10', nLocal='2'),
        ],
    ),
    WHEN,
).encode('latin-1')


@pytest.fixture
def points(tmp_path):
    """Return the points of a SCARA that is not connected, read from FILE."""
    (tmp_path / 'robot1.pts').write_bytes(FILE)
    robot = aio.Robot(model='gx4_a251s')
    assert robot.points.load(tmp_path / 'robot1.pts') == 4
    robot.points.robot = robot  # keep the robot alive
    return robot.points


def test_points_are_found_by_label_or_number_in_any_case(points):
    assert list(points) == ['pick', 'P3', 'later', 'tray']
    assert points['PICK'].x == points['p0'].x == 200.000122070313
    assert points['P3'] == EpsonPoint(150, 200, -40.5, 90)
    assert 'later' in points
    with pytest.raises(KeyError, match=r'^no point named nowhere: the points are pick') as no:
        points['nowhere']
    assert isinstance(no.value, ArgumentError)
    with pytest.raises(ArgumentError, match='point later is not taught yet'):
        points['later']
    with pytest.raises(ArgumentError, match=r'in Local 2 .*P\d+ = P\d+ @0 converts'):
        points['tray']


@pytest.mark.parametrize('end', [b'\r\n', b'\n'])
def test_unchanged_file_is_written_byte_for_byte(points, tmp_path, end):
    content = FILE.replace(b'\r\n', end)
    (tmp_path / 'in.pts').write_bytes(content)
    points.load(tmp_path / 'in.pts')
    points.save(tmp_path / 'out.pts')
    assert (tmp_path / 'out.pts').read_bytes() == content


def test_save_changes_only_the_edited_values(points, tmp_path):
    points['pick'] = points['pick'].moved(z=5.0)
    points['P3'] = EpsonPoint(150, 200, -41, 90)
    points.save(tmp_path / 'out.pts')
    content = (tmp_path / 'out.pts').read_bytes()
    assert header_fault(content) == ''
    before, after = FILE.decode().splitlines()[1:], content.decode().splitlines()[1:]
    changed = [
        (old.strip(), new.strip()) for old, new in zip(before, after, strict=True) if old != new
    ]
    assert changed == [
        ('rZ=-30', 'rZ=-25.000'),
        ('rZ=-40.500', 'rZ=-41.000'),
    ]


def test_deleted_point_is_removed_and_the_rest_renumbered(points, tmp_path):
    del points['P3']
    points.save(tmp_path / 'out.pts')
    text = (tmp_path / 'out.pts').read_text()
    assert 'nNumberOfPoints=3' in text
    assert [line for line in text.splitlines() if line.startswith('Point')] == [
        'Point1 {',
        'Point2 {',
        'Point3 {',
    ]
    with pytest.raises(KeyError):
        del points['P3']
    with pytest.raises(RobotError, match=r'create the folder .*none, or correct') as error:
        points.save(tmp_path / 'none' / 'out.pts')
    assert isinstance(error.value, OSError)


def test_point_without_posture_is_refused_in_a_pts_file_but_saved_in_a_yaml_file(tmp_path):
    robot = aio.Robot()
    with pytest.raises(KeyError, match=r'^no point named P1: teach or load it$'):
        del robot.points['P1']
    robot.points['pick'] = EpsonPoint(300, 0, 400)
    with pytest.raises(ArgumentError, match='posture of the arm'):
        robot.points.save(tmp_path / 'out.pts')
    assert not list(tmp_path.iterdir())
    robot.points.save(tmp_path / 'out.yaml')
    assert (tmp_path / 'out.yaml').read_text().startswith('pick: {x: 300.0, y: 0.0, z: 400.0')


NAMES = st.from_regex(r'[A-OQ-Za-oq-z_][A-Za-z0-9_]{0,15}', fullmatch=True)
PLACES = st.builds(EpsonPoint, *[st.floats(-1e4, 1e4)] * 6)


@given(st.dictionaries(NAMES.map(str.lower), PLACES, max_size=5))
def test_points_survive_a_round_trip_through_a_yaml_file(tmp_path_factory, places):
    file = tmp_path_factory.mktemp('points') / 'points.yaml'
    first, second = aio.Robot(), aio.Robot()
    for name, place in places.items():
        first.points[name] = place
    first.points.save(file)
    if places:
        second.points.load(file)
        assert {name: second.points[name] for name in second.points} == places


@pytest.mark.parametrize(
    ('name', 'text', 'expected'),
    [
        ('a.pts', 'Point1 {\n', 'has no end'),
        ('a.pts', 'Point1 {\nnNumber=1000\n}\n', r'point number 1000 is not in 0\.\.999'),
        ('a.pts', 'Point1 {\nnNumber=x\n}\n', "a.pts:2: nNumber='x': must be a"),
        (
            'a.pts',
            'Point1 {\nnNumber=1\n}\nPoint2 {\nnNumber=1\n}\n',
            'two points have the name P1',
        ),
        ('a.pts', 'Point1 {\nnNumber=1\nrX=nan\n}\n', "a.pts:3: rX='nan'"),
        ('a.yaml', '[1]', 'must be a mapping'),
        ('a.yaml', 'pick: {x: 1}', 'pick: must have x, y, z'),
        ('a.yaml', 'pick: {x: 1, y: 2, z: far}', "pick: z = 'far'"),
        ('a.yaml', 'p1: {x: 1, y: 2, z: 3}', 'must be a unique name of a point'),
        ('a.txt', '', r'must be a \.pts, a \.csv or a \.yaml file'),
    ],
)
@pytest.mark.invariant(7)
def test_invalid_file_gives_one_sentence_and_changes_nothing(
    points, tmp_path, name, text, expected
):
    (tmp_path / name).write_text(text)
    with pytest.raises(ArgumentError, match=expected):
        points.load(tmp_path / name)
    assert 'pick' in points


@pytest.mark.parametrize('name', ['', 'p7', 'P12', 'a b', 'ä', '1st', 'x' * 40])
def test_point_name_must_be_a_word(name):
    with pytest.raises(ArgumentError, match='must be a word'):
        aio.Robot().points[name] = EpsonPoint(1, 2, 3)


def test_taught_point_is_approached_and_reached(tmp_path):
    with Robot.simulated(model='gx4_a251s', start=[0.3, 0.9, -0.05, 0.0]) as robot:
        robot.enable()
        pick = robot.points.teach('pick')
        assert robot.points['pick'] == pick
        robot.move_line(robot.points['pick'].moved(z=20.0), speed=0.2)
        assert robot.epson_point.z == pytest.approx(pick.z + 20.0, abs=0.01)
        robot.move_joints(robot.points['pick'])
        assert robot.epson_point.z == pytest.approx(pick.z, abs=0.01)
        robot.points.save(tmp_path / 'robot1.pts')
        assert 'nHand=1' in (tmp_path / 'robot1.pts').read_text()
        assert robot.points.load(tmp_path / 'robot1.pts') == 1
        assert len(robot.points) == 1
        assert list(robot.points) == ['pick']
        assert robot.points['P0'].x == pytest.approx(pick.x, abs=1e-3)


@pytest.mark.slow
def test_six_axis_arm_saves_hand_elbow_wrist_and_turns(tmp_path):
    with Robot.simulated(start=[0.3, 0.2, 0.2, 0.0, -1.9, 3.3]) as robot:
        robot.points.teach('pick')
        robot.points['over'] = robot.points['pick'].moved(z=50)
        with pytest.raises(ArgumentError, match=r'point over: .*teach it in RC'):
            robot.points.save(tmp_path / 'robot1.pts')
        del robot.points['over']
        robot.points.save(tmp_path / 'robot1.pts')
        assert robot.points.load(tmp_path / 'robot1.pts') == 1
    (written,) = parsed('robot1.pts', (tmp_path / 'robot1.pts').read_text()).blocks('Point')
    assert [key for key, _ in written.items] == ORDER.split()
    flags = ('nHand', 'nElbow', 'nWrist', 'nJ1Flag', 'nJ2Flag', 'nJ4Flag', 'nJ6Flag')
    assert [written.number(key) for key in flags] == [1, 1, 1, 0, 0, 0, 1]


def test_before_shifts_a_point_backwards_along_the_tool():
    point = EpsonPoint(300, 0, 400, 0, 90, 0)
    away = point.before(50)
    tool = point.pose[:3, 2]
    assert (away.pose[:3, 3] - point.pose[:3, 3]) * 1e3 == pytest.approx(-50 * tool)
    assert away.pose[:3, :3] == pytest.approx(point.pose[:3, :3])
    assert np.abs(point.moved(x=1, y=2, z=3, u=4).u) == 4


def test_teach_without_connection_raises():
    robot = aio.Robot()
    with pytest.raises(RobotError, match='no connection'):
        robot.points.teach('pick')


def test_csv_file_keeps_all_values_of_a_pts_file(points, tmp_path):
    points.save(tmp_path / 'a.csv')
    again = aio.Robot(model='gx4_a251s').points
    again.load(tmp_path / 'a.csv')
    again.save(tmp_path / 'b.pts')
    content = (tmp_path / 'b.pts').read_bytes()
    assert header_fault(content) == ''
    old, new = (parsed('', text.decode('latin-1')) for text in (FILE, content))
    assert list(new.blocks('Point')) == list(old.blocks('Point'))


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'Number,X,Y,Z\n', 'must have the columns Number, X'),
        (b'Number,X,Y,Z,Hand,Elbow,Wrist,Q\n', 'must have the columns'),
        (b'Number,X,Y,Z,Hand,Elbow,Wrist\n1,2\n', ':2: must have 7 values'),
        (b'Number,X,Y,Z,Hand,Elbow,Wrist\n1,2,3,4,5,6,7,8\n', ':2: must have 7 values'),
        (b'Number,X,Y,Z,Hand,Elbow,Wrist\n1,b,3,4,1,1,1\n', ':2: rX='),
        (b'Number,X,Y,Z,Hand,Elbow,Wrist\n1,"2,3', ':2: must have 7 values'),
    ],
)
def test_csv_with_a_fault_is_refused_with_its_line(points, tmp_path, content, text):
    file = tmp_path / 'a.csv'
    file.write_bytes(content)
    with pytest.raises(ArgumentError, match=text):
        points.load(file)
