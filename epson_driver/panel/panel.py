# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel: one loop that samples ROS and draws, for all robots and all browsers."""

import contextlib
import logging
import queue
import secrets
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import viser

from epson_driver.motion import Trajectory
from epson_driver.panel import page_html
from epson_driver.panel.plots import PERIOD_S as HISTORY_PERIOD_S
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.robot_page import BrowserControls, RobotPage, attempt
from epson_driver.panel.ros_discovery import RosDiscovery
from epson_driver.panel.sim_pendant import PendantThread
from epson_driver.panel.web_server import WebServer

POSE_PERIOD_S = 0.04
"""What a person sees as motion."""

TEXT_PERIOD_S = 0.2
CURVE_PERIOD_S = 0.25
SLOW_PERIOD_S = 0.5
BEAT_PERIOD_S = 1.0

IDLE_PERIOD_S = 0.2
"""Of the loop while no browser is connected, s."""

STOP = 'STOP (Esc)'
"""Not the space bar, which also presses the button that has the focus."""

BETWEEN_ROBOTS_M = 0.9

LOOK_AT_M = np.array([0.1, 0.0, 0.33])
TO_CAMERA_M = np.array([1.65, -1.05, 0.62])
FIELD_OF_VIEW_RAD = 0.7

_log = logging.getLogger(__name__)


class Panel:
    """The whole panel, run in one thread, stopped or failed in any.

    `names`: of the drivers' nodes; None: all that are found. Raises WebServerError, and what
    rclpy.init raises.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str | None,
        ros_arguments: list[str],
        names: list[str] | None,
        trajectories: Mapping[str, Trajectory],
        *,
        allow_motion: bool,
    ) -> None:
        self._ended = threading.Event()
        self._failure: BaseException | None = None
        self._allow_motion = allow_motion
        self._trajectories = trajectories
        self._pages: dict[str, RobotPage] = {}
        self._browsers: dict[int, tuple[viser.ClientHandle, dict[str, BrowserControls]]] = {}
        self._news: queue.SimpleQueue[tuple[bool, viser.ClientHandle]] = queue.SimpleQueue()
        self._windows: dict[str, int] = {}
        """The browser of each window, by a secret that its page knows."""
        self.web = WebServer(host, port, token, self._on_alive)
        try:
            self.ros = RosDiscovery(ros_arguments, names, self.fail)
        except BaseException:
            self.web.stop()
            raise
        self._pendants = PendantThread(time.monotonic, self.fail)
        self._furnish(self.web.viser)
        self.web.viser.on_client_connect(self._on_connect)
        self.web.viser.on_client_disconnect(self._on_disconnect)

    def stop(self) -> None:
        """Have `run` end."""
        self._ended.set()

    def fail(self, what: str, error: BaseException) -> None:
        """Have the panel end: a page that looks alive and is not would be worse than none."""
        if self._failure is None:
            self._failure = error
            _log.critical('%s: the panel ends', what, exc_info=error)
        self._ended.set()

    def run(self) -> int:
        """Serve until `stop` or a failure and return the exit code."""
        try:
            self._loop()
        except BaseException as error:  # noqa: BLE001 - it is told, and all ends
            self.fail('drawing failed', error)
        finally:
            self._close()
        return 0 if self._failure is None else 1

    # --- the page ---------------------------------------------------------------------------

    def _furnish(self, viewer: viser.ViserServer) -> None:
        gui, scene = viewer.gui, viewer.scene
        gui.configure_theme(
            show_logo=False,
            show_share_button=False,
            control_width='large',
            brand_color=(25, 113, 194),
        )
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        self._alarm = gui.add_html('', order=0)
        gui.add_html(page_html.STYLE + page_html.STOP_HTML, order=1)
        stop = gui.add_button(STOP, color='red', icon=viser.Icon.HAND_STOP, order=2)
        stop.on_click(self._on_stop)
        gui.add_command(STOP, hotkey='escape').on_trigger(self._on_stop)
        self._tabs = gui.add_tab_group(order=10)
        self._left = gui.add_panel()
        self._left.dock_left()
        self._left.set_width(380)
        scene.set_up_direction('+z')
        scene.world_axes.visible = False
        scene.add_grid(
            '/floor',
            width=6.0,
            height=6.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(222, 226, 230),
            section_color=(190, 197, 204),
            plane_color=(248, 249, 250),
            plane_opacity=1.0,
            shadow_opacity=0.25,
            fade_distance=8.0,
            position=(0.0, 0.0, -0.001),
        )
        viewer.initial_camera.fov = FIELD_OF_VIEW_RAD
        viewer.initial_camera.look_at = LOOK_AT_M
        viewer.initial_camera.position = LOOK_AT_M + TO_CAMERA_M

    def _place_camera(self, client: viser.ClientHandle) -> None:
        """Have a new window look at the row of robots that there are."""
        camera, robots = client.camera, max(1, len(self._pages))
        centre = LOOK_AT_M + np.array([0.0, 0.5 * BETWEEN_ROBOTS_M * (robots - 1), 0.0])
        camera.position = centre + TO_CAMERA_M * (1.0 + 0.7 * (robots - 1))
        camera.look_at = centre  # after the position, with which viser moves it

    def _add_pages(self) -> None:
        for name, robot in self.ros.robots.items():
            if name in self._pages:
                continue
            control = RobotControl(
                robot,
                self._pendants,
                time.monotonic,
                on_error=self.fail,
                allow_motion=self._allow_motion,
            )
            label = robot.namespace.strip('/') or name.strip('/')
            tabs = (self._tabs.add_tab(label), self._left.add_tab(label))
            place = np.array([0.0, BETWEEN_ROBOTS_M * len(self._pages), 0.0])
            shown = label if robot.namespace else ''
            page = RobotPage(self.web.viser, control, self._trajectories, tabs, place, shown)
            self._pages[name] = page
            for browser in self._browsers:
                control.arming.connect(browser)
            for each in self._pages.values():
                each.stop_one.visible = len(self._pages) > 1

    def _on_stop(self, event: Any) -> None:
        """Stop all robots, whatever one of them says."""
        for page in list(self._pages.values()):
            attempt(event.client, page.control, page.control.stop)

    def _on_alive(self, window: str) -> None:
        browser = self._windows.get(window)
        if browser is not None:
            for page in list(self._pages.values()):
                page.control.arming.alive(browser)

    # --- browsers come and go: in viser's event loop ----------------------------------------

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        self._news.put((True, client))

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._news.put((False, client))
        try:
            for page in list(self._pages.values()):
                page.control.arming.disconnect(client.client_id)
        except BaseException as error:  # noqa: BLE001 - viser would only print it
            self.fail('disarming failed', error)

    def _welcome(self) -> None:
        """Make the controls of browsers that have come, and forget those that are gone."""
        while not self._news.empty():
            came, client = self._news.get()
            if came:
                self._browsers[client.client_id] = (client, {})
                for page in self._pages.values():
                    page.control.arming.connect(client.client_id)
                window = secrets.token_urlsafe(16)
                self._windows[window] = client.client_id
                with self._unless_gone(client):
                    client.gui.add_html(page_html.alive_html(window), order=3)
                    self._place_camera(client)
            else:
                self._browsers.pop(client.client_id, None)
                self._windows = {
                    window: browser
                    for window, browser in self._windows.items()
                    if browser != client.client_id
                }
                for page in self._pages.values():
                    page.control.arming.disconnect(client.client_id)
        for client, controls in self._browsers.values():
            with self._unless_gone(client):
                for name, page in self._pages.items():
                    if name not in controls:
                        controls[name] = BrowserControls(page, client)

    @contextlib.contextmanager
    def _unless_gone(self, client: viser.ClientHandle) -> Iterator[None]:
        """Do something with the elements of a browser, which may vanish meanwhile.

        viser takes them away in its own thread then, and raises one thing or another.
        """
        try:
            yield
        except Exception:
            if client.client_id in self.web.viser.get_clients():
                raise

    # --- the loop ---------------------------------------------------------------------------

    def _loop(self) -> None:
        due: dict[str, float] = {}

        def is_due(what: str, period: float) -> bool:
            if now < due.get(what, 0.0):
                return False
            due[what] = now + period
            return True

        while not self._ended.is_set():
            now = time.monotonic()
            self.ros.sample(now)
            if is_due('slow', SLOW_PERIOD_S):
                self.ros.sample_slow(now)
                self.ros.look_around(now)
                self._add_pages()
                if not self.web.alive:
                    raise RuntimeError('nothing serves the page any more')
            for page in self._pages.values():
                page.control.look()
            self._welcome()
            pages = self._pages.values()
            if is_due('history', HISTORY_PERIOD_S):
                for page in pages:
                    page.remember(now)
            if is_due('beat', BEAT_PERIOD_S):
                for page in pages:
                    page.beat()
            if self._browsers:
                self._draw(now, is_due('text', TEXT_PERIOD_S), is_due('curves', CURVE_PERIOD_S))
            period = POSE_PERIOD_S if self._browsers else IDLE_PERIOD_S
            self._ended.wait(max(0.005, period - (time.monotonic() - now)))

    def _draw(self, now: float, text: bool, curves: bool) -> None:
        for page in self._pages.values():
            page.draw_pose(now)
            if text:
                page.draw_text(now)
            if curves:
                page.draw_curves(now)
        if text:
            alarms = [page.control.stop_alarm for page in self._pages.values()]
            self._alarm.content = page_html.alarms_html([each for each in alarms if each])
            for client, controls in self._browsers.values():
                with self._unless_gone(client):
                    for each in controls.values():
                        each.refresh()

    def _close(self) -> None:
        """Let no goal of the panel outlive it, then close everything."""
        with contextlib.ExitStack() as stack:  # all of it, whatever a part raises
            stack.callback(self.ros.close)
            stack.callback(self._pendants.end)
            stack.callback(self.web.stop)
            stack.callback(self._end_goals)
            for page in self._pages.values():
                stack.callback(page.control.arming.disarm, 'the panel ends')

    def _end_goals(self) -> None:
        if not self.ros.cancel_goals():
            _log.error('a goal of the panel was canceled, but its end was not seen')


def address(host: str, port: int, token: str | None) -> str:
    """Return what a person opens."""
    name: Any = {'0.0.0.0': '127.0.0.1', '::': '[::1]'}.get(host, host)  # noqa: S104
    if ':' in name and not name.startswith('['):
        name = f'[{name}]'
    return f'http://{name}:{port}/' + ('' if token is None else f'?token={token}')
