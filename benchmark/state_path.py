# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""State path: from the byte that a controller sends to the subscriber of `joint_states`.

The driver and the bare program of `floor.py` run at once and get the same messages in turns, half
a period apart, so that what else the machine does meets both alike. Latency: from before the send
to after the subscriber has taken the message. CPU: of the whole process, all threads, user and
system, divided by the messages; what the driver does by the second is in it.
"""

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
from benchmark.state_stages import Stages
from benchmark.subscriber import Subscriber
from epson_driver.processes import processes

RATES_HZ = (182.0, 500.0, 1000.0)
"""182: what an RC620 sends."""

FIRST_BURST_HZ = 2000.0
BURST_FACTOR = 1.4
MAX_BURST_HZ = 30_000.0
MAX_LAG_S = 0.25
"""After the last message of a burst, s: what has not come then is lost, or late for good."""

WARM_UP = 400
PATIENCE_S = 60.0
FLOOR, OURS, STAGES = range(3)
TOPICS = ('/floor/joint_states', '/joint_states', '/stages/joint_states')


@dataclass(frozen=True)
class Window:
    """What was seen of one program at one rate; times in s. `lost`: messages."""

    p50: float
    p99: float
    cpu: float
    lost: int


@dataclass(frozen=True)
class Rate:
    """Both programs at one rate, and the ratios, driver to floor; medians of the rounds."""

    rate: float
    floor: Window
    ours: Window
    p50_ratio: float
    p99_ratio: float
    cpu_ratio: float


@dataclass(frozen=True)
class StatePath:
    """All that was measured. highest: messages per second without loss, floor and driver."""

    rates: tuple[Rate, ...]
    highest: tuple[float, float]
    stages: Stages


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
        """Send so many messages to each target; return what was seen of it."""
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
        """Return both at one rate, in the median of some rounds."""
        pairs = []
        for turn in range(rounds):
            targets = (FLOOR, OURS) if turn % 2 else (OURS, FLOOR)
            windows = self.run(rate, round(rate * seconds), targets)
            found = dict(zip(targets, windows, strict=True))
            pairs.append((found[FLOOR], found[OURS]))

        def ratio(name: str) -> float:
            return statistics.median(
                float(getattr(ours, name) / getattr(floor, name)) for floor, ours in pairs
            )

        floors, drivers = zip(*pairs, strict=True)
        return Rate(
            rate, median(floors), median(drivers), ratio('p50'), ratio('p99'), ratio('cpu')
        )

    def highest(self, target: int, seconds: float) -> float:
        """Return the highest rate that was sent and came without loss, Hz."""
        best, rate = 0.0, FIRST_BURST_HZ
        while rate <= MAX_BURST_HZ:
            for _ in range(2):  # a second try: the machine may have been busy
                (window,) = self.run(rate, round(rate * seconds), (target,))
                if not window.lost:
                    break
            else:
                return best
            if self.last_rate <= best * 1.02:  # the sender cannot send faster, or is not let
                return best
            best = self.last_rate
            rate *= BURST_FACTOR
        return best


def median(windows: Sequence[Window]) -> Window:
    """Return the median of each figure; of lost messages all."""
    return Window(
        statistics.median(window.p50 for window in windows),
        statistics.median(window.p99 for window in windows),
        statistics.median(window.cpu for window in windows),
        sum(window.lost for window in windows),
    )


def cpu_time(process_id: int) -> float:
    """Return the CPU time that a process has used, all threads, s; Linux's clock of it, in ns."""
    return time.clock_gettime((~process_id << 3) | 2)


@contextmanager
def sender(drivers: int) -> Iterator[tuple[Connection, list[int]]]:
    """Run the sender; yield its pipe and its ports, that of motion first."""
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
def course() -> Iterator[tuple[Course, Subscriber, int]]:
    """Run everything; yield it, with the subscriber and the ROS domain."""
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
                time.sleep(1.0)  # discovery says who is there before both are matched
                found = Course(pipe, subscriber, (floor.pid, ours.process_id))
                found.run(200.0, WARM_UP, (FLOOR, OURS))
                yield found, subscriber, domain
        finally:
            floor.kill()
            floor.wait()


def stages(domain: int) -> Stages:
    """Run the stages one by one in a process of its own, in that domain."""
    result = subprocess.run(
        [sys.executable, '-m', 'benchmark.state_stages', TOPICS[STAGES]],
        env=processes.ros_environment(domain) | {'OMP_NUM_THREADS': '1'},
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    )
    return Stages.read(result.stdout)


def measure(*, quick: bool) -> StatePath:
    """Return what the state path costs."""
    seconds, rounds = (2.0, 1) if quick else (4.0, 3)
    with course() as (running, _, domain):
        rates = tuple(running.compare(rate, seconds, rounds) for rate in RATES_HZ)
        burst = 0.4 if quick else 1.0
        highest = (running.highest(FLOOR, burst), running.highest(OURS, burst))
        return StatePath(rates, highest, stages(domain))


def main() -> None:
    """Print the ratios."""
    found = measure(quick='--quick' in sys.argv)
    for rate in found.rates:
        print(rate, flush=True)
    print(found.highest, found.stages, os.getloadavg())


if __name__ == '__main__':
    main()
