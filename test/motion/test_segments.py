# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points between those of a trajectory, and the way into it from a moving state."""

import numpy as np
import pytest

from epson_driver.motion import Trajectory
from epson_driver.motion.joint_motion import move_into
from epson_driver.motion.segments import SPACING_S, divided
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
MIDDLE = (LIMITS.position_min + LIMITS.position_max) / 2.0
SPAN = LIMITS.position_max - LIMITS.position_min
STATES = 60
DT = 1e-3

pytestmark = pytest.mark.invariant(2)


def random_states():
    """Yield states to go from and to, (position, velocity) each, and a time for it, s."""
    random = np.random.default_rng(1)
    for _ in range(STATES):
        start = MIDDLE + random.uniform(-0.25, 0.25, 6) * SPAN
        pace = random.choice([0.0, 0.1, 0.3])
        velocities = random.uniform(-pace, pace, (2, 6)) * LIMITS.velocity
        end = start + random.uniform(-0.5, 0.5, 6) * random.choice([0.05, 0.3, 1.0])
        yield (start, velocities[0]), (end, velocities[1]), random.uniform(0.05, 1.0)


def test_inv2_a_move_into_a_state_is_always_found_and_keeps_every_limit():
    """Looked at in samples of its own, from positions alone."""
    for (start, before), (end, after), duration in random_states():
        motion = move_into(LIMITS, (start, before, np.zeros(6)), end, after, duration)
        assert motion is not None
        assert motion.duration >= duration * (1.0 - 1e-9)
        times = np.arange(0.0, min(motion.duration, 0.3), DT)
        trail = np.array([motion.at(time)[0] for time in times])
        for order, limit in enumerate(
            (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1
        ):
            differences = np.abs(np.diff(trail, order, axis=0)) / DT**order
            assert np.all(differences <= limit * 1.001), f'derivative {order}'
        last, velocity, _ = motion.at(motion.duration * (1.0 - 1e-9))
        np.testing.assert_allclose(last, end, atol=1e-6)
        np.testing.assert_allclose(velocity, after, atol=1e-3)


def test_inv2_a_move_that_would_leave_the_joint_range_is_none():
    top = LIMITS.position_max
    state = (top - 0.01, 0.9 * LIMITS.velocity, np.zeros(6))
    assert move_into(LIMITS, state, top - 0.5, np.zeros(6), 1.0) is None


def plan(times, ways, speeds):
    """Return a plan of all joints alike, off the middle by `ways`."""
    positions = MIDDLE + np.array(ways, dtype=float)[:, None] * np.ones(6)
    velocities = np.array(speeds, dtype=float)[:, None] * np.ones(6)
    return Trajectory(LIMITS.names, np.array(times, dtype=float), positions, velocities)


def test_inv2_long_segments_get_points_and_the_plan_keeps_its_points_and_times():
    sparse = plan([0.0, 1.0, 1.05, 3.0], [0.0, 0.5, 0.55, 0.0], [0.0, 0.8, 0.5, 0.0])
    made = divided(sparse, LIMITS)
    assert np.diff(made.times).max() <= SPACING_S * (1.0 + 1e-6)
    for time, position in zip(sparse.times, sparse.positions, strict=True):
        index = int(np.argmin(np.abs(made.times - time)))
        assert made.times[index] == pytest.approx(time, abs=1e-9)
        np.testing.assert_array_equal(made.positions[index], position)


def test_inv2_a_segment_that_cannot_keep_its_time_stays_as_it_is():
    short = plan([0.0, 0.21], [0.0, 0.8], [0.0, 0.0])
    np.testing.assert_array_equal(divided(short, LIMITS).times, short.times)


def test_inv2_out_of_a_moving_state_the_rest_comes_as_much_later_as_the_way_needs():
    back = plan([0.0, 0.1, 0.35], [0.0, -0.2, -0.3], [2.0, -1.0, 0.0])
    made = divided(back, LIMITS, moving=True)
    late = made.duration - back.duration
    assert late > 0.05
    assert made.positions[:, 0].max() > MIDDLE[0]  # it cannot turn on the spot
    assert made.times[-1] - made.times[-2] <= SPACING_S * (1.0 + 1e-6)


def test_a_trajectory_without_velocities_is_refused():
    bare = Trajectory(LIMITS.names, np.array([0.0, 1.0]), np.array([MIDDLE, MIDDLE]))
    with pytest.raises(ValueError, match='no velocities'):
        divided(bare, LIMITS)
