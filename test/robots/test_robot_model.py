# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The C3-A601S's figures, and what the loader says about a file that cannot be used."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from epson_driver.motion import Array
from epson_driver.robots import RobotModelError, load_robot_model
from epson_driver.share import share_file

C3_FILE = Path(__file__).parents[2] / 'config' / 'robots' / 'c3_a601s.yaml'

# The manual's ranges and speeds, in degrees and degrees/s.
RANGES = [(-170, 170), (-160, 65), (-51, 225), (-200, 200), (-135, 135), (-360, 360)]
SPEEDS = [450, 450, 514, 553, 553, 720]
# EPSON's own package for the CX4-A601S, rad/s².
ACCELERATIONS = [49.19, 68.96, 99.46, 85.02, 103.51, 191.77]
# Encoder pulses at the ends of the C4-A601S's ranges.
PULSES = [
    (-4951609, 4951609),
    (-4660338, 1893263),
    (-1299798, 5734400),
    (-4723316, 4723316),
    (-3188238, 3188238),
    (-6553600, 6553600),
]


def test_the_c3_has_the_documented_joints_and_ranges() -> None:
    model = load_robot_model('c3_a601s')
    assert model.name == 'c3_a601s'
    assert 'C3-A601S' in model.description
    assert model.joint_names == tuple(f'joint_{number}' for number in range(1, 7))
    low, high = np.deg2rad(np.array(RANGES, dtype=float)).T
    np.testing.assert_allclose(model.limits.position_min, low, rtol=1e-15)
    np.testing.assert_allclose(model.limits.position_max, high, rtol=1e-15)


def test_invariant_2_the_c3_is_never_faster_than_documented() -> None:
    limits = load_robot_model('c3_a601s').limits
    documented = np.deg2rad(np.array(SPEEDS, dtype=float))
    assert np.all(limits.velocity <= documented)
    np.testing.assert_allclose(limits.velocity, documented, atol=0.01)
    np.testing.assert_array_equal(limits.acceleration, ACCELERATIONS)
    np.testing.assert_allclose(limits.jerk, 10.0 * limits.acceleration, rtol=1e-12)


def test_the_pulses_of_the_c3_fit_its_ranges() -> None:
    model = load_robot_model('c3_a601s')
    ends = np.array(RANGES, dtype=float) * model.pulses_per_degree[:, None]
    np.testing.assert_allclose(ends, PULSES, atol=1.5)
    gears = model.pulses_per_degree * 360.0 / 2**17
    np.testing.assert_allclose(gears, [80, 80, 70, 2400 / 37, 2400 / 37, 50], rtol=1e-5)


def test_the_reach_of_the_c3_is_what_its_urdf_allows_and_no_less() -> None:
    root = ElementTree.parse(share_file('urdf', 'c3_a601s.urdf')).getroot()
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    reach = load_robot_model('c3_a601s').reach
    random = np.random.default_rng(0)
    bends = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi])
    most = np.zeros(6)
    for number in range(3000):  # every second pose has right angles only, where the extremes are
        angles = random.uniform(-np.pi, np.pi, 6) if number % 2 else random.choice(bends, 6)
        rotation, place = np.eye(3), np.zeros(3)
        axes = []
        for index in range(6):
            joint = joints[f'joint_{index + 1}']
            place = place + rotation @ numbers(joint.find('origin').get('xyz'))
            axis = numbers(joint.find('axis').get('xyz'))
            axes.append((place, rotation @ axis))
            cross = np.cross(np.eye(3), axis)
            turn = np.eye(3) + np.sin(angles[index]) * cross
            rotation = rotation @ (turn + (1.0 - np.cos(angles[index])) * cross @ cross)
        tool = place + rotation @ numbers(joints['link_6-tool0'].find('origin').get('xyz'))
        away = [float(np.linalg.norm(np.cross(axis, tool - at))) for at, axis in axes]
        most = np.maximum(most, away)
    assert np.all(most <= reach + 1e-12)
    np.testing.assert_allclose(most, reach, atol=0.002)


def numbers(text: str | None) -> Array:
    return np.array([float(word) for word in (text or '0 0 0').split()])


def test_every_number_of_the_c3_has_a_source_and_a_confidence_per_joint() -> None:
    model = load_robot_model('c3_a601s')
    quantities = ['position', 'velocity', 'acceleration', 'jerk', 'pulses_per_degree', 'reach']
    assert list(model.provenance) == quantities
    for origin in model.provenance.values():
        assert origin.source
        assert len(origin.confidence) == 6
    assert model.provenance['position'].confidence == ('high',) * 6
    assert model.provenance['velocity'].confidence[3:5] == ('medium', 'medium')
    assert set(model.provenance['acceleration'].confidence) == {'low'}


@pytest.mark.parametrize('name', ['c5_a901s', 'C3_A601S', ''])
def test_an_unknown_model_lists_those_that_exist(name: str) -> None:
    with pytest.raises(FileNotFoundError, match=r'there is: .*\bc3_a601s\b') as error:
        load_robot_model(name)
    assert f'no {name}.yaml in ' in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r'mine\.yaml'):
        load_robot_model(str(tmp_path / 'mine.yaml'))


Edit = Callable[[dict[str, Any]], object]


@pytest.fixture
def data() -> dict[str, Any]:
    """Return a model of two joints as a mapping, to be spoiled."""
    return {
        'name': 'scara',
        'description': 'two joints',
        'joint_names': ['a', 'b'],
        'limits': {
            'position': {'min': [-1, -2.5], 'max': [1, 2.5], 'source': 's', 'confidence': 'high'},
            'velocity': {'max': [1.0, 2.0], 'source': 's', 'confidence': ['low', 'high']},
            'acceleration': {'max': [10.0, 20.0], 'source': 's', 'confidence': 'low'},
            'jerk': {'max': [100.0, 200.0], 'source': 's', 'confidence': 'low'},
        },
        'pulses_per_degree': {'value': [100.0, -200.0], 'source': 's', 'confidence': 'medium'},
        'reach': {'value': [0.5, 0], 'source': 's', 'confidence': 'medium'},
    }


def write(data: object, folder: Path) -> Path:
    path = folder / 'model.yaml'
    path.write_text(yaml.safe_dump(data, allow_unicode=True), encoding='utf-8')
    return path


def test_a_model_is_read_from_any_file(data: dict[str, Any], tmp_path: Path) -> None:
    model = load_robot_model(str(write(data, tmp_path)))
    assert model.joint_names == ('a', 'b')
    assert model.limits.position_min.tolist() == [-1.0, -2.5]
    assert model.pulses_per_degree.tolist() == [100.0, -200.0]
    assert model.reach.tolist() == [0.5, 0.0]
    assert model.provenance['velocity'].confidence == ('low', 'high')
    assert model.provenance['jerk'].confidence == ('low', 'low')


MISSING = [
    ('name',),
    ('description',),
    ('joint_names',),
    ('limits',),
    ('pulses_per_degree',),
    ('pulses_per_degree', 'value'),
    ('pulses_per_degree', 'source'),
    ('reach',),
    ('reach', 'value'),
    ('reach', 'source'),
    ('limits', 'position'),
    ('limits', 'velocity'),
    ('limits', 'acceleration'),
    ('limits', 'jerk'),
    ('limits', 'position', 'min'),
    ('limits', 'position', 'max'),
    ('limits', 'velocity', 'max'),
    ('limits', 'velocity', 'source'),
]


@pytest.mark.parametrize('keys', MISSING, ids='.'.join)
def test_a_missing_key_is_named(
    keys: tuple[str, ...], data: dict[str, Any], tmp_path: Path
) -> None:
    block = data
    for key in keys[:-1]:
        block = block[key]
    del block[keys[-1]]
    path = write(data, tmp_path)
    with pytest.raises(RobotModelError) as error:
        load_robot_model(str(path))
    assert str(error.value) == f'{path}: {".".join(keys)} is missing'


NAN = float('nan')
CONFIDENCE = 'must be one of high, medium, low, or a list of one per joint'


@pytest.mark.parametrize(
    ('keys', 'value', 'text'),
    [
        ('name', 7, 'name = 7: must be a str'),
        ('joint_names', 'a b', "joint_names = 'a b': must be a list"),
        ('joint_names', [], 'joint_names = []: must be a list of names'),
        ('joint_names', ['a', 2], "joint_names = ['a', 2]: must be a list of names"),
        ('joint_names', [['a'], 'b'], "joint_names = [['a'], 'b']: must be a list of names"),
        ('joint_names', ['a', 'a'], "joint names must be there and differ: ('a', 'a')"),
        ('limits', [1], 'limits = [1]: must be a dict'),
        ('limits.jerk', 5.0, 'limits.jerk = 5.0: must be a dict'),
        ('limits.jerk.max', 5.0, 'limits.jerk.max = 5.0: must be a list'),
        (
            'limits.velocity.max',
            [1.0],
            'limits.velocity.max = [1.0]: must have 2 numbers, one per joint',
        ),
        (
            'limits.position.min',
            [0.0, 0.0, 0.0],
            'limits.position.min = [0.0, 0.0, 0.0]: must have 2 numbers, one per joint',
        ),
        (
            'pulses_per_degree.value',
            [1.0],
            'pulses_per_degree.value = [1.0]: must have 2 numbers, one per joint',
        ),
        ('limits.jerk.max', [1.0, 'fast'], "limits.jerk.max = 'fast': must be a number"),
        ('limits.jerk.max', [True, 2.0], 'limits.jerk.max = True: must be a number'),
        ('limits.jerk.max', [None, 2.0], 'limits.jerk.max = None: must be a number'),
        ('limits.position.max', [1.0, NAN], 'limits.position.max = nan: must be finite'),
        ('limits.velocity.max', [-NAN, 1.0], 'limits.velocity.max = nan: must be finite'),
        ('limits.velocity.max', [1.0, 1e999], 'limits.velocity.max = inf: must be finite'),
        ('limits.jerk.max', [1.0, 10**400], f'limits.jerk.max = {10**400}: must be finite'),
        ('pulses_per_degree.value', [1.0, NAN], 'pulses_per_degree.value = nan: must be finite'),
        (
            'pulses_per_degree.value',
            [1.0, 0],
            'pulses_per_degree.value = [1.0, 0.0]: must not be 0',
        ),
        ('reach', 0.5, 'reach = 0.5: must be a dict'),
        ('reach.value', [1.0], 'reach.value = [1.0]: must have 2 numbers, one per joint'),
        ('reach.value', [1.0, -0.1], 'reach.value = [1.0, -0.1]: must not be negative'),
        ('reach.value', [1.0, NAN], 'reach.value = nan: must be finite'),
        ('reach.confidence', 'sure', f"reach.confidence = 'sure': {CONFIDENCE}"),
        ('limits.acceleration.max', [1.0, -2.0], 'b: acceleration = -2.0 must be positive'),
        ('limits.position.max', [-1, 2.5], 'a: position range -1.0 … -1.0 is empty'),
        (
            'limits.jerk.confidence',
            'certain',
            f"limits.jerk.confidence = 'certain': {CONFIDENCE}",
        ),
        (
            'limits.jerk.confidence',
            ['low'],
            f"limits.jerk.confidence = ['low']: {CONFIDENCE}",
        ),
        (
            'pulses_per_degree.confidence',
            None,
            f'pulses_per_degree.confidence = None: {CONFIDENCE}',
        ),
        ('limits.jerk.source', 3, 'limits.jerk.source = 3: must be a str'),
    ],
    ids=lambda x: x[:60] if isinstance(x, str) else '',
)
def test_a_wrong_value_is_named_with_its_file_and_key(
    keys: str, value: object, text: str, data: dict[str, Any], tmp_path: Path
) -> None:
    block = data
    *parents, last = keys.split('.')
    for key in parents:
        block = block[key]
    block[last] = value
    path = write(data, tmp_path)
    with pytest.raises(RobotModelError, match=f'^{re.escape(f"{path}: {text}")}$'):
        load_robot_model(str(path))


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'', 'the file = None: must be a mapping'),
        (b'- 1\n- 2\n', 'the file = [1, 2]: must be a mapping'),
        (b'name: [a', 'not YAML: while parsing'),
        (b'name: \xff\xfe\n', 'not YAML: '),
        (b'name: 2026-99-99\n', 'not YAML: month must be in 1..12'),
        (b'name: "\x00"\n', 'not YAML: '),
        (b'name: !!python/object:os.system x\n', 'not YAML: could not determine a constructor'),
    ],
)
def test_a_file_that_is_no_mapping_or_no_yaml_is_named(
    content: bytes, text: str, tmp_path: Path
) -> None:
    path = tmp_path / 'broken.yaml'
    path.write_bytes(content)
    with pytest.raises(RobotModelError, match=f'^{re.escape(f"{path}: {text}")}'):
        load_robot_model(str(path))


def test_every_robot_file_is_a_model_of_its_own_name() -> None:
    paths = sorted(C3_FILE.parent.glob('*.yaml'))
    assert C3_FILE in paths
    assert [load_robot_model(path.stem).name for path in paths] == [path.stem for path in paths]
