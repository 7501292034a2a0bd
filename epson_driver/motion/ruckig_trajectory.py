# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The one call of Ruckig: whatever it does instead of finding a trajectory is told in one way."""

from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

LESS_JERK = 1.0 - 1e-9
"""Of the jerk limits, where Ruckig misses a solution as two of its profiles meet by rounding."""


def calculated(inp: InputParameter) -> Trajectory | None:
    """Return the trajectory that Ruckig finds, or None if it finds none.

    Ruckig returns an error code, or one that its enum does not have (ValueError), or raises
    RuckigError. That is no RuntimeError, only an Exception. It does so, too, for inputs that have
    a solution: where v = a² / j and the like, as of round numbers, and where the duration to which
    all joints are to be synchronized is just the one that a joint needs.
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
