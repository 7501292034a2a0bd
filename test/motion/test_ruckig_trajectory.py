# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Stops do not fail if Ruckig finds no trajectory."""

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
"""State for which Ruckig raises on some processors when it stops all joints synchronously. It
depends on the last bit, and was found by Hypothesis."""


class RaisingTogether(Ruckig):
    """Raises on every processor the error of some processors."""

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


def test_ruckig_error_is_not_a_subclass_of_runtime_error():
    """So `calculated` names RuckigError. If this fails, Ruckig has fixed it."""
    assert not issubclass(RuckigError, RuntimeError | ValueError)
    with pytest.raises(RuckigError):
        Ruckig(1).calculate(impossible(), Trajectory(1))


def test_trajectory_that_ruckig_cannot_find_is_none_or_a_runtime_error():
    assert calculated(impossible()) is None
    with pytest.raises(RuntimeError, match='found no trajectory'):
        solve(impossible())
    assert ruckig_move.move((0.0, 0.0, 0.0), 1.0, 1.0, 0.0, 1.0) is None


def test_move_that_just_reaches_its_speed_is_found():
    """For example 20 mm at 0.1 m/s, 1 m/s² and 10 m/s³. Ruckig alone finds 9 of 10."""
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
    assert missed, 'Ruckig has fixed this'


@pytest.mark.invariant(2, 3)
def test_inv2_joints_stop_independently_if_a_synchronous_stop_fails(monkeypatch):
    together = fastest_stop(LIMITS, STATE)
    monkeypatch.setattr(point_to_point, 'Ruckig', RaisingTogether)
    motion = fastest_stop(LIMITS, STATE)
    assert motion.within(LIMITS)
    assert np.array_equal(motion.states[:, :, 0], STATE)
    assert motion.duration <= together.duration * (1.0 + 1e-9)


def test_positions_at_many_times_equal_those_at_single_times():
    motion = fastest_stop(LIMITS, STATE)
    times = np.linspace(0.0, 1.2 * motion.duration, 50)
    expected = [motion.at(time)[0] for time in times.tolist()]
    assert motion.positions(times) == pytest.approx(np.array(expected), abs=1e-15)
    assert motion.positions(np.empty(0)).shape == (0, 6)
