# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the driver's memory stays flat: thousands of goals and service calls, one by one.

`make soak`: the real client and a simulated controller, 2,000 goals of a tenth of a second each
and 20,000 calls of `~/read_io`; what counts is the resident memory of the client's process, as
/proc has it. A goal and its result are kept for a minute for whoever asks late, so the goals of
the first 75 s are warm-up; so are the first 2,000 calls. Exit code 1 if the memory grew by more
than 1 MB after that. Linux only.
"""

import argparse
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from epson_msgs.msg import IoPoint
from epson_msgs.srv import ReadIo
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.cli import processes

PATIENCE_S = 60.0
WARM_UP_S = 75.0
"""Warm-up of goals, s: the driver keeps each for 60 s."""

WARM_UP_CALLS = 2_000
MAX_GROWTH_BYTES = 1_000_000
"""After the warm-up, bytes."""

LINES = 20
"""Of output for each kind of request."""

PAGE_BYTES = os.sysconf('SC_PAGE_SIZE')
JOINTS = [f'joint_{number}' for number in range(1, 7)]


@dataclass(frozen=True)
class Memory:
    """Resident memory of the client, bytes, after so many requests."""

    requests: int
    seconds: float
    resident: int


class User:
    """A node with a thread of its own that enables the arm, sends goals, and reads I/O."""

    def __init__(self, domain: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain)
        self._node = Node('user', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._action = ActionClient(
            self._node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory'
        )
        self._enable = self._node.create_client(Trigger, 'epson_driver/enable')
        self._read = self._node.create_client(ReadIo, 'epson_driver/read_io')
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()
        self._sent = 0

    def close(self) -> None:
        """End the thread and leave ROS."""
        self._executor.shutdown()
        self._thread.join(PATIENCE_S)
        self._node.destroy_node()
        self._context.shutdown()

    def enable(self) -> None:
        """Enable the arm, as soon as the driver has its links."""
        if not self._enable.wait_for_service(PATIENCE_S):
            raise TimeoutError('no service ~/enable')
        until = time.monotonic() + PATIENCE_S
        while not (answer := self._call(self._enable, Trigger.Request())).success:
            if time.monotonic() > until:
                raise RuntimeError(answer.message)
            time.sleep(0.2)
        if not self._action.wait_for_server(PATIENCE_S) or not self._read.wait_for_service(
            PATIENCE_S
        ):
            raise TimeoutError('no action, or no ~/read_io')

    def go(self) -> None:
        """Send a goal, to and fro, and wait for its result."""
        self._sent += 1
        message = JointTrajectory(joint_names=JOINTS)
        for step in range(2):
            joints = [0.005 * ((self._sent + step) % 2 == 0)] + [0.0] * 5
            time_from_start = Duration(nanosec=step * 100_000_000)
            point = JointTrajectoryPoint(positions=joints, time_from_start=time_from_start)
            message.points.append(point)
        goal = FollowJointTrajectory.Goal(trajectory=message)
        handle = self._complete(lambda: self._action.send_goal_async(goal))
        answer = self._complete(handle.get_result_async)
        if answer.result.error_code:  # a machine with too much to do: no STATUS for a second
            print(f'goal {self._sent}: {answer.result.error_string}', flush=True)
            self.enable()

    def read(self) -> None:
        """Read one input and wait for its value."""
        point = IoPoint(type=IoPoint.DIGITAL_INPUT, index=0)
        answer = self._call(self._read, ReadIo.Request(points=[point]))
        if not answer.success:
            raise RuntimeError(answer.message)

    def _call(self, client: Any, request: Any) -> Any:
        return self._complete(lambda: client.call_async(request))

    def _complete(self, send: Callable[[], Any]) -> Any:
        """Send in the thread that takes the answers, and wait for the answer."""
        answered = threading.Event()
        futures = []

        def begin() -> None:
            futures.append(send())
            futures[0].add_done_callback(lambda _: answered.set())

        self._executor.create_task(begin)
        if not answered.wait(PATIENCE_S):
            raise TimeoutError(f'no answer within {PATIENCE_S:g} s')
        return futures[0].result()


def resident(process_id: int) -> int:
    """Return the resident memory of a process, bytes."""
    return (
        int(Path(f'/proc/{process_id}/statm').read_text(encoding='ascii').split()[1]) * PAGE_BYTES
    )


def repeat(request: Callable[[], None], times: int, process_id: int) -> list[Memory]:
    """Make a request so many times; return the memory of the process on the way."""
    began, memories = time.monotonic(), []
    every = max(times // LINES, 1)
    for number in range(1, times + 1):
        request()
        if number % every == 0:
            memory = Memory(number, time.monotonic() - began, resident(process_id))
            memories.append(memory)
            print(
                f'{number:8} {memory.seconds:9.1f} {memory.resident / 1e6:12.2f}',
                flush=True,
            )
    return memories


def growth(memories: list[Memory], *, after: int = 0, seconds: float = 0.0) -> int:
    """Return by how many bytes the memory grew after so many requests and so many seconds."""
    warm = [
        each.resident for each in memories if each.requests >= after and each.seconds >= seconds
    ]
    return max(warm) - warm[0] if warm else 0


def soak(goals: int, calls: int, folder: Path) -> tuple[list[Memory], list[Memory]]:
    """Return the memory of the client while it has so many goals, and then so many calls."""
    domain = processes.free_ros_domain()
    controller = processes.sim_controller(folder / 'controller.log', '--motion=ptp')
    with processes.ended_at_exit(controller):
        # whatever else the machine does meanwhile: how fast it is does not matter here
        client = processes.client(
            folder / 'client.log',
            controller.ports(),
            domain,
            state_timeout=30.0,
            io_timeout=30.0,
            reply_timeout=30.0,
        )
        with processes.ended_at_exit(client):
            user = User(domain)
            try:
                user.enable()
                print('   goals      s   resident [MB]')
                of_goals = repeat(user.go, goals, client.process_id)
                print('   calls      s   resident [MB]')
                of_calls = repeat(user.read, calls, client.process_id)
            finally:
                user.close()
            if code := client.end():
                raise RuntimeError(f'the client ended with {code}:\n{client.log_text()}')
    return of_goals, of_calls


def main() -> int:
    """Print the memory, and say whether it stayed flat."""
    parser = argparse.ArgumentParser(prog='benchmark.soak', description=__doc__)
    parser.add_argument('--goals', type=int, default=2_000)
    parser.add_argument('--calls', type=int, default=20_000)
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        of_goals, of_calls = soak(arguments.goals, arguments.calls, Path(folder))
    grown = {
        'goals': growth(of_goals, seconds=WARM_UP_S),
        'calls': growth(of_calls, after=WARM_UP_CALLS),
    }
    for kind, size in grown.items():
        print(f'{kind}: {size / 1e6:.2f} MB more after the warm-up')
    return int(max(grown.values()) > MAX_GROWTH_BYTES)


if __name__ == '__main__':
    sys.exit(main())
