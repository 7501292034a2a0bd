# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that plans: requests on stdin, plans on stdout, until stdin closes.

What goes through the pipes are pickles, each after its length: both ends are ours. First come the
joint limits, which are answered with None once everything is ready. Then each request comes with
the limits to keep to from now on, or None for those so far.
"""

import gc
import os
import pickle
import signal
import struct
import sys
from typing import Any, BinaryIO

from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import Smoother, plan

LENGTH_PREFIX = struct.Struct('=I')
"""The length of a pickle, which is sent before it."""


def framed(value: object) -> bytes:
    """Return a value as it goes through a pipe."""
    data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    return LENGTH_PREFIX.pack(len(data)) + data


def main() -> None:
    """Plan until stdin closes: no orphan is left, however the controller ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the controller's to handle
    answers = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)  # whatever prints does not disturb the answers
    requests = sys.stdin.buffer
    limits = _read(requests)
    if limits is None:
        return
    _warm_up(limits)
    gc.collect()
    gc.freeze()
    _write(answers, None)
    while (order := _read(requests)) is not None:
        request, others = order
        limits = others or limits
        _write(answers, plan(request, limits))


def _warm_up(limits: JointLimits) -> None:
    """Plan a little, so that the first plan that counts takes no longer than the others."""
    span = limits.position_max - limits.position_min
    smoother = Smoother(limits, limits.position_min + 0.5 * span)
    for index in range(1, 5):
        smoother.append(limits.position_min + (0.5 + 0.005 * index**2) * span, 0.1)
    while smoother.moving:
        smoother.step(0.05)


def _read(stream: BinaryIO) -> Any:
    """Return the next value, None at the end."""
    prefix = stream.read(LENGTH_PREFIX.size)
    if len(prefix) < LENGTH_PREFIX.size:
        return None
    (length,) = LENGTH_PREFIX.unpack(prefix)
    data = stream.read(length)
    return pickle.loads(data) if len(data) == length else None  # noqa: S301 - our own parent's


def _write(stream: BinaryIO, value: object) -> None:
    stream.write(framed(value))
    stream.flush()


if __name__ == '__main__':
    try:
        main()
    except BrokenPipeError:  # the controller is gone
        os._exit(0)
