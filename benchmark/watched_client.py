# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The executable `client` with a thread that collects garbage and counts its tasks each second.

`python -m benchmark.watched_client FILE client …`: the newest count is the last line of FILE. By
itself, CPython makes its first full collection after about 25 minutes, and 1 MB of cyclic garbage
until then looks like a leak. The client's own timeouts are as long as in its tests, because a busy
machine is not a fault of the controller.
"""

import asyncio
import gc
import sys
import threading
import time
from pathlib import Path
from typing import Any

from support.patient import LONG, TIMEOUTS, be_patient

from epson_driver.cli.__main__ import main

PERIOD_S = 1.0
PATIENCE = {'epson_driver.driver.goal.goal_queue': {'FRESH_POSE_TIMEOUT_S': LONG}}
"""A controller that is not scheduled sends no joints. Goals then wait longer than usual."""

loops: list[Any] = []


def watch_loops() -> None:
    """Record every event loop of the process when it is created."""
    made = asyncio.SelectorEventLoop.__init__

    def init(loop: Any, *arguments: Any) -> None:
        made(loop, *arguments)
        loops.append(loop)

    asyncio.SelectorEventLoop.__init__ = init  # type: ignore[method-assign, assignment]


def count(path: Path) -> None:
    """Collect garbage and write a count each second while the process is alive."""
    with path.open('a', encoding='ascii', buffering=1) as file:
        while True:
            gc.collect()
            tasks = sum(len(asyncio.all_tasks(loop)) for loop in loops)
            file.write(f'{tasks}\n')
            time.sleep(PERIOD_S)


if __name__ == '__main__':
    be_patient(timeouts=TIMEOUTS | PATIENCE)
    watch_loops()
    threading.Thread(target=count, args=(Path(sys.argv.pop(1)),), daemon=True).start()
    sys.exit(main())
