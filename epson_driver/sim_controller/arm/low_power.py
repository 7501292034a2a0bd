# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion under SPEL+'s Power Low, slow enough for a person to step back.

The tool speed is bounded without kinematics. The reach of a joint is the largest distance of the
tool from its axis (1 for a prismatic joint). A joint moves the tool at most at its velocity times
its reach, so the sum over all joints is an upper bound of the tool speed.
"""

from dataclasses import dataclass, replace

import numpy as np

from epson_driver.motion import Array, JointLimits

LOW_POWER = 0.05  # maximum Speed and Accel, as a fraction
LOW_POWER_TOOL_SPEED = 0.25  # m/s


@dataclass(frozen=True, eq=False)
class LowPower:
    """The speed and acceleration caps of Power Low.

    * fraction: maximum fraction (0, 1] of the robot's limits.
    * tool_speed: maximum tool speed, m/s.
    * reach: largest distance of the tool from each joint's axis, shape (n,), m (1 for a prismatic
      joint).
    """

    fraction: float
    tool_speed: float
    reach: Array

    def limits(self, limits: JointLimits) -> JointLimits:
        """Return limits that respect the tool speed for any combination of joint motions."""
        velocity = self.fraction * limits.velocity
        tool = float(velocity @ self.reach)
        if tool > self.tool_speed:  # a joint that does not move the tool is not slowed down
            velocity = np.where(self.reach > 0.0, velocity * (self.tool_speed / tool), velocity)
        return replace(
            limits,
            velocity=velocity,
            acceleration=self.fraction * limits.acceleration,
            jerk=self.fraction * limits.jerk,
        )

    def speed(self, limits: JointLimits, direction: Array) -> float:
        """Return the maximum Speed of a straight move in joint space, a fraction (0, 1].

        `direction`, shape (n,), is the displacement of each joint. Its length has no effect.
        """
        distances = np.abs(direction)
        # The time that the slowest joint takes for the distance at full speed.
        time = float(np.max(distances / limits.velocity))
        tool = float(distances @ self.reach)
        if tool == 0.0 or time == 0.0:
            return self.fraction
        return min(self.fraction, self.tool_speed * time / tool)


def low_power_caps(reach: Array, fraction: float = 1.0) -> LowPower:
    """Return the Power Low caps of a robot whose joints have the given reach.

    `fraction`: the part of the low-power tool speed that the robot may use.
    """
    return LowPower(LOW_POWER, fraction * LOW_POWER_TOOL_SPEED, reach)
