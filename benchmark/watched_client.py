# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The executable `client`, unchanged, beside a thread that counts its asyncio tasks each second.

`python -m benchmark.watched_client FILE client …`: the newest count is the last line of FILE. The
client's own time-outs are as long as in its tests: a busy machine is no fault of the controller.
"""

import asyncio
import sys
import threading
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from support.patient import LONG, TIMEOUTS, be_patient

from epson_driver.cli.__main__ import main

PERIOD_S = 1.0
PATIENCE = {'epson_driver.driver.goal.goal_queue': {'FRESH_POSE_TIMEOUT_S': LONG}}
"""A controller that is not scheduled sends no joints: goals wait for them, here for long."""

loops: list[Any] = []


def watch_loops() -> None:
    """Have every event loop of the process noted when it is made."""
    made = asyncio.SelectorEventLoop.__init__

    def init(loop: Any, *arguments: Any) -> None:
        made(loop, *arguments)
        loops.append(loop)

    asyncio.SelectorEventLoop.__init__ = init  # type: ignore[method-assign, assignment]


def count(path: Path) -> None:
    """Write a count each second, as long as the process lives."""
    with path.open('a', encoding='ascii', buffering=1) as file:
        while True:
            tasks = sum(len(asyncio.all_tasks(loop)) for loop in loops)
            file.write(f'{tasks}\n')
            time.sleep(PERIOD_S)


if __name__ == '__main__':
    be_patient(timeouts=TIMEOUTS | PATIENCE)
    watch_loops()
    threading.Thread(target=count, args=(Path(sys.argv.pop(1)),), daemon=True).start()
    sys.exit(main())
