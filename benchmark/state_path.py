# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`make bench`, the state path: from a controller's byte to the subscriber of `joint_states`.

The driver and the minimal program of `floor.py` run at the same time and receive the same messages
in turns, half a period apart, so that other load on the machine affects both equally. Latency:
from before the send until the subscriber has taken the message. CPU: of the whole process, all
threads, user and system, divided by the number of messages. This includes the driver's work per
second. Linux only.
"""

import argparse
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmark.state_sender import Order, serve
from benchmark.subscriber import Subscriber
from epson_driver.processes import processes

RATES_HZ = (182.0, 500.0, 1000.0)
"""182: the rate of an RC620."""

FIRST_BURST_HZ = 2000.0
BURST_FACTOR = 1.4
MAX_BURST_HZ = 30_000.0
MAX_LAG_S = 0.25
"""Time after the last message of a burst, s, after which a missing message counts as lost."""

WARM_UP = 400
PATIENCE_S = 60.0
FLOOR, OURS = range(2)
TOPICS = ('/floor/joint_states', '/joint_states')
REQUIRED = {'p50': 1.10, 'p99': 1.25, 'cpu': 1.20}
"""Maximum ratios of the driver's figures to the floor's."""


@dataclass(frozen=True)
class Window:
    """Figures of one program at one rate. Times in s. `lost`: messages."""

    p50: float
    p99: float
    cpu: float
    lost: int


@dataclass(frozen=True)
class Rate:
    """Both programs at one rate, with ratios of driver to floor. All are medians of the rounds."""

    rate: float
    floor: Window
    ours: Window
    ratios: dict[str, float]


class Course:
    """Both programs and the subscriber, running."""

    def __init__(
        self, pipe: Connection, subscriber: Subscriber, process_ids: Sequence[int]
    ) -> None:
        self._pipe = pipe
        self._subscriber = subscriber
        self._process_ids = process_ids
        self._next = 1

    def run(self, rate: float, messages: int, targets: tuple[int, ...]) -> list[Window]:
        """Send `messages` messages to each target and return each target's figures."""
        order = Order(rate, messages, targets, self._next)
        self._next += messages
        for target in targets:
            self._subscriber.taken(target)
        used = [cpu_time(self._process_ids[target]) for target in targets]
        self._pipe.send(order)
        sent = self._pipe.recv()
        until = time.monotonic() + MAX_LAG_S
        while time.monotonic() < until and any(
            self._subscriber.count(target) < messages for target in targets
        ):
            time.sleep(0.002)
        windows = []
        for place, target in enumerate(targets):
            cpu = (cpu_time(self._process_ids[target]) - used[place]) / messages
            came = self._subscriber.taken(target)
            ages = [
                came[order.first + number] - at
                for number, at in enumerate(sent[place])
                if order.first + number in came
            ]
            p50, p99 = np.percentile(ages, (50.0, 99.0)) if ages else (np.nan, np.nan)
            windows.append(Window(float(p50), float(p99), cpu, messages - len(ages)))
        self.last_rate = (messages - 1) / (sent[0][-1] - sent[0][0])
        return windows

    def compare(self, rate: float, seconds: float, rounds: int) -> Rate:
        """Return both programs' figures at one rate, as medians over some rounds."""
        pairs = []
        for turn in range(rounds):
            targets = (FLOOR, OURS) if turn % 2 else (OURS, FLOOR)
            windows = self.run(rate, round(rate * seconds), targets)
            result = dict(zip(targets, windows, strict=True))
            pairs.append((result[FLOOR], result[OURS]))

        def ratio(name: str) -> float:
            return statistics.median(
                float(getattr(ours, name) / getattr(floor, name)) for floor, ours in pairs
            )

        floors, drivers = zip(*pairs, strict=True)
        ratios = {name: ratio(name) for name in REQUIRED}
        return Rate(rate, median(floors), median(drivers), ratios)

    def highest(self, target: int, seconds: float) -> float:
        """Return the highest rate sent and received without loss, Hz."""
        best, rate = 0.0, FIRST_BURST_HZ
        while rate <= MAX_BURST_HZ:
            for _ in range(2):  # a second try: the machine may have been busy
                (window,) = self.run(rate, round(rate * seconds), (target,))
                if not window.lost:
                    break
            else:
                return best
            if self.last_rate <= best * 1.02:  # the sender has reached its maximum rate
                return best
            best = self.last_rate
            rate *= BURST_FACTOR
        return best


def median(windows: Sequence[Window]) -> Window:
    """Return the median of each figure, and the sum of the lost messages."""
    return Window(
        statistics.median(window.p50 for window in windows),
        statistics.median(window.p99 for window in windows),
        statistics.median(window.cpu for window in windows),
        sum(window.lost for window in windows),
    )


def cpu_time(process_id: int) -> float:
    """Return the CPU time of a process, all threads, s, from Linux's clock in ns."""
    return time.clock_gettime((~process_id << 3) | 2)


@contextmanager
def sender(drivers: int) -> Iterator[tuple[Connection, list[int]]]:
    """Run the sender. Yields its pipe and its ports, the motion port first."""
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, drivers), daemon=True)
    process.start()
    theirs.close()
    try:
        yield ours, ours.recv()
    finally:
        ours.close()
        process.join(1.0)
        process.kill()


@contextmanager
def course() -> Iterator[Course]:
    """Run both programs and the subscriber."""
    domain = processes.free_ros_domain()
    with TemporaryDirectory() as name, sender(2) as (pipe, (motion, floor_port, state)):
        folder = Path(name)
        floor = subprocess.Popen(
            [sys.executable, '-m', 'benchmark.floor', str(floor_port), TOPICS[FLOOR]],
            env=processes.ros_environment(domain),
        )
        try:
            ours = processes.client(
                folder / 'client.log',
                processes.Ports(motion, state, 0, 0),
                domain,
                state_timeout=30.0,
            )
            with processes.ended_at_exit(ours), Subscriber(domain, TOPICS) as subscriber:
                if not pipe.poll(PATIENCE_S):
                    raise TimeoutError('the programs do not connect')
                pipe.recv()
                until = time.monotonic() + PATIENCE_S
                while not all(subscriber.publishers(topic) for topic in (FLOOR, OURS)):
                    if time.monotonic() > until:
                        raise TimeoutError('no publishers')
                    time.sleep(0.1)
                time.sleep(1.0)  # discovery lists publishers before both are matched
                result = Course(pipe, subscriber, (floor.pid, ours.process_id))
                result.run(200.0, WARM_UP, (FLOOR, OURS))
                yield result
        finally:
            floor.kill()
            floor.wait()


def main() -> None:
    """Print both programs' figures and their ratios for each rate, and the highest rates."""
    parser = argparse.ArgumentParser(prog='benchmark.state_path', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='half a minute')
    quick = parser.parse_args().quick
    seconds, rounds, burst = (2.0, 1, 0.4) if quick else (4.0, 9, 1.0)
    load = os.getloadavg()[0]
    with course() as running:
        for rate in RATES_HZ:
            result = running.compare(rate, seconds, rounds)
            for name, most in REQUIRED.items():
                ours, floor = getattr(result.ours, name), getattr(result.floor, name)
                print(
                    f'{rate:4.0f} Hz, {name}: driver {ours * 1e6:6.0f} us, floor '
                    f'{floor * 1e6:6.0f} us, ratio {result.ratios[name]:.2f}, required {most:.2f}'
                    f'{"" if result.ratios[name] <= most else "  MISSED"}',
                    flush=True,
                )
            print(
                f'{rate:4.0f} Hz: the driver lost {result.ours.lost}, '
                f'the floor {result.floor.lost}'
            )
        ours, floor = running.highest(OURS, burst), running.highest(FLOOR, burst)
    print(f'highest rate without loss: driver {ours:.0f} Hz, floor {floor:.0f} Hz')
    print(f'load at the start {load:.1f}, at the end {os.getloadavg()[0]:.1f}')


if __name__ == '__main__':
    main()
