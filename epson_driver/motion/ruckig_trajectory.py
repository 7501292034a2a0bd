# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The only call of Ruckig. Every failure to find a trajectory has the same result."""

from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

LESS_JERK = 1.0 - 1e-9
"""Reduction of the jerk limits if Ruckig misses a solution where two of its profiles meet."""


def calculated(inp: InputParameter) -> Trajectory | None:
    """Return the trajectory that Ruckig finds, or None if it finds none.

    In that case Ruckig returns an error code, or one that its enum does not contain (ValueError),
    or raises RuckigError, which is only an Exception and no RuntimeError. It also fails for some
    inputs with a solution: if v = a² / j or similar holds exactly, e.g. for round numbers, and if
    the duration for synchronizing all joints is exactly the duration that one joint needs.
    """
    trajectory = _calculated(inp)
    if trajectory is None:
        jerk = inp.max_jerk
        inp.max_jerk = [LESS_JERK * each for each in jerk]
        trajectory = _calculated(inp)
        inp.max_jerk = jerk
    return trajectory


def _calculated(inp: InputParameter) -> Trajectory | None:
    trajectory = Trajectory(inp.degrees_of_freedom)
    try:
        result = Ruckig(inp.degrees_of_freedom).calculate(inp, trajectory)
    except (RuckigError, RuntimeError, ValueError):
        return None
    return trajectory if result in (Result.Working, Result.Finished) else None
