# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A path from one joint position to another, found by OMPL's RRTConnect and shortened.

The same seed gives the same way: what is limited is the number of steps, not the time.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from ompl import base, geometric, util

from epson_driver.motion import Array, JointLimits

CHECK_SPACING_RAD = 0.01
"""Positions are checked so close to each other, rad (over all joints, Euclidean)."""

FIRST_SEARCH_MARGIN_RAD = 1.5
"""The first search stays within so much of start and goal in each joint, rad: no idle turns."""

MAX_SEARCH_STEPS = 6000
"""A search is given up after so many steps."""

MAX_SHORTCUTS = 150
"""So many times a shorter way between two places of the way is tried."""


def find_path(
    start: Array, goal: Array, limits: JointLimits, valid: Callable[[Array], bool], seed: int
) -> Array | None:
    """Return the corners of a valid path, shape (k, n) with start and goal, or None.

    `valid` is asked at every CHECK_SPACING_RAD rad of it. `seed`: 1 or more.
    """
    if not (valid(start) and valid(goal)):  # the planner would wait for a goal that is
        return None
    util.setLogLevel(util.LOG_NONE)
    for number, around in enumerate((FIRST_SEARCH_MARGIN_RAD, np.inf)):
        low = np.maximum(limits.position_min, np.minimum(start, goal) - around)
        high = np.minimum(limits.position_max, np.maximum(start, goal) + around)
        util.RNG.setSeed((2 * seed + number) % 2**32 or 1)
        corners = _search(start, goal, low, high, valid)
        if corners is not None:
            return corners
    return None


def _search(
    start: Array, goal: Array, low: Array, high: Array, valid: Callable[[Array], bool]
) -> Array | None:
    joints = len(start)
    space = base.RealVectorStateSpace(joints)
    bounds = base.RealVectorBounds(joints)
    for joint in range(joints):
        bounds.setLow(joint, float(low[joint]))
        bounds.setHigh(joint, float(high[joint]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    order = range(joints)
    information.setStateValidityChecker(
        lambda state: valid(np.array([state[joint] for joint in order]))
    )
    information.setStateValidityCheckingResolution(CHECK_SPACING_RAD / space.getMaximumExtent())
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, start), _state(space, goal))
    planner = geometric.RRTConnect(information)
    planner.setRange(0.6)
    planner.setProblemDefinition(problem)
    planner.setup()
    left = iter(range(MAX_SEARCH_STEPS))
    stop = base.PlannerTerminationCondition(lambda: next(left, None) is None)
    planner.solve(stop)
    if not problem.hasExactSolution():
        return None
    way = problem.getSolutionPath()
    shorten = geometric.PathSimplifier(information)
    shorten.reduceVertices(way, MAX_SHORTCUTS, MAX_SHORTCUTS, 0.33)
    shorten.partialShortcutPath(way, MAX_SHORTCUTS, MAX_SHORTCUTS, 0.33, 0.005)
    shorten.reduceVertices(way, MAX_SHORTCUTS, MAX_SHORTCUTS, 0.33)
    shorten.collapseCloseVertices(way, MAX_SHORTCUTS, MAX_SHORTCUTS)
    return np.array(
        [[way.getState(k)[joint] for joint in order] for k in range(way.getStateCount())]
    )


def _state(space: Any, joints: Array) -> Any:
    state = space.allocState()
    for joint, position in enumerate(joints):
        state[joint] = float(position)
    return state
