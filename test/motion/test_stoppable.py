# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motions that are left on their way, at any moment, as one motion inside the limits."""

import numpy as np
import pytest
from support.smoother_harness import LIMITS, PLAN

from epson_driver.motion.motion_figures import measure
from epson_driver.motion.smoothed import MAX_STEP_S, smoothed
from epson_driver.motion.smoother import Mode
from epson_driver.motion.stoppable import GivenUpError, StoppableMotion


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('share', [0.0, 0.03, 0.2, 0.5, 0.77, 0.97, 1.0])
def test_the_motion_and_its_stop_are_one_motion_inside_the_limits(
    mode: Mode, share: float
) -> None:
    whole = StoppableMotion(PLAN, LIMITS, mode)
    motion = whole.motion
    assert np.array_equal(motion.positions, smoothed(PLAN, LIMITS, mode, refine=False).positions)
    time = share * motion.duration
    whole.follow(time / 2)
    left = whole.stopped(time)
    steps = int(time / MAX_STEP_S + 1e-9)
    assert np.array_equal(left.positions[:steps], motion.positions[:steps])
    assert np.diff(left.times) == pytest.approx(MAX_STEP_S)
    figures = measure(left, None, LIMITS)
    assert max(figures.velocity, figures.acceleration) <= 1.0
    assert figures.jerk <= 1.02
    assert left.velocities is not None and not left.velocities[-1].any()  # noqa: PT018
    assert left.accelerations is not None and not left.accelerations[-1].any()  # noqa: PT018
    stopping = LIMITS.velocity / LIMITS.acceleration + LIMITS.acceleration / LIMITS.jerk
    assert left.duration <= time + 2.5 * stopping.max()


def test_a_stop_does_not_begin_in_the_past() -> None:
    whole = StoppableMotion(PLAN, LIMITS)
    whole.follow(1.0)
    with pytest.raises(ValueError, match=r'no stop at 0\.5 s'):
        whole.stopped(0.5)


def test_a_motion_that_nobody_waits_for_is_given_up(caplog: pytest.LogCaptureFixture) -> None:
    asked = iter([False, True])
    with pytest.raises(GivenUpError):
        StoppableMotion(PLAN, LIMITS, given_up=lambda: next(asked))
    assert not caplog.records
