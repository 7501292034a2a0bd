# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A commanded motion beyond a limit at any instant is detected."""

from dataclasses import replace

import numpy as np
import pytest

from benchmark.exact_extrema import Extrema
from epson_driver.motion import go, point_to_point
from epson_driver.motion.joint_motion import stop_joints
from epson_driver.sim_controller.arm.overlap import JointMoves, Part
from epson_driver.sim_controller.arm.streaming import Streaming
from epson_driver.tool_motion.curve_motion import Curve, CurveSpeed, go_along
from simulation.arm_limits import cuts, spans_of
from simulation.events import Event
from simulation.oracles import BrokenError
from simulation.world import MODEL, START, World

LIMITS = MODEL.limits
FAR = START + np.array([2.0, -0.5, 0.4, 0.1, 0.2, 0.3])
AWAY = {'step': 0.2, 'offsets': [[0.3, -0.2, 0.3, 0.1, 0.2, 0.3]], 'from_here': True}
ASKED = [Event(0.1, 'mend', {}), Event(1.0, 'goal', AWAY)]


def extrema(motion):
    result = Extrema()
    spans = spans_of(motion.at, cuts(motion, 0.0, 0.0, motion.duration))
    result.extend(spans, LIMITS, spans[2])
    return [result.velocity, result.acceleration, result.jerk]


def sampled(motion, count=20001):
    """Return the maxima of finite differences, which nearly reach the true extrema."""
    times = np.linspace(0.0, motion.duration, count)
    q, v, a = np.array([motion.at(time) for time in times.tolist()]).transpose(1, 0, 2)
    step = times[1]
    bounds = (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)
    return [
        float(np.max(np.abs(np.diff(values, axis=0)) / step / bound))
        for values, bound in zip((q, v, a), bounds, strict=True)
    ]


def line():
    motion = go(LIMITS, START, FAR, 0.9, 0.8)
    return motion, motion.at(0.4 * motion.duration)


def curve():
    shares = np.linspace(0.0, 1.0, 12)[:, None]
    return Curve(START + shares * (FAR - START) / 4.0 + 0.1 * np.sin(5.0 * shares))


MOTIONS = {
    'a line': lambda: line()[0],
    'a stop on a line': lambda: line()[0].stop(0.2),
    'a stop of each joint': lambda: stop_joints(LIMITS, line()[1]),
    'two lines that overlap': lambda: JointMoves(
        START,
        [
            Part(0.0, START, go(LIMITS, START, FAR, 0.5, 0.5)),
            Part(0.1, FAR, go(LIMITS, FAR, START, 0.5, 0.5)),
        ],
    ),
    'a curve': lambda: go_along(LIMITS, curve(), CurveSpeed(1.0, 10.0, 200.0)),
}


@pytest.mark.parametrize('motion', MOTIONS.values(), ids=MOTIONS)
def test_extrema_match_fine_samples_and_are_not_below_them(motion):
    result, seen = extrema(motion()), sampled(motion())
    assert np.all(np.array(result) >= np.array(seen) * (1.0 - 1e-6))
    assert result == pytest.approx(seen, rel=2e-3)


def seed_of(smooth):
    for seed in map(str, range(1000)):
        world = World(seed)
        if world.smooth == smooth and world.streams and not world.in_python:
            return seed
    raise AssertionError('no such world')


@pytest.mark.invariant(2)
@pytest.mark.parametrize('smooth', [False, True])
def test_inv2_arm_moved_with_other_limits_is_detected(monkeypatch, smooth):
    """With three times the limits, its speed between two steps is still below the limit."""

    def thrice(limits):
        return replace(limits, acceleration=3.0 * limits.acceleration, jerk=3.0 * limits.jerk)

    bounds, placed = point_to_point._bounds_along, Streaming.__init__
    monkeypatch.setattr(
        point_to_point,
        '_bounds_along',
        lambda direction, limits, *shares: bounds(direction, thrice(limits), *shares),
    )
    monkeypatch.setattr(
        Streaming,
        '__init__',
        lambda self, limits, *rest, **named: placed(self, thrice(limits), *rest, **named),
    )
    with pytest.raises(BrokenError, match='2: beyond its limits at an instant'):
        World(seed_of(smooth)).play(ASKED)
