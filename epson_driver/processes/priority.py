# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Priority of the thread that drives a controller with a client timeout."""

import logging
import os
import threading

NICE = -10
"""Nice value. Real-time priority would starve the threads that serve `~/stop` on a busy CPU."""

_log = logging.getLogger(__name__)
_refused = threading.Event()


def raise_priority() -> None:
    """Request a lower nice value for this thread.

    Its child threads and processes keep the normal one. A thread with another scheduling policy is
    unchanged. A failure is logged once.
    """
    try:
        if os.sched_getscheduler(0) == os.SCHED_OTHER:
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
    except (AttributeError, OSError) as error:  # AttributeError: a system without these calls
        if not _refused.is_set():
            _refused.set()
            _log.info(
                'the driver keeps its normal priority (%s): a busy machine may stall it, '
                'docs/troubleshooting.md has the remedy',
                error,
            )
