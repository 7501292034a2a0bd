# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reading of trajectory files, and their errors with file and key."""

import numpy as np
import pytest

from epson_driver.cli.arguments import DEFAULT_MODEL
from epson_driver.cli.demo import TRAJECTORY, TRAJECTORY_OF_SCARAS
from epson_driver.inputs import InputError
from epson_driver.motion import problems
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.model import SCARA, SIX_AXIS
from epson_driver.share import share_path
from epson_driver.trajectory_file import (
    read_trajectory,
    write_trajectory,
)

FOLDER = share_path('config', 'trajectories', 'around_pillar_11_points.yaml').parent
FILES = sorted(FOLDER.glob('*.yaml'))
MODELS = [load_robot_model(name) for name in robot_models()]

GOOD = """
joint_names: [a, b]
points:
- positions: [0.0, 1.0]
  velocities: [0.5, -0.5]
  time_from_start: {sec: 0, nanosec: 0}
- positions: [0.1, 1.25]
  velocities: [0.0, 0.0]
  time_from_start: {sec: 1, nanosec: 250000000}
"""


def written(folder, text):
    path = folder / 'plan.yaml'
    path.write_text(text, encoding='utf-8')
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_trajectory(path)
    return str(caught.value)


def test_repository_has_trajectories():
    assert len(FILES) >= 5


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_trajectory_of_the_repository_can_be_executed(path):
    trajectory = read_trajectory(path)
    assert trajectory.duration > 0.0
    kind = SCARA if path == TRAJECTORY_OF_SCARAS else SIX_AXIS
    of_all = path in (TRAJECTORY, TRAJECTORY_OF_SCARAS)
    for model in MODELS:
        if model.kind != kind or not (of_all or model.name == DEFAULT_MODEL):
            continue
        limits = model.limits
        assert set(trajectory.joint_names) == set(limits.names)
        assert list(problems(trajectory.in_order(limits.names), limits)) == []


def test_numbers_are_read_exactly(tmp_path):
    trajectory = read_trajectory(written(tmp_path, GOOD))
    assert trajectory.joint_names == ('a', 'b')
    assert trajectory.times.tolist() == [0.0, 1.25]
    assert trajectory.positions.tolist() == [[0.0, 1.0], [0.1, 1.25]]
    assert trajectory.velocities.tolist() == [[0.5, -0.5], [0.0, 0.0]]
    assert trajectory.accelerations is None
    assert trajectory.positions.dtype == np.float64


def test_written_trajectory_is_read_back(tmp_path):
    given = read_trajectory(written(tmp_path, GOOD))
    path = tmp_path / 'again.yaml'
    write_trajectory(path, given, 'a comment')
    assert path.read_text(encoding='utf-8').startswith('# a comment\n')
    again = read_trajectory(path)
    assert again.joint_names == given.joint_names
    assert again.times.tolist() == given.times.tolist()
    assert again.positions.tolist() == given.positions.tolist()
    assert again.velocities.tolist() == given.velocities.tolist()
    assert again.accelerations is None


def test_times_are_optional_on_request(tmp_path):
    text = GOOD.replace('  time_from_start: {sec: 0, nanosec: 0}\n', '')
    assert read_trajectory(written(tmp_path, text), timed=False).times.tolist() == [0.0, 1.25]
    refusal(written(tmp_path, text))


def test_other_fields_of_the_message_are_ignored(tmp_path):
    text = 'header: {stamp: {sec: 1, nanosec: 2}, frame_id: base}\n' + GOOD
    assert read_trajectory(written(tmp_path, text)).duration == 1.25


def test_output_of_ros2_topic_echo_is_read(tmp_path):
    assert read_trajectory(written(tmp_path, GOOD + '---\n')).duration == 1.25


def test_missing_trajectory_file_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r'missing\.yaml: No such file'):
        read_trajectory(tmp_path / 'missing.yaml')


@pytest.mark.parametrize(
    ('before', 'after', 'words'),
    [
        ('joint_names: [a, b]', '', ['joint_names']),
        ('points:', 'waypoints:', ['points']),
        ('  time_from_start: {sec: 0, nanosec: 0}\n', '', ['time_from_start']),
        ('{sec: 0, nanosec: 0}', '{sec: 0}', ['nanosec']),
        ('- positions: [0.0, 1.0]\n  vel', '- vel', ['positions']),
        ('velocities: [0.0, 0.0]', 'effort: []', ['velocities']),
        ('[0.1, 1.25]', '[0.1]', ['point 1', '1 positions', '2 joints']),
        ('velocities: [0.0, 0.0]', 'velocities: [0.0]', ['point 1', '1 velocities', '2 joints']),
        ('[0.1, 1.25]', '[0.1, here]', []),
        ('sec: 1', 'sec: soon', []),
        ('[0.1, 1.25]', '[0.1, []]', []),
    ],
)
def test_invalid_trajectory_is_reported_with_the_file(tmp_path, before, after, words):
    assert before in GOOD
    path = written(tmp_path, GOOD.replace(before, after))
    text = refusal(path)
    assert all(word in text for word in (str(path), *words))


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'[]', ''),
        (b'', ''),
        (b'42', ''),
        (b'points: 3', ''),
        (b'joint_names: 1\npoints: [1]', ''),
        (b'joint_names: [a]\npoints: []\n', ': points is empty'),
        (b'{', 'not YAML'),
        (b'a: b: c', 'not YAML'),
        (b'\t- x', 'not YAML'),
        (b'joint_names: [', 'not YAML'),
        (b'\xff\xfe\x00joint_names', ''),
    ],
)
def test_file_without_a_trajectory_is_reported(tmp_path, content, text):
    path = tmp_path / 'plan.yaml'
    path.write_bytes(content)
    assert str(path) in refusal(path)
    assert text in refusal(path)


def test_time_can_be_a_number_of_seconds(tmp_path):
    text = GOOD.replace('{sec: 1, nanosec: 250000000}', '2.5')
    assert read_trajectory(written(tmp_path, text)).times.tolist() == [0.0, 2.5]
    for bad in ('-1.0', 'soon', '[1]', '.inf'):
        with pytest.raises(InputError, match=r'point 1\.time_from_start'):
            read_trajectory(written(tmp_path, text.replace('2.5', bad)))


@pytest.mark.parametrize('text', ['', '# nothing\n', '---\n'])
def test_empty_file_error_describes_the_format(tmp_path, text):
    with pytest.raises(InputError, match=r'is empty: must have joint_names: .*time_from_start'):
        read_trajectory(written(tmp_path, text))


@pytest.mark.parametrize('points', ['3', '{a: 1}', 'none'])
def test_points_must_be_a_list(tmp_path, points):
    path = written(tmp_path, f'joint_names: [a]\npoints: {points}\n')
    assert refusal(path).startswith(f'{path}: points = ')
    assert refusal(path).endswith(': must be a list')
