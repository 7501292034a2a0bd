# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver fleet`: runs simulated robots with a discovery server, and shows their state."""

import math
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from epson_driver.cli.arguments import Parser, parsed
from epson_driver.inputs import count, number, printable
from epson_driver.node.ros_process import polled_subscription, take_all, udp_by_default
from epson_driver.processes import interrupt, processes
from epson_driver.processes.processes import Process, RunError

PROGRAM, START_TIMEOUT_S = 'fast-discovery-server', 300.0
SERVER, RANGE = 'ROS_DISCOVERY_SERVER', 'ROS_AUTOMATIC_DISCOVERY_RANGE'
WINDOW_S, QUEUE = 2.0, 2000
"""Averaging interval of the table, s, and maximum number of joint states in an interval."""


class Row(NamedTuple):
    name: str
    state: str  # the driver's link state, or the process that has ended
    rate: float  # rate of the joint states, Hz
    cpu: float  # cores in use
    memory: int  # memory in use, bytes

    @property
    def up(self) -> bool:
        return self.state == 'connected' and self.rate > 0.0


class Fleet:
    """Measures link state, joint state rate, CPU and memory of running robots.

    `robots`: namespace of a robot → its driver process and its controller process.
    """

    def __init__(self, robots: dict[str, tuple[Process, Process]]) -> None:
        self._robots = robots
        self._links = dict.fromkeys(robots, 'silent')
        with udp_by_default():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node('fleet')
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._topics = {
            name: (
                polled_subscription(node, String, f'/{name}/epson_driver/link_state', latched),
                polled_subscription(node, JointState, f'/{name}/joint_states', QUEUE, raw=True),
            )
            for name in robots
        }

    def rows(self) -> list[Row]:
        for _, states in self._topics.values():
            take_all(states, QUEUE)
        before, start = {name: _use(both) for name, both in self._robots.items()}, time.monotonic()
        time.sleep(WINDOW_S)
        duration, rows = time.monotonic() - start, []
        for name, both in self._robots.items():
            (cpu, memory), (link, states) = _use(both), self._topics[name]
            for message in take_all(link, 1):
                self._links[name] = message.data
            ended = [f'{p.name} ended: {p.returncode}' for p in both if p.returncode is not None]
            state, rate = (*ended, self._links[name])[0], len(take_all(states, QUEUE)) / duration
            rows.append(Row(name, state, rate, max(cpu - before[name][0], 0.0) / duration, memory))
        return rows


def _use(robot: tuple[Process, Process]) -> tuple[float, int]:
    """Return the CPU time, s, and the memory, bytes, that a robot's processes use."""
    ticks = memory = 0
    for process in robot:
        folder = Path('/proc', str(process.process_id))
        with suppress(OSError):  # it has ended
            fields = (folder / 'stat').read_text('ascii').rpartition(')')[2].split()
            pss = re.search(r'(?m)^Pss:\s+(\d+)', (folder / 'smaps_rollup').read_text('ascii'))
            ticks += int(fields[11]) + int(fields[12])
            memory += int(pss[1]) * 1024 if pss else 0
    return ticks / os.sysconf('SC_CLK_TCK'), memory


def table(rows: list[Row]) -> Table:
    shown = Table(box=None, show_footer=True, padding=(0, 2, 0, 0))
    totals = (min(r.rate for r in rows), sum(r.cpu for r in rows), sum(r.memory for r in rows))
    footers = ('all', f'{sum(row.up for row in rows)} of {len(rows)}', *_figures(*totals))
    for title, footer in zip(('robot', 'up', 'states', 'CPU', 'memory'), footers, strict=True):
        shown.add_column(title, footer)
    for row in rows:
        state = '[green]yes[/]' if row.up else f'[bold red]{row.state.replace("_", " ")}[/]'
        shown.add_row(row.name, state, *_figures(row.rate, row.cpu, row.memory))
    return shown


def _figures(rate: float, cpu: float, memory: int) -> tuple[str, str, str]:
    return f'{rate:.0f} Hz', f'{cpu * 100:.0f} %', f'{memory / 1e6:.0f} MB'


@contextmanager
def running_fleet(folder: Path, size: int) -> Iterator[tuple[Fleet, list[str]]]:
    """Run `size` robots in a ROS domain of this machine until the block ends.

    Logs are written to `folder`. Yields the fleet, and the environment variables with which
    another terminal can see the robots. Raises RunError if a process cannot be started. The
    discovery server uses no shared memory, because the files left by killed processes in /dev/shm
    can block its answers.
    """
    by_pip = Path(sys.executable).with_name(PROGRAM)
    server = shutil.which(str(by_pip)) or shutil.which(PROGRAM)
    if server is None:
        raise RunError(f'no {PROGRAM}: it comes with Fast DDS (apt install ros-jazzy-fastrtps)')
    domain = processes.free_ros_domain()
    port = str(processes.port_beside(domain))
    own = os.environ | {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4', SERVER: ''}
    running: list[Process] = []

    def start(make: Callable[..., Process], log: str, *words: Any) -> Process:
        running.insert(0, make(folder / f'{log}.log', *words))  # drivers end first
        return running[0]

    try:
        words = ['-i', '0', '-l', '127.0.0.1', '-p', port]
        start(lambda log: Process(server, words, log, own, ()), 'server')
        os.environ |= processes.ros_environment(domain) | {SERVER: f'127.0.0.1:{port}'}
        names = [f'robot_{index}' for index in range(1, size + 1)]
        arms = {name: start(processes.sim_controller, name) for name in names}
        robots = {
            name: (start(processes.clients, f'{name}_driver', {name: arm.ports()}, domain), arm)
            for name, arm in arms.items()
        }
        exported = [f'{name}={os.environ[name]}' for name in ('ROS_DOMAIN_ID', RANGE, SERVER)]
        yield Fleet(robots), [*exported, 'ROS_SUPER_CLIENT=TRUE  # for ros2 topic list']
    finally:
        rclpy.try_shutdown()
        processes.end_together(running)


def main() -> int:
    parser = Parser(
        'fleet',
        'Run simulated robots, their drivers and a discovery server, and show their state.',
        ('fleet', 'fleet --robots 16 --seconds 60'),
        '0 all robots were up until the end, 1 some were not, 2 invalid arguments, '
        '130 Ctrl-C before all were up',
    )
    parser.option('--robots N', 'number of robots', count(1, 64), 4)
    text = 'run time, s (default: until Ctrl-C)'
    parser.option('--seconds S', text, number(0.1, 1e6, 's'), math.inf)
    arguments = parsed(parser, refused='fleet simulates its robots: choose them with --robots')
    console = Console(highlight=False)
    interrupt.raise_at_first_signal()
    up, rows = False, list[Row]()
    try:
        with (
            tempfile.TemporaryDirectory(prefix='epson_driver_fleet_') as folder,
            running_fleet(Path(folder), arguments.robots) as (fleet, where),
        ):
            until = time.monotonic() + START_TIMEOUT_S
            with Live(console=console, auto_refresh=False) as live:
                while time.monotonic() < until:
                    rows = fleet.rows()
                    live.update(table(rows), refresh=True)
                    if not up and all(row.up for row in rows):
                        up, until = True, time.monotonic() + arguments.seconds
                        console.print(
                            '\nexport '.join(('all up until Ctrl-C. In another terminal:', *where))
                        )
            console.line()
            return 0 if all(row.up for row in rows) else 1
    except (RunError, OSError) as error:
        console.print(f'[bold red]fleet failed:[/] {escape(printable(error))}', soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        console.print('\nall ended')
        return 0 if up else interrupt.INTERRUPTED
