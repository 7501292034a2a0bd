# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where a joint slides, its m/s count beside the others' rad/s: a slow shaft is no stop."""

import numpy as np

from epson_driver.motion import Trajectory
from epson_driver.report.measure import Recording, measure
from epson_driver.report.packed_arm import packed_arm
from epson_driver.robots import load_robot_model

MODEL = load_robot_model('gx8_c652s')
NAMES = MODEL.joint_names


def carried() -> Recording:
    """The arm turns for 1 s, then the shaft alone goes up 0.1 m for 1 s, then the arm turns on."""
    times = np.arange(0.0, 3.0, 0.01)
    velocities = np.zeros((len(times), 4))
    velocities[(times > 0.1) & (times < 1.0), 0] = 2.2
    velocities[(times >= 1.0) & (times < 2.0), 2] = 0.1
    velocities[(times >= 2.0) & (times < 2.9), 0] = 2.2
    positions = np.cumsum(velocities, axis=0) * 0.01
    return Recording(times, positions + np.array([0.0, 1.0, -0.2, 0.0]), velocities)


def test_a_shaft_that_moves_slowly_is_no_stop_of_the_arm() -> None:
    run = carried()
    ends = Trajectory(NAMES, np.array([0.0, 3.0]), run.positions[[0, -1]])
    assert measure(ends, run).stops == 1  # the same numbers, all taken for rad
    assert measure(ends, run, MODEL.limits.rad_per_unit).stops == 0


def test_the_page_has_the_meshes_of_all_links_of_a_scara() -> None:
    drawn = packed_arm(MODEL)
    assert {mesh['link'] for mesh in drawn['meshes']} == set(range(5))
    assert {len(mesh['colour']) for mesh in drawn['meshes']} == {3}
    assert drawn['types'] == ['revolute', 'revolute', 'prismatic', 'revolute']
