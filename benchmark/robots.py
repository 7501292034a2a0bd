# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a robot costs its driver: CPU time for 1, 4 and 16 robots, a process each or one for all.

`make bench`: simulated controllers at their usual rates (about 180 joint states and 18 status
messages a second), and one subscriber to every `joint_states`. First all arms are idle, then, of 1
and 4, one moves. Only the time of the client processes counts, as /proc has it; controllers and
subscriber share the machine. Rates below 180 Hz show that messages are late or lost, or that the
machine has too much to do: then the CPU time is too small as well. Linux only.
"""

import argparse
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from builtin_interfaces.msg import Duration
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.processes import processes

COUNTS = (1, 4, 16)
WINDOW_S = 5.0
PATIENCE_S = 120.0
MAX_FEW_ROBOTS = 4
"""With more robots, what one of them needs more is lost in the noise of the others."""

SETTLING_S = 3.0
"""For discovery, and for what is loaded when it is first used, s."""

TICK_S = 1.0 / os.sysconf('SC_CLK_TCK')
JOINTS = [f'joint_{number}' for number in range(1, 7)]


@dataclass(frozen=True)
class Figures:
    """One run. CPU in shares of a core (0.1 is 10 %), rates of each robot's joint states in Hz."""

    idle: float
    """Of one robot, while all are idle."""
    moving: float | None
    """What all robots need more while one of them moves: a difference of two sums; None for more
    than MAX_FEW_ROBOTS."""
    rates: tuple[float, ...]
    """First while all are idle, then while one moves, if it does."""


class Listener:
    """Counts the joint states of robots, and moves one of them. A node with its own thread."""

    def __init__(self, domain: int, names: Sequence[str]) -> None:
        self.counts = dict.fromkeys(names, 0)
        self._context = Context()
        self._context.init(domain_id=domain)
        self._node = Node('listener', context=self._context)
        for name in names:
            # raw: what it costs to read them is not what is measured
            self._node.create_subscription(
                JointState, f'/{name}/joint_states', partial(self._count, name), 100, raw=True
            )
        mover = f'/{names[0]}/epson_driver'
        self._enable = self._node.create_client(Trigger, f'{mover}/enable')
        self._trajectory = self._node.create_publisher(
            JointTrajectory, f'{mover}/joint_trajectory', 10
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._heard = Future()
        self._thread = threading.Thread(
            target=self._executor.spin_until_future_complete, args=(self._heard,), daemon=True
        )
        self._thread.start()

    def _count(self, name: str, _message: bytes) -> None:
        self.counts[name] += 1

    def wait_for_all(self) -> None:
        """Wait until every robot is heard. Raises TimeoutError that names those that are not."""
        until = time.monotonic() + PATIENCE_S
        while silent := [name for name, count in self.counts.items() if not count]:
            if time.monotonic() > until:
                raise TimeoutError(f'no joint states from {", ".join(silent)}')
            time.sleep(0.1)

    def move(self, seconds: float) -> None:
        """Have the first robot move to and fro for a while."""
        if not self._enable.wait_for_service(PATIENCE_S):
            raise TimeoutError('no service ~/enable')
        answered = threading.Event()
        future = self._enable.call_async(Trigger.Request())
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(PATIENCE_S) or not future.result().success:
            raise RuntimeError(f'the arm was not enabled: {future.result()}')
        message = JointTrajectory(joint_names=JOINTS)
        for second in range(int(seconds) + 1):
            joints = [0.3 * (second % 2)] + [0.0] * 5
            message.points.append(
                JointTrajectoryPoint(positions=joints, time_from_start=Duration(sec=second))
            )
        self._trajectory.publish(message)

    def close(self) -> None:
        """End the thread and leave ROS."""
        self._heard.set_result(None)
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.shutdown()


AnyListener = TypeVar('AnyListener', bound=Listener)


def cpu_time(process_id: int) -> float:
    """Return the CPU time that a process has used, all threads, user and system, s."""
    text = Path(f'/proc/{process_id}/stat').read_text(encoding='ascii')
    fields = text.rpartition(')')[2].split()  # the name before may have spaces
    return (int(fields[11]) + int(fields[12])) * TICK_S


@contextmanager
def running(
    robots: int, together: bool, folder: Path, new_listener: type[AnyListener]
) -> Iterator[tuple[list[int], AnyListener]]:
    """Run controllers, drivers and a listener; yield the drivers' process ids and the listener."""
    names = [f'robot_{number}' for number in range(1, robots + 1)]
    domain = processes.free_ros_domain()
    with ExitStack() as stack:
        controllers = {}
        for name in names:
            log = folder / f'{name}.log'
            controllers[name] = processes.sim_controller(log, '--motion=ptp')
            stack.enter_context(processes.ended_at_exit(controllers[name]))
        ports = {name: controller.ports() for name, controller in controllers.items()}
        clients = []
        for group in [names] if together else [[name] for name in names]:
            log = folder / f'client_{group[0]}.log'
            clients.append(processes.clients(log, {name: ports[name] for name in group}, domain))
            stack.enter_context(processes.ended_at_exit(clients[-1]))
        listener = new_listener(domain, names)
        stack.callback(listener.close)
        listener.wait_for_all()
        yield [client.process_id for client in clients], listener


def measure(robots: int, together: bool, seconds: float) -> Figures:
    """Run so many robots, idle for so long, s, then with one moving, and return what they cost."""
    with (
        TemporaryDirectory() as folder,
        running(robots, together, Path(folder), Listener) as (process_ids, listener),
    ):
        time.sleep(SETTLING_S)
        idle, rates = _window(process_ids, listener, seconds)
        if robots > MAX_FEW_ROBOTS:
            return Figures(idle / robots, None, rates)
        listener.move(seconds + 2.0)
        time.sleep(1.0)
        moving, more_rates = _window(process_ids, listener, seconds)
    return Figures(idle / robots, moving - idle, rates + more_rates)


def _window(
    process_ids: Sequence[int], listener: Listener, seconds: float
) -> tuple[float, tuple[float, ...]]:
    """Return the cores that the processes use in the next seconds, and the robots' rates, Hz."""
    counted, began = dict(listener.counts), time.monotonic()
    used = sum(map(cpu_time, process_ids))
    time.sleep(seconds)
    used = sum(map(cpu_time, process_ids)) - used
    lasted = time.monotonic() - began
    rates = ((listener.counts[name] - counted[name]) / lasted for name in counted)
    return used / lasted, tuple(rates)


def main() -> None:
    """Print a row for each shape and number of robots."""
    parser = argparse.ArgumentParser(prog='benchmark.robots', description=__doc__)
    parser.add_argument('--robots', type=int, nargs='+', default=COUNTS, metavar='N')
    parser.add_argument('--seconds', type=float, default=WINDOW_S, help='of each window')
    arguments = parser.parse_args()
    print(
        'CPU of the drivers, in % of a core; joint states per second, of the slowest and fastest'
    )
    print('robots            a robot, idle   / first   one that moves: more   joint states')
    for together in (False, True):
        first = 0.0
        for robots in arguments.robots:
            figures = measure(robots, together, arguments.seconds)
            first = first or figures.idle
            more = '-' if figures.moving is None else f'{figures.moving * 100:.1f}'
            shape = 'one process' if together else 'a process each'
            print(
                f'{robots:2} {shape:14}   {figures.idle * 100:11.1f}   {figures.idle / first:7.2f}'
                f'   {more:>20}'
                f'   {min(figures.rates):5.1f} {max(figures.rates):6.1f}',
                flush=True,
            )


if __name__ == '__main__':
    main()
