# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The data of the robot models, and the errors of invalid model files."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from epson_driver.inputs import JOINT_NAMES, InputError, shown
from epson_driver.robots import load_robot_model, robot_models

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


def test_c3_has_the_documented_joints_and_ranges() -> None:
    model = load_robot_model('c3_a601s')
    assert model.name == 'c3_a601s'
    assert 'C3-A601S' in model.description
    assert model.joint_names == tuple(f'joint_{number}' for number in range(1, 7))
    low, high = np.deg2rad(np.array(RANGES, dtype=float)).T
    np.testing.assert_allclose(model.limits.position_min, low, rtol=1e-15)
    np.testing.assert_allclose(model.limits.position_max, high, rtol=1e-15)


@pytest.mark.invariant(2)
def test_inv2_c3_limits_do_not_exceed_the_documents() -> None:
    limits = load_robot_model('c3_a601s').limits
    documented = np.deg2rad(np.array(SPEEDS, dtype=float))
    assert np.all(limits.velocity <= documented)
    np.testing.assert_allclose(limits.velocity, documented, atol=0.01)
    np.testing.assert_array_equal(limits.acceleration, ACCELERATIONS)
    np.testing.assert_allclose(limits.jerk, 10.0 * limits.acceleration, rtol=1e-12)


def test_pulses_of_the_c3_match_its_ranges() -> None:
    model = load_robot_model('c3_a601s')
    ends = np.array(RANGES, dtype=float) * model.pulses_per_degree[:, None]
    np.testing.assert_allclose(ends, PULSES, atol=1.5)
    gears = model.pulses_per_degree * 360.0 / 2**17
    np.testing.assert_allclose(gears, [80, 80, 70, 2400 / 37, 2400 / 37, 50], rtol=1e-5)


def test_c3_has_a_source_and_mark_per_joint() -> None:
    model = load_robot_model('c3_a601s')
    per_joint = ['range', 'speed', 'acceleration', 'pulses']
    assert [item for item in model.provenance if item not in per_joint] == [
        *('jerk', 'origins', 'tool0', 'world', 'payload', 'mass')
    ]
    for quantity, origin in model.provenance.items():
        assert origin.source
        assert len(origin.marks) == (6 if quantity in per_joint else 1)
    assert model.provenance['range'].marks == ('confirmed',) * 6
    assert model.provenance['speed'].marks[3:5] == ('one source', 'one source')
    assert model.provenance['speed'].worst == 'one source'
    assert set(model.provenance['acceleration'].marks) == {'estimated'}


def test_estimated_ranges_speeds_and_lengths_are_cautions() -> None:
    assert load_robot_model('gx8_c552s').cautions == ()
    assert load_robot_model('c3_a601s').cautions == ()  # estimated accelerations are common
    speeds, heights = load_robot_model('t6_602s').cautions
    assert speeds.startswith('speeds of the t6_602s are estimated (joints 1 and 2 from an unconf')
    assert speeds.endswith('): compare them with yours before the arm moves')
    assert heights.startswith('heights of the t6_602s are estimated (')


@pytest.mark.parametrize('name', robot_models())
def test_every_model_has_sources(name: str) -> None:
    for origin in load_robot_model(name).provenance.values():
        assert 'without a source' not in origin.source
        assert len(origin.source) > 3


def test_chain_of_the_c3_equals_the_documents() -> None:
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


def test_pulses_and_reach_have_the_unit_of_the_joint() -> None:
    model = load_robot_model('gx4_c251s')
    assert model.kind == 'SCARA'
    assert model.limits.units == ('rad', 'rad', 'm', 'rad')
    assert model.shown_per_unit.tolist() == pytest.approx([57.29577951] * 2 + [1e3, 57.29577951])
    # EPSON's pulse ranges: 280 degrees of joint 1, 150 mm of joint 3, 360 degrees of joint 4
    ranges = model.pulses_per_unit * [np.radians(280.0), 1.0, 0.15, 2.0 * np.pi]
    assert ranges[[0, 2, 3]].tolist() == pytest.approx([8155592, 1706667, 1494221], rel=1e-5)
    # arms of 124 and 126 mm. Joint 3 moves the tool by 1 m per m, and joint 4 only turns it.
    assert model.reach.tolist() == pytest.approx([0.25, 0.126, 1.0, 0.0], abs=1e-12)


@pytest.mark.parametrize('name', ['c5_a901s', 'C9-B1401', '', '../c3', 'c3_a601s\0'])
def test_unknown_model_error_refers_to_the_list(name: str) -> None:
    with pytest.raises(InputError, match=r'^no robot model .*`epson_driver robots` lists'):
        load_robot_model(name)


@pytest.mark.parametrize(
    ('name', 'meant'),
    [
        *((name, 'c4_a601s') for name in ('C4-A601S', 'C4_A601S', 'c4-a601s', 'C4-A6', 'c4a601')),
        ('GX8-C452', 'gx8_c452s'),
        ('gx8 c452sr', 'gx8_c452sr'),
        ('T6-602', 't6_602s'),
        ('vt6', 'vt6_a901s'),
        ('VT6L', 'vt6_a901s'),
        ('C4L', 'c4_a901s'),
        ('C4', 'c4_a601s'),
        ('T6', 't6_602s'),
        ('GX4-C351S-L', 'gx4_c351s_l'),
        ('LS20-BA04S', 'ls20_ba04s'),
    ],
)
def test_model_name_can_be_abbreviated(name: str, meant: str) -> None:
    assert load_robot_model(name).name == meant


@pytest.mark.parametrize(
    ('name', 'near'),
    [
        ('RS6', 'rs6_c552c or rs6_c552s'),
        ('C8', 'c8_a1401s or c8_a701s or c8_a901s or c8_c1401c or c8_c1401cr or c8_c1401s or …'),
        ('C4-A601SR', 'cx4_a601sr or c4_a601s'),
        ('t6_620s', 't6_602s'),
        ('lsx6', 'ls6_'),
        ('C8XL', 'c8_a1401s or c8_c1401s?'),
    ],
)
def test_ambiguous_or_wrong_name_suggests_models(name: str, near: str) -> None:
    with pytest.raises(InputError) as error:
        load_robot_model(name)
    assert f'; did you mean {near}' in str(error.value)


@pytest.mark.parametrize(
    ('name', 'missing'),
    [
        ('G10-651S', 'of the G10, speeds of joints 1 and 2 are not known'),
        ('g1-171s', 'of the G1, speeds of joints 1 and 2, and the range of joint 2 are not known'),
        ('GX20-B851', 'of the GX20, ranges of joints 1 and 2, and speeds are not known'),
        ('N6', 'of the N6, speeds are not known'),
        ('LS10-B602S', 'of the LS10, lengths, ranges and speeds are not known'),
    ],
)
def test_unsupported_arm_error_lists_missing_data(name: str, missing: str) -> None:
    with pytest.raises(InputError) as error:
        load_robot_model(name)
    assert missing in str(error.value)
    assert 'docs/new_robot.md' in str(error.value)


def test_missing_model_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'mine\.yaml: No such file'):
        load_robot_model(str(tmp_path / 'mine.yaml'))


@pytest.fixture
def data() -> dict[str, Any]:
    """A model of two joints as a mapping, which tests modify."""
    return {
        'name': 'mine',
        'joint_names': ['a', 'b'],
        'origins_mm': [[0, 0, 100], [300, 400, 0]],
        'axes': [[0, 0, 1], [0, 0.6, 0.8]],
        'range_deg': [[-60, 60], [-150, 150.5]],
        'speed_deg_s': [60.0, 90],
        'acceleration_rad_s2': [10, 20.0],
        'pulses_per_deg': [100.0, None],
        'tool0_mm': [0, 0, 200],
        'tool0_deg': [0, 0, 0],
        'world_mm': [0, 0, 50],
        'world_deg': [0, 0, 90],
        'sources': {'speed': [['estimated', 'confirmed'], 's'], 'world': ['derived', 't']},
    }


def write(data: object, folder: Path) -> Path:
    path = folder / 'model.yaml'
    path.write_text(yaml.safe_dump(data, allow_unicode=True, sort_keys=False), encoding='utf-8')
    return path


def test_model_is_read_from_a_file(data: dict[str, Any], tmp_path: Path) -> None:
    model = load_robot_model(str(write(data, tmp_path)))
    assert model.joint_names == ('a', 'b')
    assert np.degrees(model.limits.position_min).tolist() == pytest.approx([-60.0, -150.0])
    assert np.degrees(model.limits.velocity).tolist() == pytest.approx([60.0, 90.0])
    assert model.limits.jerk.tolist() == [100.0, 200.0]
    assert model.pulses_per_degree[0] == 100.0
    assert np.isnan(model.pulses_per_degree[1])
    # 0.12 m of the tool's 0.2 m are perpendicular to joint 2's axis
    along = 0.8 * 0.2
    assert model.reach.tolist() == pytest.approx(
        [float(np.hypot(0.3, 0.4 + 0.6 * along)) + 0.12, 0.12]
    )
    assert model.kind == '2 joints'
    assert model.base.xyz.tolist() == [0.0, 0.0, 0.05]
    assert model.payload is None
    assert 'payload' not in model.provenance
    assert model.provenance['speed'].marks == ('estimated', 'confirmed')
    assert model.provenance['range'].source == 'model.yaml, without a source'


def test_model_file_can_extend_a_model(tmp_path: Path) -> None:
    path = write(
        {
            'name': 'mine',
            'like': 'T6-602S',
            'speed_deg_mm_s': [200, 300, 900, 1700],
            'sources': {'payload': ['confirmed', 'label on the arm']},
        },
        tmp_path,
    )
    mine, t6 = load_robot_model(str(path)), load_robot_model('t6_602s')
    assert (mine.name, mine.kind, mine.payload) == ('mine', 'SCARA', t6.payload)
    assert mine.limits.velocity.tolist() == pytest.approx(
        [*np.radians([200.0, 300.0]), 0.9, np.radians(1700.0)]
    )
    assert mine.provenance['speed'].source == 'model.yaml, without a source'
    assert mine.provenance['payload'].source == 'label on the arm'
    assert mine.provenance['range'] == t6.provenance['range']
    assert np.all(mine.chain.origins == t6.chain.origins)


MISSING = [
    *('name', 'origins_mm', 'axes', 'range_deg', 'speed_deg_s', 'acceleration_rad_s2'),
    *('tool0_mm', 'tool0_deg', 'world_mm', 'world_deg'),
]


@pytest.mark.parametrize('key', MISSING)
def test_missing_key_is_named(key: str, data: dict[str, Any], tmp_path: Path) -> None:
    del data[key]
    path = write(data, tmp_path)
    with pytest.raises(InputError) as error:
        load_robot_model(str(path))
    assert str(error.value) == f'{path}: {key} is missing'


NAN = float('nan')
REACHED = 'must be a number from -60000 to 60000 degrees or mm'
SPEED = 'must be a number from 0.001 to 1e+07 degrees/s or mm/s'
LIMIT = 'must be a number from 1e-06 to 1e+06 in its unit'
LENGTH = 'must be a number from -100000 to 100000 mm'
TURN = 'must be a number from -600 to 600 degrees'
AXIS = 'must be a number from -1 to 1'
ENCODER = 'must be a number from -1e+09 to 1e+09 pulses'
WEIGHT = 'must be a number from 0.001 to 100000 kg'
NAMES = JOINT_NAMES.text
MARK = 'must be [MARK, source], with one of confirmed, one source, derived, estimated'
TYPES = 'must be a list of one per joint, each of revolute, prismatic'
TWO = 'must have 2 numbers, the lowest and the highest'


@pytest.mark.parametrize(
    ('key', 'value', 'text'),
    [
        ('name', 7, ' = 7: must be a str'),
        ('joint_names', 'a b', " = 'a b': must be a list"),
        ('joint_names', ['a'], " = ['a']: must have 2 names, one per joint"),
        ('joint_names', ['a', 2], f" = ['a', 2]: {NAMES}"),
        ('joint_names', ['a', 'a'], f" = ['a', 'a']: {NAMES}"),
        ('joint_names', ['a', 'b.c'], f" = ['a', 'b.c']: {NAMES}"),
        ('joint_types', ['revolute'], f" = ['revolute']: {TYPES}"),
        ('joint_types', ['revolute', None], f" = ['revolute', None]: {TYPES}"),
        ('speed_deg_s', 5.0, ' = 5.0: must be a list'),
        ('speed_deg_s', [1.0], ' = [1.0]: must have 2 numbers, one per joint'),
        ('speed_deg_s', [1.0, 'fast'], f" = 'fast': {SPEED}"),
        ('speed_deg_s', [True, 2.0], f' = True: {SPEED}'),
        ('speed_deg_s', [None, 2.0], f' = None: {SPEED}'),
        ('speed_deg_s', [1.0, NAN], f' = nan: {SPEED}'),
        ('speed_deg_s', [1.0, 10**400], f' = {shown(10**400)}: {SPEED}'),
        ('acceleration_rad_s2', [1.0, -2.0], f' = -2.0: {LIMIT}'),
        ('jerk_rad_s3', [1.0, 1e300], f' = 1e+300: {LIMIT}'),
        ('range_deg', [[-1, 1]], ' = [[-1, 1]]: must have 2 lists, one per joint'),
        ('range_deg', [[-1, 1], 3], f' = 3: {TWO}'),
        ('range_deg', [[-1, 1], [1]], f' = [1]: {TWO}'),
        ('range_deg', [[-1, 1], [0, 1e300]], f' = 1e+300: {REACHED}'),
        (
            'range_deg',
            [[60, -60], [0, 1]],
            ' = [[60.0, -60.0], [0.0, 1.0]]: 60 … -60 of a must be a range from low to high',
        ),
        (
            'range_deg',
            [[-1, 1], [10, 90]],
            ' = [[-1.0, 1.0], [10.0, 90.0]]: 0 is outside 10 … 90 of b: zero_outside: '
            'true if correct',
        ),
        ('pulses_per_deg', [1.0, NAN], f' = nan: {ENCODER}'),
        ('pulses_per_deg', [1.0, 0], ' = [1.0, 0.0]: must be at least 0.001'),
        ('origins_mm', [[0, 0, 1], [0, 1]], ' = [0, 1]: must have 3 numbers, x and y and z'),
        ('origins_mm', [[0, 0, 1], [0, NAN, 0]], f' = nan: {LENGTH}'),
        ('axes', [[0, 0, 1], [0, 'y', 0]], f" = 'y': {AXIS}"),
        ('axes', [[0, 0, 1], [0, 1, 0.001]], ' = [0.0, 1.0, 0.001]: must have length 1'),
        ('tool0_mm', [0, 0], ' = [0, 0]: must have 3 numbers, x, y and z'),
        ('tool0_deg', [0, 0], ' = [0, 0]: must have 3 numbers, roll, pitch and yaw'),
        ('world_deg', [True, 0, 0], f' = True: {TURN}'),
        ('payload_kg', '4 kg', f" = '4 kg': {WEIGHT}"),
        ('mass_kg', -1, f' = -1: {WEIGHT}'),
        ('speed', [1, 2], ': unit missing or wrong: must be speed_deg_s'),
        ('range_deg_mm', [1, 2], ': unit missing or wrong: must be range_deg'),
        ('tool0', [1, 2], ': unit missing or wrong: must be tool0_mm or tool0_deg'),
        ('pay_load_kg', 3, ': unknown key; did you mean payload_kg?'),
        (
            'range_deg',
            [[-3, 3.5], [-6, 6]],
            ' = [[-3.0, 3.5], [-6.0, 6.0]]: no joint turns by more than 12 degrees: '
            'are these radians?',
        ),
        (
            'origins_mm',
            [[0, 0, 0.4], [0, 0.3, 0]],
            ' = [[0.0, 0.0, 0.4], [0.0, 0.3, 0.0]]: the whole arm is 0.7 mm long: '
            'are these metres?',
        ),
        ('max_speed', 3, ': unknown key; known are name, '),
        ('models', {}, ': unknown key; '),
        ('zero_outside', 'yes', " = 'yes': must be a bool"),
        ('like', 'mine.yaml', " = 'mine.yaml': must be the name of a model"),
        ('like', 'T6-699S', " = 'T6-699S': no robot model T6-699S; did you mean t6_602s"),
        ('sources', [1], ' = [1]: must be a dict'),
        ('sources', {'speed': 'mine'}, f".speed = 'mine': {MARK} (or a list of one per joint)"),
        ('sources', {'world': ['sure', 's']}, f".world = ['sure', 's']: {MARK}"),
        ('sources', {'speeds': ['derived', 's']}, '.speeds: must be one of range, speed, '),
    ],
    ids=lambda x: x[:60] if isinstance(x, str) else '',
)
def test_invalid_value_is_reported_with_file_line_and_key(
    key: str, value: object, text: str, data: dict[str, Any], tmp_path: Path
) -> None:
    data[key] = value
    path = write(data, tmp_path)
    lines = path.read_text('utf-8').splitlines()
    wanted = text.partition(' ')[0].strip(':.')
    inside = f'  {wanted}:' if text.startswith('.') else f'{key}:'
    line = 1 + next(number for number, item in enumerate(lines) if item.startswith(inside))
    with pytest.raises(InputError) as error:
        load_robot_model(str(path))
    assert str(error.value).startswith(f'{path}, line {line}: {key}{text}')


def test_zero_outside_option_allows_ranges_without_zero(
    data: dict[str, Any], tmp_path: Path
) -> None:
    data |= {'range_deg': [[10, 90], [-1, 1]], 'zero_outside': True}
    model = load_robot_model(str(write(data, tmp_path)))
    assert np.degrees(model.limits.position_min[0]) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'', 'the file = None: must be a mapping'),
        (b'- 1\n- 2\n', 'the file = [1, 2]: must be a mapping'),
        (b'name: [a', 'not YAML: line 2, column 1: did not find expected'),
        (b'name: \xff\xfe\n', 'not YAML: '),
        (b'name: 2026-99-99\n', 'origins_mm is missing'),
        (b'name: "\x00"\n', 'not YAML: '),
        (b'name: !!python/object:os.system x\n', "line 1: 'tag:yaml.org,2002:python/object"),
    ],
)
def test_file_that_is_no_mapping_is_refused(content: bytes, text: str, tmp_path: Path) -> None:
    path = tmp_path / 'broken.yaml'
    path.write_bytes(content)
    with pytest.raises(InputError, match=f'^{re.escape(f"{path}: {text}")}'):
        load_robot_model(str(path))


@pytest.mark.parametrize('name', robot_models())
def test_model_matches_its_name_and_its_ranges_contain_zero(name: str) -> None:
    model = load_robot_model(name)
    limits = model.limits
    assert np.all(limits.position_min <= 0.0)
    assert np.all(limits.position_max >= 0.0)
    written = name.replace('_', '-').upper()
    assert f'EPSON {written}, ' in model.description
    load, size = re.fullmatch(
        r'[A-Z]+(\d+)-(?:B(?=A)|[ABC](?=\d{3}))?([A\d]\d+)[SC].*', written
    ).groups()
    assert int(model.payload) == int(load)
    # the size class: in dm up to the wrist for six axes, in cm for a SCARA
    if model.kind == 'SCARA':
        assert model.reach[0] == pytest.approx(int(size[:-1].replace('A', '10')) / 100.0)
    else:
        wrist = model.reach[0] - model.reach[4]
        assert wrist == pytest.approx(int(size[:-2]) / 10.0, abs=0.11)
