# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A driver and a simulated RC800 with Real-time Motion Control, in virtual time without DDS."""

import asyncio
import contextlib
from collections.abc import Callable
from functools import partial

import numpy as np

from epson_driver.driver import channel
from epson_driver.motion import Trajectory
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.rtmc.messages import Request, decode
from epson_driver.rtmc.transport import Arrival
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.network.servers import Ports
from epson_driver.sim_controller.rtmc_port import RtmcPort
from simulation.dds_bus import VirtualTransport
from support.driver_harness import Harness, options_of

PROFILE = load_controller_profile('rtmc')
MODEL = load_robot_model('c8_c901s')
CYCLE = PROFILE.rtmc.cycle
CLIENT = 1


class _CellTransport(VirtualTransport):
    on_close: Callable[[], None]

    async def aclose(self):
        self.close()
        self.on_close()


class RtmcCell:
    """A controller that is stepped in each cycle. `targets`: joints of all targets sent, rad.

    `speed`: control cycles per `CYCLE`. `delivers`: whether messages reach the other side.
    """

    def __init__(self, model=MODEL, speed=1):
        self.controller = new_controller(model, PROFILE)
        self.port = RtmcPort(self.controller, lambda data: self.reply(data))
        self.speed = speed
        self.numbers = []
        self.targets = []
        self.delivers = True
        self._transport: _CellTransport

    async def connect(self, _host, _port):
        self._loop = asyncio.get_running_loop()
        self._transport = _CellTransport(self._write)
        self._transport.on_close = partial(self.port.receive, CLIENT, None)
        return self._transport

    def _write(self, data):
        message = decode(data)
        self.numbers.append(message.number)
        if message.number == Request.MOVE:
            self.targets.append(np.frombuffer(message.data[:48]))
        if self.delivers:
            self._loop.call_soon(self.port.receive, CLIENT, data)
        return 1

    def reply(self, data):
        if self.delivers:
            self._loop.call_soon(self.arrive, data)

    def arrive(self, data):
        self._transport.arrive(Arrival(1, data, self._loop.time()))

    async def run(self):
        while True:
            await asyncio.sleep(CYCLE / self.speed)
            self.controller.step(CYCLE)


@contextlib.asynccontextmanager
async def rtmc_cell(patch, *, enabled=True, model=MODEL, speed=1, configured=None, **options):
    """Run a driver with a simulated RC800; yield both."""
    cell = RtmcCell(model, speed)

    patch.setattr(channel, 'connect', cell.connect)
    settings = options_of(PROFILE) | {
        'limits': model.limits,
        'model': (configured or model).name,
        'state_period': PROFILE.state.period,
    }
    task = asyncio.create_task(cell.run())
    try:
        async with Harness(Ports(7000, 0, 0, 0), **settings | options) as harness:
            if configured is None:
                await harness.ready()
            if enabled:
                await harness.commands.enable()
            yield harness, cell
    finally:
        task.cancel()


def goal(harness, *points, model=MODEL, step=0.6):
    """Submit a goal along the points, `step` s apart, from the arm's position."""
    positions = np.vstack([harness.at, *points])
    return harness.execute(
        Trajectory(model.limits.names, np.arange(len(positions)) * step, positions)
    )


def usage(targets, limits, cycle=CYCLE):
    """Return the largest velocity, acceleration and jerk of targets, in units of the limits."""
    steps = np.array(targets)[:, : len(limits.names)]
    result = []
    for limit in (limits.velocity, limits.acceleration, limits.jerk):
        steps = np.diff(steps, axis=0) / cycle
        result.append(float(np.max(np.abs(steps) / limit)))
    return result
