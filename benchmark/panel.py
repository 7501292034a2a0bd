# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the panel costs: the driver, by its joint states with and without it; and the machine.

`make bench`: a simulated controller at its usual rate, the driver, and a listener in this process.
The arm moves to and fro, for the panel then has the most to draw. Windows without a panel and with
one take turns, so that what else the machine does meets both alike; each figure is the median of
its windows. The age of a joint state is the time from its stamp (when it reached the driver) until
the listener has it. The browser is one that takes what comes and draws nothing, a process of its
own: a real one takes a core or more where there is no graphics card. Linux only.
"""

import argparse
import multiprocessing
import statistics
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
from websockets.sync.client import connect

from benchmark.robots import SETTLING_S, Listener, cpu_time, running
from epson_driver.cli import processes

ROUNDS = 3
WINDOW_S = 5.0
MOVING_S = 600.0
"""Longer than all windows together, s."""

MAX_SHARE = 0.2
"""Of a core that the panel may take with one browser."""

STAMP = struct.Struct('<iI')
STAMP_AT = 4
"""Where a serialized message's header begins, behind the four bytes that say how it is encoded."""

PROTOCOL: Any = 'viser-v1.1.1'
CAMERA = {
    'type': 'ViewerCameraMessage',
    'wxyz': (1.0, 0.0, 0.0, 0.0),
    'position': (1.0, 1.0, 1.0),
    'fov': 1.0,
    'near': 0.1,
    'far': 10.0,
    'image_height': 100,
    'image_width': 100,
    'look_at': (0.0, 0.0, 0.0),
    'up_direction': (0.0, 0.0, 1.0),
}
"""What a browser says first."""


@dataclass(frozen=True)
class Window:
    """What was seen of a driver for some time."""

    rate: float
    """Joint states per second."""
    median_age: float
    late_age: float
    """The age that 99 of 100 joint states do not exceed, s; `median_age`: half of them."""
    driver: float
    """What the driver took of a core."""


class AgeListener(Listener):
    """Notes how old each joint state is when it comes."""

    def __init__(self, domain: int, names: Sequence[str]) -> None:
        self.domain = domain
        self.ages: list[float] = []
        super().__init__(domain, names)

    def _count(self, name: str, message: bytes) -> None:
        self.ages.append(time.time() - stamp(message))
        super()._count(name, message)


def stamp(message: bytes) -> float:
    """Return the time of the header with which a serialized message begins, s since the epoch."""
    sec, nanosec = STAMP.unpack_from(message, STAMP_AT)
    return float(sec + nanosec * 1e-9)


def median(windows: Sequence[Window]) -> Window:
    """Return the median of each figure."""
    rows = zip(*map(astuple, windows), strict=True)
    return Window(*(statistics.median(row) for row in rows))


@contextmanager
def running_panel(folder: Path, domain: int) -> Iterator[tuple[int, int]]:
    """Run a panel; yield its process id and its port."""
    environment = processes.ros_environment(domain)
    panel = processes.Process('panel', ['--port=0'], folder / 'panel.log', environment)
    with processes.ended_at_exit(panel):
        port = urlsplit(panel.address()).port
        if port is None:
            raise RuntimeError('the panel has not said where it is')
        yield panel.process_id, port


@contextmanager
def running_browser(port: int) -> Iterator[None]:
    """Run a browser that takes what the panel at a port sends. Raises RuntimeError if it ends."""
    browser = multiprocessing.get_context('spawn').Process(target=_browse, args=(port,))
    browser.start()
    try:
        yield
        if not browser.is_alive():
            raise RuntimeError('the browser has lost the panel')
    finally:
        browser.terminate()
        browser.join()


def _browse(port: int) -> None:
    with connect(
        f'ws://127.0.0.1:{port}',
        subprotocols=[PROTOCOL],
        origin=f'http://127.0.0.1:{port}',  # type: ignore[arg-type]
        max_size=None,
        compression=None,
    ) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        for _ in socket:
            pass


def window(driver: int, listener: AgeListener, seconds: float) -> Window:
    """Look at a driver for some seconds."""
    used, began = cpu_time(driver), time.monotonic()
    listener.ages.clear()
    time.sleep(seconds)
    ages, lasted = list(listener.ages), time.monotonic() - began
    median_age, late_age = np.percentile(ages, (50.0, 99.0))
    share = (cpu_time(driver) - used) / lasted
    return Window(len(ages) / lasted, float(median_age), float(late_age), share)


def share(process_id: int, seconds: float) -> float:
    """Return what a process takes of a core for some seconds."""
    used, began = cpu_time(process_id), time.monotonic()
    time.sleep(seconds)
    return (cpu_time(process_id) - used) / (time.monotonic() - began)


def measure(rounds: int, seconds: float) -> tuple[Window, Window, dict[str, float]]:
    """Return what is seen of the driver without and with a panel, and the panel's shares."""
    without, beside, moving, shares = [], [], [], {}
    with (
        TemporaryDirectory() as name,
        running(1, False, folder := Path(name), AgeListener) as ((driver,), listener),
    ):
        with running_panel(folder, listener.domain) as (panel, port):
            time.sleep(SETTLING_S)
            shares['at rest, no browser'] = share(panel, seconds)
            with running_browser(port):
                time.sleep(SETTLING_S)
                shares['at rest, one browser'] = share(panel, seconds)
        listener.move(MOVING_S)
        for _ in range(rounds):
            time.sleep(SETTLING_S)
            without.append(window(driver, listener, seconds))
            with running_panel(folder, listener.domain) as (panel, port), running_browser(port):
                time.sleep(SETTLING_S)
                used = cpu_time(panel)
                began = time.monotonic()
                beside.append(window(driver, listener, seconds))
                moving.append((cpu_time(panel) - used) / (time.monotonic() - began))
    shares['the arm moves, one browser'] = statistics.median(moving)
    return median(without), median(beside), shares


def main() -> None:
    """Print what the driver does without and with the panel, and what the panel takes."""
    parser = argparse.ArgumentParser(prog='benchmark.panel', description=__doc__)
    parser.add_argument('--rounds', type=int, default=ROUNDS)
    parser.add_argument('--seconds', type=float, default=WINDOW_S, help='of each window')
    arguments = parser.parse_args()
    without, beside, shares = measure(arguments.rounds, arguments.seconds)
    print('driver, the arm moves                 no panel   with panel and browser   ratio')
    for text, scale, one, other in (
        ('joint states per second', 1.0, without.rate, beside.rate),
        ('their age, median [ms]', 1e3, without.median_age, beside.median_age),
        ('their age, 99 of 100 [ms]', 1e3, without.late_age, beside.late_age),
        ('CPU of the driver [% of a core]', 1e2, without.driver, beside.driver),
    ):
        print(f'{text:34} {one * scale:11.2f} {other * scale:24.2f} {other / one:7.2f}')
    print(f'panel, at most {MAX_SHARE:.0%} of a core')
    for text, used in shares.items():
        print(f'{text:34} {used:11.1%}{"   TOO MUCH" if used > MAX_SHARE else ""}')


if __name__ == '__main__':
    main()
