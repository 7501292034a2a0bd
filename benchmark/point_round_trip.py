# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Round trip of a point: our goal and our link beside bare asyncio streams, to the same echo.

The echo is a process with asyncio streams that answers each JOINT_TRAJ_PT with the same reply. All
ways take turns, some hundred points each.

All processes share one core, so that a round trip is what both ends compute, and what the system
does to switch between them. On two cores it is mostly how long the other one takes to wake, on a
virtual machine up to ten times the rest: it depends on where the scheduler has put the two.

* bare: `writer.write`, `readexactly`, struct
* link: `Link.post`, and the next one when the reply comes
* goal: what a trajectory does: points that are made, timed and scaled, sent through the delivery,
  each when the reply to the one before has come
* PING: the same by a link to the simulated controller, both ends ours; it has no floor of its own
"""

import asyncio
import multiprocessing
import os
import statistics
import struct
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.streaming import Streaming
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.state.joint_mapping import unmapped
from epson_driver.link import Link, LinkState
from epson_driver.motion import Trajectory
from epson_driver.processes import processes
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import JointTrajPt, Message, Packet, Ping

POINT = struct.Struct('<4ii12f')
REPLY = struct.Struct('<4ii10f')
ANSWER = REPLY.pack(56, 10, 3, 1, 0, *(0.0,) * 10)
POINT_PERIOD_S = 0.004
CONNECT_TIMEOUT_S = 30.0
LIMITS = load_robot_model('c3_a601s').limits


@dataclass(frozen=True)
class RoundTrips:
    """Time of one round trip, s, and the medians of the ratios to bare, block by block."""

    bare: float
    link: float
    goal: float
    ping: float
    link_ratio: float
    goal_ratio: float
    ping_ratio: float


def serve_echo(pipe: Connection) -> None:
    """Answer points until the pipe ends."""
    asyncio.run(_serve(pipe))


async def _serve(pipe: Connection) -> None:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                POINT.unpack(await reader.readexactly(POINT.size))
                writer.write(ANSWER)
        except asyncio.IncompleteReadError:
            writer.close()

    server = await asyncio.start_server(answer, '127.0.0.1', 0)
    pipe.send(server.sockets[0].getsockname()[1])
    ended = asyncio.Event()
    asyncio.get_running_loop().add_reader(pipe.fileno(), ended.set)
    await ended.wait()


@contextmanager
def echo() -> Iterator[int]:
    """Run the echo; yield its port."""
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe()
    process = context.Process(target=serve_echo, args=(theirs,), daemon=True)
    process.start()
    theirs.close()
    try:
        yield ours.recv()
    finally:
        ours.close()
        process.join(1.0)
        process.kill()


@contextmanager
def one_core() -> Iterator[int]:
    """Keep this thread, and the processes that it starts, on one core; yield its number."""
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)


async def connected(port: int, name: str) -> tuple[Link, 'asyncio.Task[None]']:
    """Return a link that is connected, and its task."""
    up = asyncio.Event()

    def on_state(state: LinkState, _why: str) -> None:
        if state is LinkState.CONNECTED:
            up.set()

    link = Link(name, '127.0.0.1', port, on_packet=lambda _: None, on_state=on_state)
    task = asyncio.create_task(link.run())
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        await up.wait()
    return link, task


async def by_link(link: Link, message: Message, points: int) -> None:
    """Send a message so often, each when the one before is answered."""
    done = asyncio.get_running_loop().create_future()
    left = points

    def next_one(_packet: Packet, _now: float) -> None:
        nonlocal left
        left -= 1
        if left:
            link.post(message, next_one)
        else:
            done.set_result(None)

    link.post(message, next_one)
    await done


async def by_goal(link: Link, points: int) -> None:
    """Send the points of a goal."""
    limits, joints = LIMITS, len(LIMITS.names)
    times = POINT_PERIOD_S * np.arange(points, dtype=np.float64)
    positions = 0.1 * np.sin(times[:, None] + np.arange(joints, dtype=np.float64))
    trajectory = Trajectory(limits.names, times, positions)
    delivery = Streaming(link, limits, unmapped(joints), DeliveryRules())
    loop = asyncio.get_running_loop()
    done = loop.create_future()

    def post(message: Message, on_reply: Callable[[Packet, float], None]) -> None:
        def answered(packet: Packet, now: float) -> None:
            on_reply(packet, now)
            if execution.point == points and not done.done():
                done.set_result(None)

        delivery.post(message, answered)

    goal = Goal(trajectory, np.full(joints, 0.01), 0.0)
    execution = GoalExecution(goal, GoalSettings(), post, lambda _: None, loop.time())
    prepared = delivery.prepare(trajectory, positions[0])
    execution.start(prepared.trajectory, prepared.messages, loop.time(), positions[0])
    await done


async def _compare(port: int, motion_port: int, points: int, rounds: int) -> RoundTrips:
    reader, writer = await asyncio.open_connection('127.0.0.1', port)
    link, task = await connected(port, 'echo')
    controller, controller_task = await connected(motion_port, 'controller')
    point = JointTrajPt(7, (0.1,) * 10, 0.5, POINT_PERIOD_S)

    async def bare() -> None:
        for number in range(points):
            writer.write(POINT.pack(64, 11, 2, 0, number, *(0.1,) * 10, 0.5, POINT_PERIOD_S))
            REPLY.unpack(await reader.readexactly(REPLY.size))

    ways: dict[str, Callable[[], Awaitable[None]]] = {
        'bare': bare,
        'link': lambda: by_link(link, point, points),
        'goal': lambda: by_goal(link, points),
        'ping': lambda: by_link(controller, Ping(), points),
    }
    times: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(rounds + 1):
        for name, way in ways.items():
            begin = time.perf_counter()
            await way()
            if turn:  # the first one warms up
                times[name].append((time.perf_counter() - begin) / points)
    for each in (task, controller_task):
        each.cancel()
    await asyncio.gather(task, controller_task, return_exceptions=True)
    writer.close()

    def ratio(name: str) -> float:
        pairs = zip(times[name], times['bare'], strict=True)
        return statistics.median(ours / floor for ours, floor in pairs)

    middle = {name: statistics.median(values) for name, values in times.items()}
    return RoundTrips(
        **middle, link_ratio=ratio('link'), goal_ratio=ratio('goal'), ping_ratio=ratio('ping')
    )


def measure(*, quick: bool) -> RoundTrips:
    """Return the round trips."""
    with TemporaryDirectory() as name, one_core(), echo() as port:
        controller = processes.sim_controller(Path(name) / 'controller.log')
        with processes.ended_at_exit(controller):
            motion_port = controller.ports().motion
            points, rounds = (200, 5) if quick else (400, 15)
            return asyncio.run(_compare(port, motion_port, points, rounds))


if __name__ == '__main__':
    print(measure(quick=True))
