# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A smooth motion that is fully planned in advance, with a stop within limits at any time."""

from collections.abc import Callable

import numpy as np

from epson_driver.motion.executed import Executed
from epson_driver.motion.limits import JointLimits
from epson_driver.motion.smoothed import MAX_STEP_S, smoothed
from epson_driver.motion.smoother import Mode, Plan, Request, Smoother, plan
from epson_driver.motion.trajectory import Trajectory

SAME = 1e-9
"""Tolerance of the motion when it is computed again, rad or m."""


MAX_DURATION_S = 600.0
"""Maximum duration of a smooth motion, s: it has 150,000 samples."""


class StoppableMotion:
    """The smooth motion through a trajectory, `motion`, one point every MAX_STEP_S, and its stops.

    Its path is the spline, as for goals of the driver. A stop is the smoother's stop, on the path
    if that is possible within the limits. For this, the smoother executes the motion a second
    time, with the plans of the first run, up to the time passed to `follow`. A stop from there is
    found immediately. `look` is called at each sample, and may raise to end the work. Raises like
    `smoothed`, and ValueError for a motion longer than MAX_DURATION_S.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        limits: JointLimits,
        mode: Mode = Mode.TIME_PRESERVING,
        look: Callable[[], None] = lambda: None,
    ) -> None:
        plans: list[Plan | None] = []

        def planned(request: Request, limits: JointLimits) -> Plan | None:
            plans.append(plan(request, limits))
            return plans[-1]

        def check(time: float) -> None:
            look()
            if time > MAX_DURATION_S:
                raise ValueError(
                    f'point {len(trajectory.times) - 1}: time_from_start = {time:g} s or later: a '
                    f'smooth motion must take at most {MAX_DURATION_S:g} s'
                )

        check(trajectory.duration)
        self._check = check
        trajectory = trajectory.in_order(limits.names)
        self._executed = executed = Executed(trajectory.positions[0])
        self.motion = smoothed(
            trajectory, limits, mode, planner=planned, refine=False, observer=executed, look=check
        )
        again = iter(plans)
        self._left = Executed(trajectory.positions[0])
        self._smoother = Smoother(
            limits,
            trajectory.positions[0],
            mode,
            planner=lambda *_: next(again, None),
            observer=self._left,
        )
        durations = np.diff(trajectory.times, prepend=trajectory.times[0])
        for point, duration in zip(trajectory.positions, durations.tolist(), strict=True):
            self._smoother.append(point, duration)
        self._smoother.finish()
        self._steps = 0

    def points(self, longest: float) -> Trajectory:
        """Return the motion as points from 0 s, at most `longest` s apart, see `Executed`."""
        end = float(self.motion.times[-1] - self.motion.times[0])
        return self._executed.points(self.motion.joint_names, end, longest, look=self._check)

    def follow(self, time: float) -> None:
        """Prepare for stops that start `time` s after the start of the motion, or later."""
        steps = min(int(time / MAX_STEP_S + SAME), len(self.motion.times) - 1)
        while self._steps < steps:
            self._smoother.step(MAX_STEP_S)
            self._steps += 1

    def stopped(self, time: float, longest: float, begin: float = 0.0) -> Trajectory:
        """Return the motion until `time`, s, or up to MAX_STEP_S earlier, and its stop from there.

        It has points as in `points`, from `begin` s. Call it once, and not for a time before the
        last `follow`. Raises ValueError if the stop cannot be determined.
        """
        self.follow(time)
        smoother, motion, steps = self._smoother, self.motion, self._steps
        apart = float(np.abs(smoother.motion.position - motion.positions[steps]).max())
        if apart > SAME or time < motion.times[steps] - motion.times[0] - SAME:
            raise ValueError(
                f'no stop at {time:g} s: the motion is {apart:g} rad or m from itself'
            )
        smoother.stop()
        while smoother.moving:
            smoother.step(MAX_STEP_S)
        if smoother.violation is not None:
            raise ValueError(f'the stop breaks a limit: {smoother.violation}')
        return self._left.points(motion.joint_names, smoother.now, longest, begin)
