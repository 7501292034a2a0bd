# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The one call of Ruckig: whatever it does instead of finding a trajectory is told in one way."""

from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory


def calculated(inp: InputParameter) -> Trajectory | None:
    """Return the trajectory that Ruckig finds, or None if it finds none.

    Ruckig returns an error code, or one that its enum does not have (ValueError), or raises
    RuckigError. That is no RuntimeError, only an Exception. Now and then it raises for an input
    that has a solution: in its "step 2" it misses that the duration to which all joints are to be
    synchronized is just the one that a joint needs, by rounding.
    """
    trajectory = Trajectory(inp.degrees_of_freedom)
    try:
        result = Ruckig(inp.degrees_of_freedom).calculate(inp, trajectory)
    except (RuckigError, RuntimeError, ValueError):
        return None
    return trajectory if result in (Result.Working, Result.Finished) else None
