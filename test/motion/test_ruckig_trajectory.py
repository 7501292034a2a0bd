# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ruckig finds no trajectory: nothing raises on the way to a stop."""

import numpy as np
import pytest
from ruckig import (
    ControlInterface,
    InputParameter,
    Ruckig,
    RuckigError,
    Synchronization,
    Trajectory,
)

from epson_driver.motion.point_to_point import solve
from epson_driver.motion.ruckig_trajectory import calculated
from epson_driver.motion.smoother import ruckig_move
from epson_driver.motion.smoother.joint_motion import fastest_stop
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits

POSITION = np.array([0.0, 0.0, 0.0, 2.058762289775091, 1.843451625640255, 0.0])
VELOCITY = np.array([0.0, 0.0, 0.0, 0.3605768254346811, 0.4389944389642877, 0.0])
ACCELERATION = np.array([0.0, 0.0, 0.0, -24.76135767620861, -30.14641417389261, 0.0])
"""From here Ruckig raises when it is to stop all joints together. Hypothesis found it."""


def stop_together():
    inp = InputParameter(6)
    inp.control_interface = ControlInterface.Velocity
    inp.synchronization = Synchronization.Time
    inp.current_position = POSITION.tolist()
    inp.current_velocity = VELOCITY.tolist()
    inp.current_acceleration = ACCELERATION.tolist()
    inp.max_velocity = LIMITS.velocity.tolist()
    inp.max_acceleration = LIMITS.acceleration.tolist()
    inp.max_jerk = LIMITS.jerk.tolist()
    return inp


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


@pytest.mark.invariant(2, 3)
def test_inv2_where_ruckig_raises_for_all_joints_together_each_stops_by_itself():
    assert calculated(stop_together()) is None
    motion = fastest_stop(LIMITS, (POSITION, VELOCITY, ACCELERATION))
    assert motion.within(LIMITS)
    assert np.array_equal(motion.states[:, :, 0], (POSITION, VELOCITY, ACCELERATION))
