# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The C3-A601S's figures, and what the loader says about a file that cannot be used."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from epson_driver.inputs import JOINT_NAMES, InputError, shown
from epson_driver.robots import load_robot_model, robot_models

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


@pytest.mark.invariant(2)
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


def test_every_number_of_the_c3_has_a_source_and_a_confidence_per_joint() -> None:
    model = load_robot_model('c3_a601s')
    per_joint = ['position', 'velocity', 'acceleration', 'jerk', 'pulses_per_degree']
    assert list(model.provenance) == [*per_joint, 'chain', 'tool0', 'base', 'payload', 'mass']
    for quantity, origin in model.provenance.items():
        assert origin.source
        assert len(origin.confidence) == (6 if quantity in per_joint else 1)
    assert model.provenance['position'].confidence == ('high',) * 6
    assert model.provenance['velocity'].confidence[3:5] == ('medium', 'medium')
    assert model.provenance['velocity'].worst == 'medium'
    assert set(model.provenance['acceleration'].confidence) == {'low'}
    assert model.confidence == 'low'


def test_the_chain_of_the_c3_is_that_of_the_documents() -> None:
    model = load_robot_model('c3_a601s')
    assert model.kind == 'six-axis'
    assert model.joint_types == ('revolute',) * 6
    assert model.limits.units == ('rad',) * 6
    assert model.chain.origins.sum(axis=0).tolist() == pytest.approx([0.41, 0.0, 0.57])
    assert model.chain.origins[:2, 2].sum() == pytest.approx(0.32)  # height of joint 2
    assert model.tool0.xyz.tolist() == [0.005, 0.0, 0.0]
    x, y, z = np.round(model.tool0.matrix[:3, :3].T, 12)
    assert [x.tolist(), y.tolist(), z.tolist()] == [[0, 0, 1], [0, -1, 0], [1, 0, 0]]
    # X_epson = -y, Y_epson = x
    np.testing.assert_allclose(model.base.matrix[:3, :3].T @ (0, -1, 0), (1, 0, 0), atol=1e-15)
    np.testing.assert_allclose(model.base.matrix[:3, :3].T @ (1, 0, 0), (0, 1, 0), atol=1e-15)


def test_pulses_and_reach_follow_the_unit_of_the_joint() -> None:
    model = load_robot_model('gx4_c251s')
    assert model.kind == 'SCARA'
    assert model.limits.units == ('rad', 'rad', 'm', 'rad')
    assert model.shown_per_unit.tolist() == pytest.approx([57.29577951] * 2 + [1e3, 57.29577951])
    # EPSON's pulse ranges: 280 degrees of joint 1, 150 mm of joint 3, 360 degrees of joint 4
    ranges = model.pulses_per_unit * [np.radians(280.0), 1.0, 0.15, 2.0 * np.pi]
    assert ranges[[0, 2, 3]].tolist() == pytest.approx([8155592, 1706667, 1494221], rel=1e-5)
    # arms 124 and 126 mm; joint 3 moves the tool by 1 m per m, joint 4 turns it on the spot
    assert model.reach.tolist() == pytest.approx([0.25, 0.126, 1.0, 0.0], abs=1e-12)


@pytest.mark.parametrize('name', ['c5_a901s', 'C9-B1401', ''])
def test_an_unknown_model_lists_those_that_exist(name: str) -> None:
    with pytest.raises(FileNotFoundError, match=r'there is: .*\bc3_a601s\b') as error:
        load_robot_model(name)
    assert f'no {name}.yaml in ' in str(error.value)


@pytest.mark.parametrize('name', ['C4-A601S', 'C4_A601S', 'c4-a601s', 'C4-A6', 'c4_a6'])
def test_a_name_may_be_written_as_epson_does_and_shortened(name: str) -> None:
    assert load_robot_model(name).name == 'c4_a601s'


@pytest.mark.parametrize(
    ('name', 'near'),
    [
        ('C8', 'c8_c1401s or c8_c901s'),
        ('C4', 'c4_a601s or c4_a901s'),
        ('C4-A601SR', 'c4_a601s or '),
        ('c3a601s', 'c3_a601s or '),
    ],
)
def test_a_name_that_could_be_several_models_or_none_is_answered_with_near_ones(
    name: str, near: str
) -> None:
    with pytest.raises(FileNotFoundError) as error:
        load_robot_model(name)
    assert f'; did you mean {near}' in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'mine\.yaml: No such file'):
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
        'chain': {
            'origins': [[0, 0, 0.1], [0.3, 0.4, 0]],
            'axes': [[0, 0, 1], [0, 0.6, 0.8]],
            'source': 's',
            'confidence': 'medium',
        },
        'tool0': {'xyz': [0, 0, 0.2], 'rpy': [0, 0, 0], 'source': 's', 'confidence': 'low'},
        'base': {'rpy': [0, 0, 1.5], 'source': 's', 'confidence': 'high'},
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
    # joint 2's axis leaves 0.12 m of the tool's 0.2 m across it, the rest is as on joint 1's link
    along = 0.8 * 0.2
    assert model.reach.tolist() == pytest.approx(
        [float(np.hypot(0.3, 0.4 + 0.6 * along)) + 0.12, 0.12]
    )
    assert model.kind == '2 joints'
    assert model.base.xyz.tolist() == [0.0, 0.0, 0.0]
    assert model.payload is None
    assert 'payload' not in model.provenance
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
    ('chain',),
    ('chain', 'origins'),
    ('chain', 'axes'),
    ('chain', 'source'),
    ('tool0',),
    ('tool0', 'xyz'),
    ('tool0', 'rpy'),
    ('tool0', 'source'),
    ('base',),
    ('base', 'rpy'),
    ('base', 'source'),
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
    with pytest.raises(InputError) as error:
        load_robot_model(str(path))
    assert str(error.value) == f'{path}: {".".join(keys)} is missing'


NAN = float('nan')
ONE = 'must be one of high, medium, low'
REACHED = 'must be a number from -1000 to 1000 rad or m'
LIMIT = 'must be a number from 1e-06 to 1e+06 in its unit'
LENGTH = 'must be a number from -100 to 100 m'
TURN = 'must be a number from -10 to 10 rad'
AXIS = 'must be a number from -1 to 1'
ENCODER = 'must be a number from -1e+09 to 1e+09 pulses'
WEIGHT = 'must be a number from 0.001 to 100000 kg'
NAMES = JOINT_NAMES.text
CONFIDENCE = f'{ONE}, or a list of one per joint'
TYPES = 'must be a list of one per joint, each of revolute, prismatic'
LOAD = {'source': 's', 'confidence': 'low'}


@pytest.mark.parametrize(
    ('keys', 'value', 'text'),
    [
        ('name', 7, 'name = 7: must be a str'),
        ('joint_names', 'a b', "joint_names = 'a b': must be a list"),
        ('joint_names', [], f'joint_names = []: {NAMES}'),
        ('joint_names', ['a', 2], f"joint_names = ['a', 2]: {NAMES}"),
        ('joint_names', [['a'], 'b'], f"joint_names = [['a'], 'b']: {NAMES}"),
        ('joint_names', ['a', 'a'], f"joint_names = ['a', 'a']: {NAMES}"),
        ('joint_names', ['a', ''], f"joint_names = ['a', '']: {NAMES}"),
        ('joint_names', ['a', 'b.c'], f"joint_names = ['a', 'b.c']: {NAMES}"),
        ('joint_names', ['a', 'b\n'], f"joint_names = ['a', 'b\\n']: {NAMES}"),
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
        ('limits.jerk.max', [1.0, 'fast'], f"limits.jerk.max = 'fast': {LIMIT}"),
        ('limits.jerk.max', [True, 2.0], f'limits.jerk.max = True: {LIMIT}'),
        ('limits.jerk.max', [None, 2.0], f'limits.jerk.max = None: {LIMIT}'),
        ('limits.position.max', [1.0, NAN], f'limits.position.max = nan: {REACHED}'),
        ('limits.velocity.max', [-NAN, 1.0], f'limits.velocity.max = nan: {LIMIT}'),
        ('limits.velocity.max', [1.0, 1e999], f'limits.velocity.max = inf: {LIMIT}'),
        ('limits.jerk.max', [1.0, 10**400], f'limits.jerk.max = {shown(10**400)}: {LIMIT}'),
        ('limits.jerk.max', [1.0, 1e300], f'limits.jerk.max = 1e+300: {LIMIT}'),
        ('limits.jerk.max', [1.0, 1e-300], f'limits.jerk.max = 1e-300: {LIMIT}'),
        ('limits.position.min', [1.0, -1e300], f'limits.position.min = -1e+300: {REACHED}'),
        ('pulses_per_degree.value', [1.0, NAN], f'pulses_per_degree.value = nan: {ENCODER}'),
        (
            'pulses_per_degree.value',
            [1.0, 0],
            'pulses_per_degree.value = [1.0, 0.0]: none may be less than 0.001',
        ),
        ('joint_types', 'revolute', "joint_types = 'revolute': must be a list"),
        ('joint_types', ['revolute'], f"joint_types = ['revolute']: {TYPES}"),
        ('joint_types', ['revolute', 'ball'], f"joint_types = ['revolute', 'ball']: {TYPES}"),
        ('joint_types', ['revolute', None], f"joint_types = ['revolute', None]: {TYPES}"),
        ('chain', 0.5, 'chain = 0.5: must be a dict'),
        (
            'chain.origins',
            [[0, 0, 1]],
            'chain.origins = [[0, 0, 1]]: must have 2 vectors, one per joint',
        ),
        (
            'chain.origins',
            [[0, 0, 1], [0, 1]],
            'chain.origins = [0, 1]: must have 3 numbers, x, y and z',
        ),
        ('chain.origins', [[0, 0, 1], 3], 'chain.origins = 3: must have 3 numbers, x, y and z'),
        ('chain.origins', [[0, 0, 1], [0, NAN, 0]], f'chain.origins = nan: {LENGTH}'),
        ('chain.axes', [[0, 0, 1], [0, 'y', 0]], f"chain.axes = 'y': {AXIS}"),
        ('chain.axes', [[0, 0, 1], [0, 0, 0]], 'chain.axes = [0.0, 0.0, 0.0]: must have length 1'),
        (
            'chain.axes',
            [[0, 0, 1], [0, 1, 0.001]],
            'chain.axes = [0.0, 1.0, 0.001]: must have length 1',
        ),
        ('chain.confidence', ['low', 'low'], f"chain.confidence = ['low', 'low']: {ONE}"),
        ('tool0.xyz', [0, 0], 'tool0.xyz = [0, 0]: must have 3 numbers, x, y and z'),
        ('tool0.rpy', [0, 0], 'tool0.rpy = [0, 0]: must have 3 numbers, roll, pitch and yaw'),
        ('tool0.rpy', [0, 0, NAN], f'tool0.rpy = nan: {TURN}'),
        ('tool0.confidence', 'sure', f"tool0.confidence = 'sure': {ONE}"),
        ('base.rpy', [True, 0, 0], f'base.rpy = True: {TURN}'),
        ('payload', 4, 'payload = 4: must be a dict'),
        ('mass', LOAD | {'value': -1}, f'mass.value = -1: {WEIGHT}'),
        ('payload', {'value': 4}, f'payload.confidence = None: {ONE}'),
        ('payload', LOAD | {'value': 0}, f'payload.value = 0: {WEIGHT}'),
        ('payload', LOAD | {'value': '4 kg'}, f"payload.value = '4 kg': {WEIGHT}"),
        ('limits.acceleration.max', [1.0, -2.0], f'limits.acceleration.max = -2.0: {LIMIT}'),
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
    with pytest.raises(InputError, match=f'^{re.escape(f"{path}: {text}")}$'):
        load_robot_model(str(path))


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'', 'the file = None: must be a mapping'),
        (b'- 1\n- 2\n', 'the file = [1, 2]: must be a mapping'),
        (b'name: [a', 'not YAML: line 2, column 1: did not find expected'),
        (b'name: \xff\xfe\n', 'not YAML: '),
        (b'name: 2026-99-99\n', 'joint_names is missing'),
        (b'name: "\x00"\n', 'not YAML: '),
        (b'name: !!python/object:os.system x\n', "line 1: 'tag:yaml.org,2002:python/object"),
    ],
)
def test_a_file_that_is_no_mapping_or_no_yaml_is_named(
    content: bytes, text: str, tmp_path: Path
) -> None:
    path = tmp_path / 'broken.yaml'
    path.write_bytes(content)
    with pytest.raises(InputError, match=f'^{re.escape(f"{path}: {text}")}'):
        load_robot_model(str(path))


def test_every_robot_file_is_a_model_of_its_own_name() -> None:
    paths = sorted(C3_FILE.parent.glob('*.yaml'))
    assert C3_FILE in paths
    assert robot_models() == tuple(path.stem for path in paths)
    assert [load_robot_model(path.stem).name for path in paths] == [path.stem for path in paths]


@pytest.mark.parametrize('name', robot_models())
def test_a_model_can_stand_at_zero_and_its_figures_fit_its_name(name: str) -> None:
    model = load_robot_model(name)
    limits = model.limits
    assert np.all(limits.position_min <= 0.0)
    assert np.all(limits.position_max >= 0.0)
    of_epson = re.fullmatch(r'([a-z]+)(\d+)_[ac](\d+)s', name)
    if of_epson is None:  # somebody's own
        return
    _, payload, size = of_epson.groups()
    np.testing.assert_allclose(limits.jerk, 10.0 * limits.acceleration, rtol=1e-9)
    assert name.replace('_', '-').upper() in model.description
    assert model.payload == int(payload)
    # the class, in dm for six axes up to the wrist and in cm for a SCARA's arms
    if model.kind == 'SCARA':
        assert model.reach[0] == pytest.approx(int(size[:-1]) / 100.0)
    else:
        wrist = model.reach[0] - model.reach[4]
        assert wrist == pytest.approx(int(size[:-2]) / 10.0, abs=0.11)
