# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel: a loop that samples the state of all robots, and sends the changes to all windows."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from epson_driver.motion import Trajectory
from epson_driver.panel.access import bracketed
from epson_driver.panel.requests import Requests, message_of, number, text
from epson_driver.panel.robot_control import PENDANT, RobotControl
from epson_driver.panel.robot_state import RequestError, Robots
from epson_driver.panel.robot_view import RobotView
from epson_driver.panel.sim_pendant import PendantThread, needs_login
from epson_driver.panel.web_server import WebServer
from epson_driver.panel.window import BadMessageError, Window, text_of
from epson_driver.sim_controller.faults.fault_kinds import FAULTS

POSE_PERIOD_S = 0.04  # period of poses, s, which makes motion appear continuous
TEXT_PERIOD_S = 0.2  # period of texts such as lamps and log, s
SLOW_PERIOD_S = 0.5  # period for discovering robots, s
BEAT_PERIOD_S = 0.5  # period of the heartbeat that shows a page that the panel is running, s
IDLE_PERIOD_S = 0.1  # period of the loop while no browser is connected, s
GOAL_TIMEOUT_S = 3.0  # maximum time for the panel's goals to end when the panel closes, s

PENDANT_PART = text_of(
    {
        'presses': {item: list(presses) for item, presses in PENDANT.items()},
        'logins': [
            f'{item} {press}'
            for item, presses in PENDANT.items()
            for press, action in presses.items()
            if needs_login(action)
        ],
        'faults': list(FAULTS),
    }
)

Failed = Callable[[str, BaseException], None]
"""Function that ends the panel because of an exception. Its first argument names the failed
part."""

_log = logging.getLogger(__name__)


class Panel:
    """The whole panel. `run` runs in one thread. `stop` and `fail` may be called in any thread.

    `make_robots` gets the function `fail` and returns the robots. Raises WebServerError if the
    page cannot be served, and the exceptions of `make_robots`.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str | None,
        make_robots: Callable[[Failed], Robots],
        trajectories: Mapping[str, Trajectory],
        *,
        allow_motion: bool,
    ) -> None:
        self._ended = threading.Event()
        self._failure: BaseException | None = None
        self._allow_motion = allow_motion
        self._trajectories = trajectories
        self._requests = Requests(trajectories)
        self._views: dict[str, RobotView] = {}
        self._windows: dict[int, Window] = {}
        self._lock = threading.Lock()  # guards windows and views, used in two threads
        self._new: set[int] = set()
        self._beat = 0
        self.web = WebServer(host, port, token, self, self.fail)
        try:
            self.robots = make_robots(self.fail)
        except BaseException:
            self.web.stop()
            raise
        self._pendants = PendantThread(time.monotonic, self.fail)

    @property
    def url(self) -> str:
        """The address of the page."""
        return address(self.web.host, self.web.port, self.web.access.token)

    def stop(self) -> None:
        self._ended.set()

    def fail(self, what: str, error: BaseException) -> None:
        """Log a failure, and make `run` return 1. `what`: the failed part, for the log."""
        if self._failure is None:
            self._failure = error
            _log.critical('%s: stopping the panel', what, exc_info=error)
        self._ended.set()

    def run(self) -> int:
        try:
            self._loop()
        except BaseException as error:  # noqa: BLE001 - reported by `fail`, and everything ends
            self.fail('drawing failed', error)
        finally:
            self.close()
        return 0 if self._failure is None else 1

    # --- called by the web server, in its thread ----------------------------------------------

    def add(self, window: Window) -> None:
        with self._lock:
            self._windows[window.number] = window
            self._new.add(window.number)
            for view in self._views.values():
                view.control.arming.connect(window.number)

    def remove(self, window: Window) -> None:
        with self._lock:
            self._windows.pop(window.number, None)
            self._new.discard(window.number)
            views = list(self._views.values())
        for view in views:
            view.control.arming.disconnect(window.number)

    def received(self, window: Window, message: str | bytes) -> None:
        """Execute a request of a window.

        Raises BadMessageError if the panel's page never sends such a message.
        """
        request = message_of(message)
        name = request['do']
        late = 'at' in request and window.late(number(request, 'at', 0.0, 1e15), time.monotonic())
        with self._lock:
            views = dict(self._views)
        if name == 'alive':
            for view in views.values():
                view.control.arming.alive(window.number)
        elif name == 'choose':
            window.choose(text(request, 'robot'))
            with self._lock:
                self._new.add(window.number)
        elif name == 'stop':
            for view in views.values():
                self._attempt(window, view.control, {'do': 'stop_one'})
        else:
            selected = views.get(text(request, 'robot'))
            if selected is None:
                window.say('Not done: this robot has disappeared')
                return
            if name in ('jog', 'step') and late:
                return
            self._attempt(window, selected.control, request)
            if name == 'jog':
                end = {'do': 'jog', 'share': 0.0}
                window.after_silence(lambda: self._attempt(window, selected.control, end))
        if name in ('stop', 'stop_one'):  # without this part, the page shows a large red warning
            window.offer(window.robot, {'stopped': text_of(number(request, 'at', 0.0, 1e15))})

    def _attempt(self, window: Window, control: RobotControl, request: Mapping[str, Any]) -> None:
        action = self._requests.table.get(request['do'])
        if action is None:
            raise BadMessageError('unknown request')
        try:
            action(control, window.number, request)
        except RequestError as error:
            control.jog_end()
            control.robot.log(f'not done: {error}', 30)
            window.say(f'Not done: {error}')
        except BadMessageError:
            raise
        except BaseException as error:  # noqa: BLE001 - reported by `fail`, which ends the panel
            self.fail('the action of a button failed', error)

    # --- in the thread of `run` -------------------------------------------------------------

    def _loop(self) -> None:
        due: dict[str, float] = {}

        def is_due(what: str, period: float) -> bool:
            if now < due.get(what, 0.0):
                return False
            due[what] = now + period
            return True

        while not self._ended.is_set():
            now = time.monotonic()
            self.robots.sample(now)
            if is_due('slow', SLOW_PERIOD_S):
                self.robots.discover(now)
                self._update_views()
                if not self.web.alive:
                    raise RuntimeError('the page is no longer served')
            for view in self._views.values():
                view.update(now)
            if is_due('beat', BEAT_PERIOD_S):
                self._beat += 1
            with self._lock:
                windows, new = list(self._windows.values()), self._new
                self._new = set()
            if windows:
                self._show(windows, new, now, is_due('text', TEXT_PERIOD_S))
            period = POSE_PERIOD_S if windows else IDLE_PERIOD_S
            self._ended.wait(max(0.005, period - (time.monotonic() - now)))

    def _show(self, windows: list[Window], new: set[int], now: float, texts: bool) -> None:
        views = list(self._views.values())
        alarms = [
            f'{item.label}: ' * (len(views) > 1) + item.control.stop_alarm
            for item in views
            if item.control.stop_alarm
        ]
        common = {'alarms': text_of(alarms)}
        if texts or new:
            common['robots'] = text_of([item.summary(now) for item in views])
            common['pendant'] = PENDANT_PART
        common['beat'] = text_of(self._beat)
        shown: dict[str, dict[str, str]] = {}
        for window in windows:
            name = window.robot
            view = self._views.get(name)
            if view is None:
                window.offer(name, common)
                continue
            if name not in shown:
                shown[name] = view.pose(now) | (view.parts(now) if texts or new else {})
            parts = common | shown[name]
            if window.number in new:
                parts['history'] = view.history()
            if texts or window.number in new:
                parts['controls'] = view.controls(window.number)
            window.offer(name, parts)

    def _update_views(self) -> None:
        """Add the views of new robots, and remove the views of robots that have disappeared."""
        robots = self.robots.robots
        for name in [name for name in self._views if name not in robots]:
            with self._lock:
                view = self._views.pop(name)
            view.control.end()
        for name, robot in robots.items():
            if name in self._views:
                continue
            control = RobotControl(
                robot, self._pendants.pendant, time.monotonic, allow_motion=self._allow_motion
            )
            view = RobotView(control, self._trajectories, robot.label)
            with self._lock:
                for window in self._windows:
                    control.arming.connect(window)
                self._views[name] = view

    def close(self) -> None:
        """End all parts of the panel. `run` calls this at its end.

        If `run` is not called, call this.
        """
        with contextlib.ExitStack() as stack:  # runs the other callbacks if one raises
            stack.callback(self.robots.close)
            stack.callback(self._pendants.end)
            stack.callback(self.web.stop)
            stack.callback(self._end_goals)
            for view in self._views.values():
                stack.callback(view.control.arming.disarm, 'the panel is stopping')

    def _end_goals(self) -> None:
        goals = [goal for robot in self.robots.robots.values() for goal in robot.cancel_goals()]
        if not all(goal.ended.wait(GOAL_TIMEOUT_S) for goal in goals):
            _log.error('the goals of the panel were canceled, but not all ended in time')


def address(host: str, port: int, token: str | None) -> str:
    name = {'0.0.0.0': '127.0.0.1', '::': '::1'}.get(host, host)  # noqa: S104
    return f'http://{bracketed(name)}:{port}/' + ('' if token is None else f'?token={token}')
