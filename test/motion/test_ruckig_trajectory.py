# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ruckig finds no trajectory: nothing raises on the way to a stop."""

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, RuckigError, Synchronization, Trajectory

from epson_driver.motion import point_to_point
from epson_driver.motion.joint_motion import fastest_stop
from epson_driver.motion.point_to_point import calculated, solve
from epson_driver.motion.smoother import ruckig_move
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits

STATE = (
    np.array([0.0, 0.0, 0.0, 2.058762289775091, 1.843451625640255, 0.0]),
    np.array([0.0, 0.0, 0.0, 0.3605768254346811, 0.4389944389642877, 0.0]),
    np.array([0.0, 0.0, 0.0, -24.76135767620861, -30.14641417389261, 0.0]),
)
"""On some processors Ruckig raises from here when it is to stop all joints together: it depends on
the last bit. Hypothesis found it."""


class RaisingTogether(Ruckig):
    """Raises on every processor what it raises on some."""

    def calculate(self, inp, trajectory):
        if inp.synchronization is Synchronization.Time:
            raise RuckigError('error in step 2')
        return super().calculate(inp, trajectory)


def impossible():
    inp = InputParameter(1)
    inp.target_position = [1.0]
    inp.max_velocity = inp.max_jerk = [1.0]
    inp.max_acceleration = [0.0]
    return inp


def test_ruckig_raises_what_is_no_runtime_error():
    """Why `calculated` names RuckigError. Fails when Ruckig mends that: then less is needed."""
    assert not issubclass(RuckigError, RuntimeError | ValueError)
    with pytest.raises(RuckigError):
        Ruckig(1).calculate(impossible(), Trajectory(1))


def test_no_trajectory_is_none_or_a_runtime_error():
    assert calculated(impossible()) is None
    with pytest.raises(RuntimeError, match='found no trajectory'):
        solve(impossible())
    assert ruckig_move.move((0.0, 0.0, 0.0), 1.0, 1.0, 0.0, 1.0) is None


def test_a_move_whose_speed_is_reached_just_at_the_end_of_its_ramps_is_found():
    """A line of 20 mm at 0.1 m/s with 1 m/s² and 10 m/s³ is one: Ruckig finds 9 of 10 of them."""
    random, missed = np.random.default_rng(0), 0
    for _ in range(300):
        ramp, acceleration = random.choice([0.05, 0.1, 0.2]), random.choice([0.5, 1.0, 7.0, 50.0])
        speed = acceleration * ramp
        exact = np.array([2.0 * ramp * speed, speed, acceleration, acceleration / ramp])
        rounded = exact * (1.0 + np.finfo(float).eps * random.integers(-3, 4, 4))
        inp = InputParameter(1)
        inp.target_position, inp.max_velocity, inp.max_acceleration, inp.max_jerk = (
            [value] for value in rounded.tolist()
        )
        missed += point_to_point._calculated(inp) is None
        assert solve(inp).duration == pytest.approx(4.0 * ramp, rel=1e-6)
        assert inp.max_jerk == [rounded[3]]
    assert missed, 'Ruckig has mended that: less is needed'


@pytest.mark.invariant(2, 3)
def test_inv2_where_ruckig_raises_for_all_joints_together_each_stops_by_itself(monkeypatch):
    together = fastest_stop(LIMITS, STATE)
    monkeypatch.setattr(point_to_point, 'Ruckig', RaisingTogether)
    motion = fastest_stop(LIMITS, STATE)
    assert motion.within(LIMITS)
    assert np.array_equal(motion.states[:, :, 0], STATE)
    assert motion.duration <= together.duration * (1.0 + 1e-9)
