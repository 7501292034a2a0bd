# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the keys of `epson_driver jog` do: which joint moves, how fast, and when it stops.

A terminal tells of no key that is released: a key that is held comes again and again, one that was
released does not. So each character moves its joint for RELEASE_S.
"""

RELEASE_S = 0.15
"""A key that did not come again for so long was released, s. Terminals repeat a key 10 to 30 times
a second, but begin with that later: until then a held key moves its joint only for this time."""

FORWARD = '1234567890'
BACKWARD = 'qwertyuiop'
"""The keys of the joints, in their order: below each other on most keyboards."""

FASTER, SLOWER = '+', '-'
ENDS = frozenset({'x', '\x03', '\x04', '\x1b', ''})
"""x, Ctrl-C, Ctrl-D, Escape, or the end of the input."""

STEP = 1.5
"""The ratio of two speeds."""

MIN_SPEED, MAX_SPEED = 0.01, 2.0
"""rad/s or m/s; the driver goes no faster than servo.scale allows."""


class JogKeys:
    """Turns characters into velocities of `joints` joints. Times are monotonic, s."""

    def __init__(self, joints: int, speed: float) -> None:
        self.speed = speed
        self.ended = False
        self._joints = min(joints, len(FORWARD))
        self._joint = 0
        self._sign = 0.0
        self._until = float('-inf')

    def press(self, key: str, now: float) -> None:
        """Take a character. One without a meaning stops the motion."""
        self._until = float('-inf')
        if key in ENDS:
            self.ended = True
        elif key in (FASTER, SLOWER):
            speed = self.speed * (STEP if key == FASTER else 1.0 / STEP)
            self.speed = min(max(speed, MIN_SPEED), MAX_SPEED)
        else:
            for keys, sign in ((FORWARD, 1.0), (BACKWARD, -1.0)):
                joint = keys.find(key)
                if 0 <= joint < self._joints:
                    self._joint, self._sign = joint, sign
                    self._until = now + RELEASE_S

    def velocity(self, now: float) -> tuple[int, float] | None:
        """Return the index of the joint that moves and its velocity; None: none moves."""
        if self.ended or now >= self._until:
            return None
        return self._joint, self._sign * self.speed
