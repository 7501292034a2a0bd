# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Priority of the thread that drives a controller with a time-out for its client."""

import contextlib
import logging
import os
import threading

FIFO_PRIORITY = 1
"""Above all threads without real-time priority, below all others with it."""

NICE = -10
"""If real-time priority is not allowed, or there is only one processor."""

_log = logging.getLogger(__name__)
_refused = threading.Event()


def raise_priority() -> None:
    """Request real-time priority, or else a lower nice value, for this thread.

    Its child threads and processes get normal priority. A thread with another scheduling policy
    keeps that. A refusal is logged once.
    """
    try:
        if os.sched_getscheduler(0) != os.SCHED_OTHER:
            return
        reset = os.SCHED_RESET_ON_FORK
        # on one processor a flood of messages would starve the thread that serves ~/stop
        if len(os.sched_getaffinity(0)) > 1:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO | reset, os.sched_param(FIFO_PRIORITY))
                return
        os.sched_setscheduler(0, os.SCHED_OTHER | reset, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
    except (AttributeError, OSError) as error:  # AttributeError: a system without these calls
        if not _refused.is_set():
            _refused.set()
            _log.info(
                'the driver keeps its normal priority (%s): a busy machine may stall it, '
                'docs/troubleshooting.md has the remedy',
                error,
            )
