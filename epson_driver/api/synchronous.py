# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions, I/O and gripper of a Robot without asyncio: each request runs in its event loop."""

from collections.abc import Callable
from functools import partial

from epson_driver.api.gripper import Gripper as AwaitedGripper
from epson_driver.api.gripper import GripperState
from epson_driver.api.io import Io as AwaitedIo
from epson_driver.api.motion import Motion as AwaitedMotion
from epson_driver.api.threads import LoopThread


class Motion:
    """A motion of the arm. It ends once: it succeeded, was canceled, or was aborted."""

    def __init__(self, motion: AwaitedMotion, thread: LoopThread) -> None:
        self._motion = motion
        self._thread = thread

    @property
    def done(self) -> bool:
        """True once it has ended, however."""
        return self._motion.done

    @property
    def text(self) -> str:
        """How it ended, in a sentence; '' before."""
        return self._motion.text

    @property
    def duration(self) -> float:
        """How long it is planned to take, s, at a speed scaling of 1."""
        return self._motion.duration

    @property
    def progress(self) -> float:
        """The share of its planned time that has passed, 0 to 1; 1 only when it has succeeded."""
        return self._motion.progress

    def wait(self, timeout: float | None = None) -> str:
        """Wait for its end; return a sentence. Raises MotionError unless it succeeded.

        Raises TimeoutError after `timeout` s; the motion goes on then, until `cancel`.
        """
        return self._thread.run(self._motion.wait, timeout)

    def cancel(self) -> str:
        """Stop the arm; return a sentence when it stands. Nothing if the motion has ended.

        Raises MotionError if it was aborted meanwhile: its text says what is known of the arm.
        """
        return self._thread.run(self._motion.cancel)


class Io:
    """Reads and writes single points. A controller without I/O is a RobotError that says so."""

    def __init__(self, io: AwaitedIo, running: Callable[[], LoopThread]) -> None:
        self._io = io
        self._running = running

    def read(self, kind: str, index: int) -> int:
        """Return the value of a point, such as `read('DI', 3)`. Analogue: mV (docs/io.md)."""
        return self._running().run(partial(self._io.read, kind, index))

    def write(self, kind: str, index: int, value: int) -> None:
        """Set an output, a group or a flag, such as `write('DO', 3, 1)`."""
        self._running().run(partial(self._io.write, kind, index, value))


class Gripper:
    """Opens and closes the gripper that `Settings(gripper=GripperWiring(...))` describes.

    Without that, each method raises RobotError that says so. The arm need not be enabled for it.
    """

    def __init__(self, gripper: AwaitedGripper, running: Callable[[], LoopThread]) -> None:
        self._gripper = gripper
        self._running = running

    def open(self) -> GripperState:
        """Open it; return its state when it is open.

        Raises RobotError if it does not open in its time, or if a newer command took its place.
        """
        return self._running().run(self._gripper.open)

    def close(self) -> GripperState:
        """Close it; return its state: closed, or neither if it holds something.

        Whether it holds something is known after its `time`. Raises RobotError if it stays open,
        or if a newer command took its place.
        """
        return self._running().run(self._gripper.close)

    def state(self) -> GripperState:
        """Return what its inputs show now. Raises RobotError if they are not known."""
        return self._running().run(self._gripper.state)
