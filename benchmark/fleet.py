# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How robots find each other, and what it costs the network: 1, 4, 16 and 32 of them.

`make bench-fleet`: a network of hosts that is all within this machine (benchmark/hosts.py). Each
robot's driver is on a host of its own, or one process on one host drives them all; they find each
other by simple discovery, as ROS does it by itself, or by a discovery server of Fast DDS. Nobody
has a controller, so what passes the cables is discovery, and once a second the diagnostics of each
driver. Then the same with a controller: what joint states cost per subscriber.

Writes fleet.json, fleet.md and fleet.png to benchmark/results. Linux only.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from threading import Thread

from benchmark.fleet_results import Case, Data, Results, write
from benchmark.hosts import Network, NoNamespacesError, Traffic
from epson_driver.cli import processes
from epson_driver.cli.discovery_server import USUAL_PORT, VARIABLE, discovery_server
from epson_driver.cli.fleet_processes import robot_names
from epson_driver.cli.process_figures import cpu_time
from epson_driver.cli.processes import EXECUTABLE, Process

COUNTS = (1, 4, 16, 32)
MAX_QUICK_ROBOTS = 4
WINDOW_S = 10.0
SETTLING_S = 5.0
"""Until all have heard of each other, after one has heard of all, s."""

PATIENCE_S = 240.0
FOUND_WITHIN_S = 60.0
"""Robots that the benchmark has not heard of for so long count as not found, s."""
DOMAIN = '1'
OFFICE, NEWCOMER, SERVER, ALL_ROBOTS = 'office', 'newcomer', 'server', 'robots'
OBSERVER = (sys.executable, str(Path(__file__).with_name('fleet_observer.py')))
RESULTS = Path(__file__).parent / 'results'


class NotSaidError(TimeoutError):
    """Nothing of some robots, `left`, for so many seconds; `last` is when it was said last."""

    def __init__(self, what: str, left: frozenset[str], last: float, seconds: float) -> None:
        super().__init__(f'{what}: not said of {", ".join(sorted(left))} in {seconds:g} s')
        self.left = left
        self.last = last


class Sight:
    """An observer on a host: its lines, as they come."""

    def __init__(
        self, host: Sequence[str], names: Sequence[str], environment: dict[str, str], *words: str
    ) -> None:
        self._names = tuple(names)
        self._process = subprocess.Popen(
            [*host, *OBSERVER, *names, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self._lines: SimpleQueue[list[str]] = SimpleQueue()
        self.said: list[tuple[str, str]] = []
        """What it has said of which robot, as far as somebody has waited for it."""
        self.created = 0.0
        """When it became a participant, s."""
        Thread(target=self._read, daemon=True).start()

    def wait_for(self, what: str, *names: str, patience: float = PATIENCE_S) -> float:
        """Wait until it has said this of these robots, or of all, since then; return when, s.

        Raises NotSaidError if it does not say it of some of them.
        """
        left = set(names or self._names)
        until = time.monotonic() + patience
        last = self.created
        while left:
            try:
                words = self._lines.get(timeout=max(until - time.monotonic(), 0.0))
            except Empty:
                raise NotSaidError(what, frozenset(left), last, patience) from None
            if words[0] == 'created':
                self.created = float(words[1])
                continue
            self.said.append((words[0], words[1]))
            if words[0] == what and words[1] in left:
                left.discard(words[1])
                last = float(words[2])
        return last

    def wait_for_most(self, what: str) -> tuple[float, int]:
        """Return when it said this last, s, and of how many robots it never did."""
        try:
            return self.wait_for(what, patience=FOUND_WITHIN_S), 0
        except NotSaidError as error:
            print(f'{error}; going on', file=sys.stderr, flush=True)
            return error.last, len(error.left)

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()

    def _read(self) -> None:
        if self._process.stdout is not None:
            with self._process.stdout as lines:
                for line in lines:
                    self._lines.put(line.split())


def environment(network: Network, *, server: bool) -> dict[str, str]:
    """Return that of the programs on all hosts: ROS as it is by default, but for the server."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith('ROS_')}
    own = {'ROS_DOMAIN_ID': DOMAIN, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    if server:
        own[VARIABLE] = f'{network.address(SERVER)}:{USUAL_PORT}'
    return kept | own


@contextmanager
def hosts(names: Sequence[str], *, server: bool) -> Iterator[tuple[Network, dict[str, str], Path]]:
    """Make a network, with a discovery server on one more host; yield what programs on it need."""
    with (
        Network([*names, *([SERVER] if server else [])]) as network,
        TemporaryDirectory() as folder,
        ExitStack() as stack,
    ):
        if server:
            log, run = Path(folder, 'server.log'), network.run(SERVER)
            process = discovery_server(log, network.address(SERVER), run=run)
            stack.callback(process.end)
        yield network, environment(network, server=server), Path(folder)


def driver(
    network: Network, host: str, names: Sequence[str], log: Path, variables: dict[str, str]
) -> Process:
    """Start a driver for these robots on a host."""
    words = [word for name in names for word in ('--namespace', name)]
    return Process('client', words, log, variables, (*network.run(host), *EXECUTABLE))


def measure(robots: int, *, together: bool, server: bool, seconds: float) -> Case:
    """Have so many drivers start at once; return how they found each other, and what it took."""
    names = robot_names(robots)
    groups = {ALL_ROBOTS: names} if together else {name: (name,) for name in names}
    with (
        hosts([*groups, OFFICE, NEWCOMER], server=server) as (network, variables, folder),
        ExitStack() as stack,
    ):
        observer = Sight(network.run(OFFICE), names, variables)
        stack.callback(observer.close)
        began, before = time.monotonic(), network.traffic()
        drivers: list[Process] = []
        stack.callback(processes.end_together, drivers)
        for host, group in groups.items():
            log = folder / f'{host}.log'
            drivers.append(driver(network, host, group, log, variables))
        seen, unseen = observer.wait_for_most('seen')
        for each in drivers:
            each.check_alive()
        started = sum(cpu_time(each.process_id) for each in drivers)
        time.sleep(SETTLING_S)
        start = network.traffic().since(before)
        steady, idle = _steady(network, drivers, seconds)
        before, asked = network.traffic(), time.monotonic()
        newcomer = Sight(network.run(NEWCOMER), names, variables)
        stack.callback(newcomer.close)
        found, newcomer_unseen = newcomer.wait_for_most('seen')
        time.sleep(SETTLING_S)
        joined = network.traffic().since(before)
        lasted = time.monotonic() - asked
        return Case(
            robots=robots,
            together=together,
            server=server,
            seen_s=seen - began,
            unseen=unseen,
            newcomer_s=found - newcomer.created,
            newcomer_unseen=newcomer_unseen,
            start_packets=start.packets,
            start_bytes=start.bytes,
            newcomer_packets=max(joined.packets - steady.packets / seconds * lasted, 0.0),
            newcomer_bytes=max(joined.bytes - steady.bytes / seconds * lasted, 0.0),
            packets_per_s=steady.packets / seconds,
            bytes_per_s=steady.bytes / seconds,
            start_cpu_s=started,
            idle_cores=idle,
        )


def measure_data(subscribers: int, seconds: float) -> Data:
    """Have a robot send its joint states to so many other hosts; return what passes its cable."""
    listening = [f'listener_{number}' for number in range(1, subscribers + 1)]
    with (
        hosts(['robot_1', *listening, OFFICE], server=False) as (network, variables, folder),
        ExitStack() as stack,
    ):
        run = (*network.run('robot_1'), *EXECUTABLE)
        controller = Process('sim_controller', [], folder / 'controller.log', variables, run)
        stack.callback(controller.end)
        controller.ports()
        client = driver(network, 'robot_1', ['robot_1'], folder / 'client.log', variables)
        stack.callback(client.end)
        observer = Sight(network.run(OFFICE), ['robot_1'], variables)
        stack.callback(observer.close)
        observer.wait_for('seen')
        for name in listening:
            listener = Sight(network.run(name), ['robot_1'], variables, '--states')
            stack.callback(listener.close)
            listener.wait_for('heard')
        time.sleep(SETTLING_S)
        before = network.traffic('robot_1')
        time.sleep(seconds)
        sent = network.traffic('robot_1').since(before)
        return Data(subscribers, sent.packets / seconds, sent.bytes / seconds)


def _steady(network: Network, drivers: Sequence[Process], seconds: float) -> tuple[Traffic, float]:
    """Return what passes in the next seconds, and the cores that the drivers use meanwhile."""
    before = network.traffic()
    used = sum(cpu_time(each.process_id) for each in drivers)
    time.sleep(seconds)
    used = sum(cpu_time(each.process_id) for each in drivers) - used
    return network.traffic().since(before), used / seconds


def main() -> int:
    """Run all cases, and write what came of them."""
    parser = argparse.ArgumentParser(prog='benchmark.fleet', description=__doc__)
    parser.add_argument('--robots', type=int, nargs='+', metavar='N', default=COUNTS)
    parser.add_argument('--quick', action='store_true', help=f'up to {MAX_QUICK_ROBOTS} robots')
    parser.add_argument('--seconds', type=float, default=WINDOW_S, help='of each window')
    parser.add_argument('--folder', type=Path, default=RESULTS, help='where to write')
    arguments = parser.parse_args()
    counts = [n for n in arguments.robots if not arguments.quick or n <= MAX_QUICK_ROBOTS]
    cases = []
    try:
        for robots in counts:
            for together in (False, True) if robots > 1 else (False,):
                for server in (False, True):
                    case = measure(
                        robots, together=together, server=server, seconds=arguments.seconds
                    )
                    print(json.dumps(case.as_dict()), flush=True)
                    cases.append(case)
        data = [measure_data(subscribers, arguments.seconds) for subscribers in (0, 1, 2)]
    except NoNamespacesError as error:
        print(f'benchmark.fleet: {error}', file=sys.stderr)
        return 1
    write(arguments.folder, Results(cases, data))
    print((arguments.folder / 'fleet.md').read_text(encoding='utf-8'))
    return 0


if __name__ == '__main__':
    sys.exit(main())
