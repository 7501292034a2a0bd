# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the benchmark of streams makes of what it measured."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from benchmark.servo import DURATION_S, KINDS, SHORT, THOROUGH, best_lag, where_it_rests
from benchmark.servo_results import Dropout, Lag, Results, Trace, read, report, write
from benchmark.servo_streams import STREAMS, WAVES, Arm
from benchmark.servo_user import Recording
from epson_driver.node.setpoint_messages import from_trajectory
from epson_driver.profiles import load_controller_profile

TIMES = np.arange(0.0, DURATION_S, 0.005)


@pytest.mark.parametrize('name', WAVES)
def test_the_lag_of_a_delayed_wave_is_its_delay(name):
    wave = WAVES[name]
    ways = np.array([wave(max(t - 0.16, 0.0))[0] for t in TIMES])
    lag, rms = best_lag(TIMES, ways, wave, DURATION_S)
    assert lag == pytest.approx(0.16, abs=0.003)
    assert rms < 2e-3


@pytest.mark.parametrize('name', WAVES)
def test_a_wave_begins_where_the_arm_stands_and_its_velocity_is_that_of_its_way(name):
    wave = WAVES[name]
    assert wave(0.0)[0] == 0.0
    ways = np.array([wave(t)[0] for t in TIMES])
    velocities = np.array([wave(t)[1] for t in TIMES])
    smooth = np.abs(np.diff(velocities)) < 0.05
    slopes = np.diff(ways) / 0.005
    jumps = np.abs(slopes) > 2.0  # of steps
    np.testing.assert_allclose(
        slopes[smooth & ~jumps], velocities[:-1][smooth & ~jumps], atol=0.02
    )


@pytest.mark.parametrize('name', WAVES)
def test_a_wave_ends_where_it_began_so_that_no_number_of_runs_reaches_the_end_of_the_range(name):
    assert WAVES[name](DURATION_S)[0] == pytest.approx(0.0, abs=1e-9)


def test_what_was_recorded_is_of_one_moment_though_joint_states_go_on_coming():
    class Listening:
        """Gets another joint state whenever somebody looks."""

        def __init__(self):
            self._states = []

        @property
        def states(self):
            self._states.append((10.0 + len(self._states), [0.5, 0.0], [-0.2, 0.1]))
            return self._states

    user = Listening()
    assert len(user.states) == 1
    taken = Recording(user, 10.0, [0.3, 0.0]).taken()
    assert len(taken.times) == len(taken.ways) == len(taken.positions) == 2
    np.testing.assert_allclose(taken.ways, 0.2)
    np.testing.assert_allclose(taken.fastest, [0.2, 0.1])


def test_a_window_is_what_the_driver_takes():
    arm = Arm(['a', 'b'], [0.3, 0.4])
    begin = 1000.0
    message = STREAMS['windows'].message(arm, WAVES['sine'], 1.0, begin)
    setpoint = from_trajectory(message, ('a', 'b'), 'x', begin + 1.0)
    assert setpoint.window is not None
    assert setpoint.window.times[-1] == pytest.approx(0.1, abs=1e-6)
    assert setpoint.positions[0] == pytest.approx(0.3 + WAVES['sine'](1.1)[0])
    assert setpoint.positions[1] == 0.4


def test_where_an_arm_rests_is_measured_at_its_end_and_in_the_direction_of_the_stream():
    sine = WAVES['sine']
    last = sine(1.3)[0]  # on its way back from 0.4
    ways = np.array([0.0, 0.2, 0.403, last - 0.01])
    past, beyond = where_it_rests(ways, sine, 1.3)
    assert past == pytest.approx(0.01)
    assert beyond == pytest.approx(0.003, abs=1e-6)
    past, beyond = where_it_rests(np.array([0.0, 0.2, last + 0.01]), sine, 1.3)
    assert past == pytest.approx(-0.01)
    assert beyond == 0.0


def test_what_is_run_exists():
    for kind in KINDS.values():
        load_controller_profile(kind.profile)
    for wave, stream, rate in (*SHORT, *THOROUGH):
        assert wave in WAVES
        assert stream in STREAMS
        assert rate in (30.0, 50.0, 100.0)


@pytest.mark.slow
def test_figures_are_kept_and_shown(tmp_path):
    pytest.importorskip('matplotlib')
    lag = Lag('rc620, smooth', 'sine', 'positions', 50.0, 0.16, 0.0123456, 0.2)
    results = Results(
        [lag],
        [Dropout('rc620, smooth', 1.3, 0.4, -0.02, 0.003, 0.2, inside=True)],
        [Trace('rc620, smooth', [0.0, 1.0], [0.0, 0.1], [0.0, 0.05])],
    )
    write(results, tmp_path, tmp_path / 'servo.png')
    assert read(tmp_path).lags[0].rms == pytest.approx(0.0123456, rel=1e-4)
    assert '| rc620, smooth | sine | positions | 50 | 160 | 12 | 0.20 |' in report(results)
    assert (
        '| rc620, smooth | 1.3 | 400 | -20 | 3 | 0.20 | yes |'
        in (tmp_path / 'servo.md').read_text()
    )
    assert (tmp_path / 'servo.png').stat().st_size > 5_000
