# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver smooth`: the output file, the report, the picture, and errors."""

import sys

import numpy as np
import pytest

from epson_driver.cli import smooth
from epson_driver.motion import Trajectory, problems
from epson_driver.motion.closest_samples import passed
from epson_driver.report.smooth_study import measure, point_to_point, spline
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

FILE = share_path('config', 'trajectories', 'around_pillar_fast_100ms.yaml')
BARE = share_path('config', 'trajectories', 'around_pillar_positions_only.yaml')
LIMITS = load_robot_model('c3_a601s').limits
PLAN = read_trajectory(FILE)


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Return a function that runs the command in an empty folder.

    It returns exit code, stdout and stderr.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '120')

    def call(*arguments):
        monkeypatch.setattr(sys, 'argv', ['smooth', *map(str, arguments)])
        try:
            code = smooth.main()
        except SystemExit as end:
            code = end.code
        return (code, *capsys.readouterr())

    return call


@pytest.fixture
def without_times(tmp_path):
    """Return a file like the plan, without any time."""
    lines = BARE.read_text(encoding='utf-8').splitlines(keepends=True)
    path = tmp_path / 'bare.yaml'
    path.write_text(''.join(line for line in lines if 'time_from_start' not in line), 'utf-8')
    return path


@pytest.mark.slow
def test_time_optimal_motion_is_slower_with_keep_spline(run, tmp_path):
    motions = {}
    for name, more in (('fast', []), ('spline', ['--keep-spline'])):
        output = tmp_path / f'{name}.yaml'
        assert run(FILE, '--mode', 'time_optimal', '--output', output, *more)[0] == 0
        motions[name] = read_trajectory(output)
        assert passed(PLAN.positions, motions[name])[0].max() < 1e-5
    assert motions['fast'].times[-1] < 0.98 * motions['spline'].times[-1]


def test_smooth_motion_and_picture_are_written(run, tmp_path):
    code, text, _ = run(FILE)
    assert code == 0
    for word in (
        'duration',
        'point to point',
        'intermediate stops',
        'highest jerk',
        'waypoint error',
    ):
        assert word in text
    motion = read_trajectory(tmp_path / f'{FILE.stem}_smooth.yaml')
    assert np.diff(motion.times) == pytest.approx(0.004)
    assert list(problems(motion, LIMITS)) == []
    assert np.array_equal(motion.positions[[0, -1]], PLAN.positions[[0, -1]])
    assert passed(PLAN.positions, motion)[0].max() < 1e-5
    figures = measure(motion, PLAN, LIMITS)
    assert figures.stops == 0
    assert max(figures.velocity, figures.acceleration) <= 1.0
    assert figures.jerk <= 1.02
    assert (tmp_path / f'{FILE.stem}_smooth.png').read_bytes().startswith(b'\x89PNG')


def test_plan_without_times_needs_time_optimal_mode(run, without_times):
    code, text, _ = run(without_times, '--mode', 'time_optimal')
    assert code == 0
    assert 'the plan has no times' in text
    code, _, error = run(without_times)
    assert code == 2
    assert 'no point has a time: add time_from_start, or use --mode time_optimal' in error


def test_invalid_plans_and_options_are_rejected_with_a_reason(run, tmp_path):
    text = FILE.read_text(encoding='utf-8')

    def refusal(*options, **changes):
        path = tmp_path / 'wrong.yaml'
        wrong = text
        for before, after in changes.get('replace', ()):
            assert before in wrong
            wrong = wrong.replace(before, after)
        path.write_text(wrong, encoding='utf-8')
        code, _, error = run(path, *options)
        assert code == 2
        assert len(list(tmp_path.iterdir())) == 1
        return error

    assert 'rename them, or select another robot' in refusal(replace=[('joint_6', 'tool')])
    error = refusal(replace=[('[-1.0, -0.55', '[-3.5, -0.55')])
    assert 'point 0, joint_1: position -3.5 rad is outside the limits -2.96706 … 2.96706' in error
    assert 'times must strictly increase' in refusal(
        replace=[('{sec: 0, nanosec: 300000000}', '{sec: 0, nanosec: 100000000}')]
    )
    assert 'not YAML' in refusal(replace=[('points:', '{')])
    assert 'points is missing' in refusal(replace=[('points:', 'rows:')])
    assert 'must be a number from 0.01 to inf s' in refusal('--look-ahead', '0')
    assert 'must be a number from 1 to 1000 Hz' in refusal('--rate', '5000')
    assert 'must be a number from 0 to 0.5 rad' in refusal('--path-tolerance', '0.6')
    assert 'no_robot' in refusal('--robot', 'no_robot')


# --- the motions of the comparison ------------------------------------------------------------


def test_point_to_point_stops_at_every_point_within_limits():
    motion, at = point_to_point(PLAN, LIMITS)
    figures = measure(motion, None, LIMITS)
    assert figures.stops >= len(PLAN.times) - 3  # the shortest can be within one sample
    assert max(figures.velocity, figures.acceleration, figures.jerk) <= 1.0 + 1e-6
    for time, point in zip(at, PLAN.positions, strict=True):
        nearest = int(np.argmin(np.abs(motion.times - time)))
        assert np.abs(motion.positions[nearest] - point).max() < 2e-3


@pytest.mark.parametrize('accelerations', [True, False])
def test_spline_keeps_times_and_velocities_of_the_plan(accelerations):
    plan = Trajectory(
        PLAN.joint_names,
        PLAN.times,
        PLAN.positions,
        PLAN.velocities,
        PLAN.accelerations if accelerations else None,
    )
    motion, at = spline(plan)
    assert np.array_equal(at, plan.times)
    for time, point, velocity in zip(at[:-1], plan.positions, plan.velocities, strict=False):
        sample = round(time * 1000)
        assert motion.positions[sample] == pytest.approx(point, abs=1e-6)
        assert motion.velocities[sample] == pytest.approx(velocity, abs=1e-6)
    numeric = np.gradient(motion.positions, 0.001, axis=0)[5:-5]
    assert np.abs(numeric - motion.velocities[5:-5]).max() < 0.05
    assert measure(motion, None, LIMITS).jerk > 2.0  # the reason for the comparison


@pytest.mark.slow
def test_planned_stops_have_a_separate_count(run, tmp_path):
    """The plan moves forth, rests and moves back."""
    points = [
        f'- positions: [{value}, 0, 0, 0, 0, 0]\n'
        f'  velocities: [0, 0, 0, 0, 0, 0]\n  time_from_start: {seconds}\n'
        for value, seconds in ((0.0, 0.0), (0.5, 2.0), (0.5, 3.0), (0.0, 5.0))
    ]
    path = tmp_path / 'and_back.yaml'
    path.write_text(f'joint_names: {list(LIMITS.names)}\npoints:\n{"".join(points)}')
    code, text, _ = run(path)
    assert code == 0
    assert '0, and 1 in the plan' in ' '.join(text.split())


def test_picture_without_matplotlib_is_refused(run, monkeypatch, tmp_path):
    monkeypatch.setattr(smooth, 'find_spec', lambda _: None)
    code, _, error = run(FILE, '--picture', 'x.png')
    assert code == 2
    assert "--picture: none, as matplotlib is missing: pip install 'epson_driver[report]'" in error
    assert not list(tmp_path.iterdir())


def test_failed_smoothing_leaves_no_file(run, monkeypatch, tmp_path):
    def fails(*_, **__):
        raise ValueError('point 3 cannot be passed')

    monkeypatch.setattr(smooth, 'smooth', fails)
    result, _, output = run(FILE)
    assert result == 2
    assert f'error: {FILE}: point 3 cannot be passed' in output
    assert not list(tmp_path.iterdir())
