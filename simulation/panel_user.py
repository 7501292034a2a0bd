# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A person at the panel: a page that can freeze, its connection, and the panel's process.

The panel's real code decides which browser may move the arm. The page and ROS are simulated.
"""

import asyncio
from collections.abc import Callable
from contextvars import Context, copy_context
from typing import Any

import numpy as np

from epson_driver.driver.outcome import Outcome
from epson_driver.motion import Array, Trajectory
from epson_driver.panel.arming import ALIVE_WITHIN_S
from epson_driver.panel.requests import Requests
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.robot_state import (
    ERROR,
    INFO,
    WARN,
    RequestError,
    RobotState,
    Say,
    Status,
    Tri,
)
from epson_driver.panel.window import Window
from epson_driver.robots import RobotModel
from simulation.network import HOST, PROCESS
from simulation.users import Users

ALIVE_S, HELD_S, LOOK_S, REPORT_S = 0.3, 0.033, 0.04, 1.0
"""Periods, s: of the page's signs of life, of its requests while a button is pressed (panel.js,
hand.js), of the panel's loop, and of the driver's diagnostics."""

NOTICED_S = 0.5
"""Tolerance for the panel's detection of a page without signs of life, s."""

INTENDED_S = 0.4
"""Age above which a request of the page no longer counts as wanted at the driver, s."""


class PlayedRobot:
    """The driver as the panel sees it over ROS: reports from the driver, and requests to it."""

    name = 'driver'

    def __init__(self, users: Users, model: RobotModel) -> None:
        self.state = RobotState(joint_names=model.joint_names)
        self.parameters: dict[str, Any] = {
            'robot_model': model.name,
            'robot_ip': HOST,
            'remote_port': 0,
        }
        self.asked_at = 0.0
        """Time of the page's request that is being carried out, s."""
        self._users = users
        self._goals: dict[int, bool] = {}

    def report(self) -> None:
        now, gate = self._users.loop.time(), self._users.gate
        if gate is not None:
            self.state.gate_open = gate
            self.state.times |= {'diagnostics': now, 'parameters': now}

    def look(self, sample: Any, status: Any) -> None:
        now, state = self._users.loop.time(), self.state
        if sample is not None:
            state.positions = sample.positions
            if not state.fresh('joints', now):
                state.times['first joints'] = now
            state.times['joints'] = now
        if status is not None:
            state.status = Status(in_motion=Tri(status.in_motion))
            state.times['status'] = now

    def log(self, text: str, _level: int) -> None:
        self._users.say(f'panel: {text}')

    def set_speed(self, factor: float, say: Say) -> None:
        raise RequestError(f'speed {factor:g}: not played')

    def write_output(self, index: int, value: int, say: Say) -> None:
        raise RequestError(f'output {index} = {value}: not played')

    def trigger(self, name: str, say: Say) -> None:
        self._serve(name)

        def answered(said: str) -> None:
            say(f'~/{name}: {said}', INFO if said.startswith('ok') else ERROR)

        self._users.request(name, answered)

    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None:
        self._serve(text)

        def ended(number: int, outcome: Outcome) -> None:
            self._goals.pop(number, None)
            say(f'{text}: {outcome.text}', INFO)

        number = self._users.hand_in(trajectory, ended, wanted=self._intended)
        self._goals[number] = True

    def jog(self, _names: Any, velocities: Array) -> None:
        self._users.jog(velocities, wanted=self._intended)

    @property
    def goals(self) -> list[int]:
        return list(self._goals)

    def cancel_goals(self) -> list[int]:
        for number in self._goals:
            self._users.cancel_goal(number)
        return self.goals

    def driver_died(self) -> None:
        self._goals.clear()

    def _serve(self, what: str) -> None:
        if self._users.gate is None:
            raise RequestError(f'no server for {what}')

    @property
    def _intended(self) -> bool:
        return self._users.loop.time() - self.asked_at < INTENDED_S


class PanelUser:
    """The panel and its user. Public methods are events of the world."""

    def __init__(self, users: Users, model: RobotModel) -> None:
        self.robot = PlayedRobot(users, model)
        self.control = RobotControl(
            self.robot, lambda _host, _port: None, users.loop.time, allow_motion=True
        )
        self._users = users
        self._requests = Requests({})
        self._sample: Any = None
        self._status: Any = None
        self._arrived = 0.0
        self._stalled_until = self._hung_until = self._alive_sent = 0.0
        self._finger: asyncio.Task[None] | None = None
        self._page, self._panel = _context('page'), _context('panel')
        self._open()
        self._tasks = [
            self._start(self._page, self._beat()),
            self._start(self._panel, self._look()),
            users.loop.create_task(self._report()),
            users.loop.create_task(self._watch()),
        ]

    @property
    def armed(self) -> bool:
        return self.control.arming.holder is not None

    def close(self) -> None:
        """Close page and panel, which ends everything they have started."""
        self._users.loop.go_on('page')
        self._users.loop.go_on('panel')
        for task in (self._finger, *self._tasks):
            if task is not None:
                task.cancel()
        self.control.end()

    def take(self, sample: Any = None, status: Any = None) -> None:
        self._sample, self._status = sample or self._sample, status or self._status

    # --- events ------------------------------------------------------------------------------

    async def jog(self, arms: bool, axis: str, frame: str, share: float, seconds: float) -> None:
        self._arm_if(arms)
        self._release()
        self._finger = self._start(self._page, self._hold(axis, frame, share, seconds))

    async def step(self, arms: bool, axis: str, frame: str, share: float, size: float) -> None:
        self._arm_if(arms)
        size = float(np.copysign(size, share))
        self._send('step', axis=axis, frame=frame, size=size, share=max(abs(share), 0.01))

    async def arm(self) -> None:
        self._send('arm')

    async def enable(self) -> None:
        self._send('enable')

    async def stop(self) -> None:
        self._send('stop_one')

    async def disarm(self) -> None:
        self._send('disarm')
        self._leave()

    async def hangs(self, seconds: float) -> None:
        self._hung_until = self._users.loop.time() + seconds
        self._pause('panel', seconds)

    async def line_stalls(self, seconds: float) -> None:
        """Delay the page's messages and deliver them together."""
        self._stalled_until = self._users.loop.time() + seconds

    async def page_freezes(self, seconds: float) -> None:
        self._pause('page', seconds)

    async def page_closes(self) -> None:
        self._release()
        self._leave()
        number = self._window.number
        self._deliver(lambda: self.control.arming.disconnect(number))
        self._open()

    # --- the page ----------------------------------------------------------------------------

    def _open(self) -> None:
        self._window = window = Window(self._users.loop)
        self._deliver(lambda: self.control.arming.connect(window.number))
        self._send_alive()

    async def _beat(self) -> None:
        while True:
            self._send_alive()
            await asyncio.sleep(ALIVE_S)

    def _send_alive(self) -> None:
        self._alive_sent = self._users.loop.time()
        window, sent = self._window, self._alive_sent

        def alive() -> None:
            window.late(sent, self._users.loop.time())
            self.control.arming.alive(window.number)

        self._deliver(alive)

    def _arm_if(self, arms: bool) -> None:
        if arms:
            self._send('arm')

    async def _hold(self, axis: str, frame: str, share: float, seconds: float) -> None:
        ends = self._users.loop.time() + seconds
        while self._users.loop.time() < ends:
            self._send('jog', axis=axis, frame=frame, share=share)
            await asyncio.sleep(HELD_S)
        self._finger = None
        self._send('jog', share=0)

    def _release(self) -> None:
        if self._finger is not None:
            self._finger.cancel()
            self._finger = None
            self._send('jog', share=0)

    def _send(self, word: str, **parts: Any) -> None:
        if 'page' not in self._users.loop.hanging:
            message = {'do': word, 'at': self._users.loop.time(), **parts}
            window = self._window
            self._deliver(lambda: self._received(window, message))

    def _deliver(self, call: Callable[[], object]) -> None:
        loop = self._users.loop
        arrival = loop.time() + float(self._users.rng.uniform(0.001, 0.03))
        self._arrived = max(arrival, self._stalled_until, self._arrived + 1e-9)
        loop.call_at(self._arrived, call, context=self._panel)

    # --- the panel ---------------------------------------------------------------------------

    def _received(self, window: Window, message: dict[str, Any]) -> None:
        late = window.late(message['at'], self._users.loop.time())
        if late and message['do'] in ('jog', 'step'):
            return
        self.robot.asked_at = message['at']
        try:
            self._requests.table[message['do']](self.control, window.number, message)
        except RequestError as error:
            self.control.jog_end()
            self.robot.log(f'not done: {error}', WARN)

    async def _look(self) -> None:
        while True:
            self.robot.look(self._sample, self._status)
            self._sample = self._status = None
            self.control.update()
            await asyncio.sleep(LOOK_S)

    # --- the world ---------------------------------------------------------------------------

    async def _report(self) -> None:
        while True:
            self.robot.report()
            await asyncio.sleep(REPORT_S)

    async def _watch(self) -> None:
        """Treat the panel's goals as unwanted once its page gives no sign of life."""
        while True:
            await asyncio.sleep(0.1)
            now = self._users.loop.time()
            silent = now - max(self._alive_sent, self._hung_until - ALIVE_WITHIN_S)
            if silent > ALIVE_WITHIN_S + NOTICED_S:
                self._users.wishes.give_up(self.robot.goals, now)

    def _leave(self) -> None:
        """Treat the current goals as unwanted once the panel must have noticed."""
        loop, goals = self._users.loop, self.robot.goals

        def unwanted() -> None:
            self._users.wishes.give_up(goals, loop.time())

        seen = max(loop.time(), self._hung_until, self._stalled_until)
        loop.call_at(seen + ALIVE_WITHIN_S + NOTICED_S, unwanted)

    def _pause(self, process: str, seconds: float) -> None:
        loop = self._users.loop
        loop.hang(process)
        loop.call_later(seconds, loop.go_on, process)

    def _start(self, context: Context, work: Any) -> asyncio.Task[None]:
        task: asyncio.Task[None] = context.run(self._users.loop.create_task, work)
        return task


def _context(process: str) -> Context:
    context = copy_context()
    context.run(PROCESS.set, process)
    return context
