# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The demo's measurements and picture of a run."""

from itertools import pairwise

import numpy as np
import pytest
from support.recorded_run import START, usual_run

from epson_driver.demo import picture
from epson_driver.demo.picture import MAX_READS, Drawn, draw, recorded_run
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.report.measure import MAX_DEVIATION_RAD, Recording, measure
from epson_driver.robots import load_robot_model

NAMES = ('a', 'b')
PERIOD = 0.005


def smooth_step(share):
    """Return a motion from rest to rest, 0 … 1 over the fraction `share` of its time."""
    return share - np.sin(2 * np.pi * share) / (2 * np.pi)


def plan(waypoints, step=1.0):
    positions = np.array(waypoints, dtype=float)
    return Trajectory(NAMES, np.arange(len(positions)) * step, positions)


def recording(positions, period=PERIOD, begin=1000.0):
    positions = np.array(positions, dtype=float)
    times = begin + np.arange(len(positions)) * period
    return Recording(times, positions, np.gradient(positions, period, axis=0))


def still(at, seconds):
    return [at] * round(seconds / PERIOD)


def line(start, end, seconds, profile=lambda share: share):
    share = profile(np.arange(round(seconds / PERIOD)) / round(seconds / PERIOD))
    start, end = np.array(start), np.array(end)
    return list(start + share[:, None] * (end - start))


WAYPOINTS = [(0.0, 0.0), (0.5, 0.2), (1.0, 0.4), (1.5, 0.6), (2.0, 0.8)]


def ptp(rest=0.0):
    """Return a run that stops at every waypoint for `rest` s."""
    positions = still(WAYPOINTS[0], 0.5)
    for start, end in pairwise(WAYPOINTS):
        positions += line(start, end, 1.0, smooth_step)
        positions += still(end, rest)
    return recording(positions + still(WAYPOINTS[-1], 0.5))


def through():
    """Return a run through the waypoints without a stop."""
    return recording(
        still(WAYPOINTS[0], 0.5)
        + line(WAYPOINTS[0], WAYPOINTS[-1], 4.0, smooth_step)
        + still(WAYPOINTS[-1], 0.5)
    )


@pytest.mark.parametrize('rest', [0.0, 0.1, 0.5])
def test_stop_at_every_waypoint_is_counted(rest):
    assert measure(plan(WAYPOINTS), ptp(rest)).stops == 3


def test_planned_stops_do_not_count_as_stops_of_the_run():
    times = np.arange(5.0)
    moving, still = np.full(2, 0.5), np.zeros(2)
    velocities = np.array([still, moving, still, moving, still])
    resting = Trajectory(NAMES, times, np.array(WAYPOINTS), velocities)
    figures = measure(resting, ptp())
    assert (figures.stops, figures.commanded_stops) == (2, 1)
    assert measure(resting, through()).stops == 0
    waiting = plan([*WAYPOINTS[:3], *WAYPOINTS[2:]])
    assert measure(waiting, ptp(0.5)).commanded_stops == 1


def test_late_joint_state_does_not_count_as_a_stop():
    run = through()
    positions = run.positions.copy()
    positions[400:402] = positions[399]  # no new position for 15 ms of the motion
    assert measure(plan(WAYPOINTS), recording(positions)).stops == 0


def test_planned_and_measured_durations_of_a_run_are_found():
    figures = measure(plan(WAYPOINTS), through())
    assert figures.planned == 4.0
    assert figures.moved == pytest.approx(4.0, abs=0.5)  # its ends are slower than the threshold
    assert figures.start == pytest.approx(1000.5, abs=0.3)
    constant = recording(
        still((0, 0), 0.5) + line((0.0, 0.0), (1.0, 0.0), 2.0) + still((1, 0), 0.5)
    )
    figures = measure(plan([(0.0, 0.0), (1.0, 0.0)], 1.5), constant)
    assert figures.planned == 1.5
    assert figures.moved == pytest.approx(2.0, abs=3 * PERIOD)
    assert figures.start == pytest.approx(1000.5, abs=3 * PERIOD)


def test_rate_and_longest_gap_are_measured():
    positions = line((0.0, 0.0), (1.0, 0.0), 2.0)
    run = recording(positions)
    figures = measure(plan([(0.0, 0.0), (1.0, 0.0)]), run)
    assert figures.rate == pytest.approx(1 / PERIOD)
    assert figures.longest_gap == pytest.approx(PERIOD)
    later = run.times + 0.1 * (np.arange(len(run.times)) >= 200)
    figures = measure(
        plan([(0.0, 0.0), (1.0, 0.0)]), Recording(later, run.positions, run.velocities)
    )
    assert figures.longest_gap == pytest.approx(0.1 + PERIOD)
    assert figures.rate == pytest.approx(399 / (399 * PERIOD + 0.1))


@pytest.mark.parametrize('deviation', [0.005, 0.03, 0.1])
def test_deviation_at_a_missed_waypoint_is_measured(deviation):
    shifted = [WAYPOINTS[0], WAYPOINTS[1], (1.0, 0.4 + deviation), *WAYPOINTS[3:]]
    figures = measure(plan(shifted), ptp())
    # the nearest place on the line: joint a gives as much as joint b is missing
    assert deviation * 0.6 < figures.waypoint_deviation < deviation * 1.05
    assert (figures.waypoint_deviation <= MAX_DEVIATION_RAD) == (deviation < 0.02)


def test_waypoints_of_a_self_crossing_path_are_matched_in_order():
    back_and_forth = [(0.0, 0.0), (1.0, 0.0), (0.0, 0.0), (1.0, 0.0)]
    positions = still((0.0, 0.0), 0.2)
    for start, end in pairwise(back_and_forth):
        positions += line(start, end, 1.0, smooth_step)
    run = recording(positions + still((1.0, 0.0), 0.2))
    figures = measure(plan(back_and_forth), run)
    assert figures.waypoint_deviation < 1e-3
    assert np.all(np.diff(figures.waypoint_times) > 0.5)
    assert figures.stops == 2


def test_plot_of_a_run_is_written(tmp_path):
    pytest.importorskip('matplotlib')
    run = ptp()
    path = tmp_path / 'report.png'
    drawn = [Drawn('ptp', run, measure(plan(WAYPOINTS), run))]
    limits = JointLimits(NAMES, *np.outer([-9.0, 9.0, 1.0, 1.0, 1.0], np.ones(2)))
    for runs in (drawn, drawn * 2):
        path.unlink(missing_ok=True)
        draw(path, plan(WAYPOINTS), runs, limits)
        assert path.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('until', 'reads'), [(3.9, 3), pytest.param(9.0, MAX_READS, marks=pytest.mark.slow)]
)
def test_unfinished_trace_is_read_until_now(tmp_path, monkeypatch, until, reads):
    whole = usual_run().content()
    trace = tmp_path / 'demo.pcap'
    pauses = []

    def write_on(_seconds):
        pauses.append(1)
        trace.write_bytes(whole[: len(whole) * len(pauses) // 3])

    monkeypatch.setattr(picture.time, 'time_ns', lambda: round((START + until) * 1e9))
    monkeypatch.setattr(picture.time, 'sleep', write_on)
    run = recorded_run(trace, load_robot_model('c3_a601s'), 'smooth')
    assert len(pauses) == reads
    assert run.times[-1] > 3.9
    assert run.source == 'demo, smooth'
