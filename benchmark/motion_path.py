# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion path: goal accepted, first point on the wire, first movement; and whole downloads.

The real driver and a simulated controller, with a relay between them on the motion port that notes
when each point passes; it is in this process, as the user of the action is, so that all times are
of one clock. Goals are canceled as soon as the arm moves: what counts is how they begin.
"""

import asyncio
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from benchmark.goal_length import slow_wave
from epson_driver.processes import processes
from epson_driver.simple_message import JointTrajPt, PacketFramer, SpecialSequence

PATIENCE_S = 120.0
MOVED_RAD = 1e-4
GOAL_POINTS = 500
DOWNLOAD_POINTS = 1000
THESIS_DEAD_TIME_S = 11.5
"""Measured in the thesis: 11 to 12 s for 1000 points."""

LENGTHS = (10, 1_000, 10_000, 100_000)
KILOBYTE = 1024


@dataclass(frozen=True)
class Beginning:
    """How a goal began. Times in s, from when it was accepted.

    memory: what the driver needed more, at most, until the arm moved, bytes.
    """

    points: int
    asked: float
    """From sending the goal until it was accepted."""
    first_point: float
    last_point: float
    """Of a download; of others, the last one that was sent before the goal was canceled."""
    movement: float
    memory: int


@dataclass(frozen=True)
class MotionPath:
    """Medians of goals of GOAL_POINTS, goals of other lengths, and of a download."""

    goal: Beginning
    lengths: tuple[Beginning, ...]
    download: Beginning


class Relay(threading.Thread):
    """Passes bytes between the driver and a controller's motion port, and notes the points."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.points: list[tuple[float, int]] = []
        """When each passed, monotonic, s, and its sequence."""
        self.port = 0
        self._to = port
        self._listening = threading.Event()
        self._loop = asyncio.new_event_loop()
        self.start()
        self._listening.wait()

    def run(self) -> None:
        """Relay until `stop`."""
        self._loop.run_until_complete(self._listen())
        self._loop.run_forever()

    def stop(self) -> None:
        """End the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self.join()
        self._loop.close()

    async def _listen(self) -> None:
        self._server = await asyncio.start_server(self._serve, '127.0.0.1', 0)
        self.port = self._server.sockets[0].getsockname()[1]
        self._listening.set()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection('127.0.0.1', self._to)
        framer = PacketFramer()

        def note(data: bytes) -> None:
            now = time.monotonic()
            framer.receive_data(data)
            while (packet := framer.next_packet()) is not None:
                message = packet.message
                if isinstance(message, JointTrajPt):
                    self.points.append((now, message.sequence))

        await asyncio.gather(_pump(reader, back, note), _pump(there, writer, lambda _: None))


async def _pump(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, note: Callable[[bytes], None]
) -> None:
    try:
        while data := await reader.read(65536):
            writer.write(data)
            note(data)
    except OSError:
        return
    finally:
        writer.close()


class User:
    """Sends goals, and sees when the arm moves: a node with a thread of its own."""

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
        self._node.create_subscription(JointState, 'joint_states', self._see, 100)
        self._joints: tuple[float, ...] = ()
        self._at: float | None = None
        self._moved = threading.Event()
        self._moved_at = 0.0
        self._accepted_at = 0.0
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

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
        if not self._action.wait_for_server(PATIENCE_S):
            raise TimeoutError('no action')

    def begin(
        self, points: int, process_id: int, relay: Relay, last: int | None = None
    ) -> Beginning:
        """Send a goal, cancel it when the arm moves, and return how it began.

        `last`: the sequence of the last point, which must have passed, too.
        """
        goal = FollowJointTrajectory.Goal(trajectory=slow_wave(points, self._joints[0]))
        for point in goal.trajectory.points:
            point.positions[1:] = type(point.positions)('d', self._joints[1:])
        self._moved.clear()
        relay.points.clear()
        before = memory(process_id)
        sent = time.monotonic()
        self._at = self._joints[0]
        handle = self._complete(lambda: self._action.send_goal_async(goal), self._note_accepted)
        result = self._complete_later(handle.get_result_async)
        if not self._moved.wait(PATIENCE_S):
            raise TimeoutError(
                f'the arm does not move: {result[0][0].result().result.error_string}'
            )
        until = time.monotonic() + PATIENCE_S
        while last is not None and relay.points[-1][1] != last and time.monotonic() < until:
            time.sleep(0.01)
        most = memory(process_id)
        passed = list(relay.points)
        self._complete(handle.cancel_goal_async)
        result[1].wait(PATIENCE_S)
        accepted = self._accepted_at
        return Beginning(
            points,
            accepted - sent,
            passed[0][0] - accepted,
            passed[-1][0] - accepted,
            self._moved_at - accepted,
            most - before,
        )

    def _note_accepted(self) -> None:
        self._accepted_at = time.monotonic()

    def _see(self, message: JointState) -> None:
        self._joints = tuple(message.position)
        if self._at is not None and abs(self._joints[0] - self._at) > MOVED_RAD:
            self._moved_at = time.monotonic()
            self._at = None
            self._moved.set()

    def _call(self, client: Any, request: Any) -> Any:
        return self._complete(lambda: client.call_async(request))

    def _complete(self, send: Callable[[], Any], done: Callable[[], None] = lambda: None) -> Any:
        futures, answered = self._complete_later(send, done)
        if not answered.wait(PATIENCE_S):
            raise TimeoutError(f'no answer within {PATIENCE_S:g} s')
        return futures[0].result()

    def _complete_later(
        self, send: Callable[[], Any], done: Callable[[], None] = lambda: None
    ) -> tuple[list[Any], threading.Event]:
        """Send in the thread that takes the answers."""
        answered = threading.Event()
        futures: list[Any] = []

        def finish(_future: Any) -> None:
            done()
            answered.set()

        def begin() -> None:
            futures.append(send())
            futures[0].add_done_callback(finish)

        self._executor.create_task(begin)
        return futures, answered


def memory(process_id: int) -> int:
    """Return the most resident memory that a process had since the last call, bytes; Linux."""
    status = Path(f'/proc/{process_id}/status').read_text(encoding='ascii')
    most = next(line for line in status.splitlines() if line.startswith('VmHWM'))
    Path(f'/proc/{process_id}/clear_refs').write_text('5', encoding='ascii')
    return int(most.split()[1]) * KILOBYTE


@contextmanager
def running(controller: str, interface: str) -> Iterator[tuple[User, Relay, int]]:
    """Run a controller, a relay and a driver; yield the user, the relay, the driver's process."""
    with TemporaryDirectory() as name, ExitStack() as stack:
        folder, domain = Path(name), processes.free_ros_domain()
        simulated = processes.sim_controller(
            folder / 'controller.log', f'--controller={controller}'
        )
        stack.enter_context(processes.ended_at_exit(simulated))
        ports = simulated.ports()
        relay = Relay(ports.motion)
        stack.callback(relay.stop)
        driver = processes.client(
            folder / 'client.log',
            processes.Ports(relay.port, ports.state, 0, ports.remote),
            domain,
            controller=controller,
            interface=interface,
        )
        stack.enter_context(processes.ended_at_exit(driver))
        user = User(domain)
        stack.callback(user.close)
        user.enable()
        yield user, relay, driver.process_id


def measure(*, quick: bool) -> MotionPath:
    """Return how goals begin."""
    repeats = 3 if quick else 9
    with running('rc620', 'streaming') as (user, relay, process_id):
        user.begin(GOAL_POINTS, process_id, relay)
        goals = [user.begin(GOAL_POINTS, process_id, relay) for _ in range(repeats)]
        lengths = LENGTHS[:-1] if quick else LENGTHS
        longer = tuple(user.begin(points, process_id, relay) for points in lengths)
    last = SpecialSequence.END_TRAJECTORY
    with running('generic', 'download') as (user, relay, process_id):
        user.begin(10, process_id, relay, last)
        downloads = [user.begin(DOWNLOAD_POINTS, process_id, relay, last) for _ in range(repeats)]
    return MotionPath(_median(goals), longer, _median(downloads))


def _median(beginnings: list[Beginning]) -> Beginning:
    names = ('asked', 'first_point', 'last_point', 'movement')
    middle = {
        name: statistics.median(getattr(each, name) for each in beginnings) for name in names
    }
    return Beginning(beginnings[0].points, **middle, memory=max(b.memory for b in beginnings))


if __name__ == '__main__':
    print(measure(quick=True))
