# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A failure of any part ends the panel, because a page of a broken panel misleads the user."""

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

pytest.importorskip('websockets')

from support.panel_client import PanelClient
from support.ros_peer import PATIENCE

from epson_driver.panel import panel as panel_module
from epson_driver.panel.panel import Panel
from epson_driver.panel.web_server import WebServer
from epson_driver.processes import processes
from epson_driver.ros_panel import Goal, RosDiscovery

ROBOT = '/nobody'
OTHER = '/other'


class Running:
    """A panel in a thread of this process, for two missing drivers."""

    def __init__(self) -> None:
        self.panel = Panel(
            '127.0.0.1',
            0,
            None,
            partial(RosDiscovery, [], [ROBOT, OTHER]),
            {},
            allow_motion=True,
        )
        self.code: int | None = None
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        self.code = self.panel.run()

    def end(self) -> int | None:
        """Wait for its end and return its exit code."""
        self._thread.join(PATIENCE)
        return self.code

    def window(self) -> PanelClient:
        client = PanelClient(self.panel.web.port)
        client.wait(lambda: 'controls' in client.parts, 'its controls')
        return client


@pytest.fixture
def running(monkeypatch: pytest.MonkeyPatch) -> Iterator[Running]:
    for name, value in processes.ros_environment(processes.free_ros_domain()).items():
        monkeypatch.setenv(name, value)
    result = Running()
    yield result
    result.panel.stop()
    result.end()


def fails(*_: object, **__: object) -> None:
    raise ZeroDivisionError('made for this test')


def closed(running: Running) -> bool:
    try:
        PanelClient(running.panel.web.port).close()
    except OSError:
        return True
    return False


@pytest.mark.invariant(9)
@pytest.mark.parametrize('part', ['drawing', 'a button', 'serving ROS', 'disarming'])
def test_failure_of_any_part_ends_the_panel(
    part: str, running: Running, caplog: pytest.LogCaptureFixture
) -> None:
    client = running.window()
    view = running.panel._views[ROBOT]
    ends: dict[str, Callable[[], Any]] = {
        'drawing': lambda: setattr(view, 'parts', fails),
        'a button': lambda: (setattr(view.control.robot, 'trigger', fails), client.click('STOP')),
        'serving ROS': lambda: running.panel.robots._thread.executor.create_task(fails),
        'disarming': lambda: (setattr(view.control.arming, 'disconnect', fails), client.close()),
    }
    ends[part]()
    assert running.end() == 1
    assert closed(running)
    assert 'stopping the panel' in caplog.text
    assert 'made for this test' in caplog.text
    client.close()


def test_panel_without_a_failure_exits_with_0(running: Running) -> None:
    with running.window() as client:
        client.wait_for_lamp('Link', 'unknown')
        running.panel.stop()
        assert running.end() == 0
    assert closed(running)


def test_undeliverable_stop_is_an_alarm_and_no_failure(running: Running) -> None:
    with running.window() as client:
        client.click('STOP')
        client.wait_for_notification('no server for /nobody/stop')
        alarms = [
            f'{name}: STOP was not delivered: no server for /{name}/stop. Press the E-stop.'
            for name in ('nobody', 'other')
        ]
        client.wait(lambda: client.parts['alarms'] == alarms, 'each by its name')
        client.click('Arm')
        client.wait_for_notification('the driver does not report')
        running.window().close()


@pytest.mark.invariant(9)
def test_stopped_web_server_ends_the_panel(
    running: Running, caplog: pytest.LogCaptureFixture
) -> None:
    running.window().close()
    running.panel.web.stop()
    assert running.end() == 1
    assert 'the page is no longer served' in caplog.text


@pytest.mark.invariant(9)
def test_goal_with_unknown_result_is_logged_at_exit(
    running: Running, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    view = running.window() and running.panel._views[ROBOT]
    goal = Goal('swing', running.panel.robots._thread.executor)
    monkeypatch.setattr(panel_module, 'GOAL_TIMEOUT_S', 0.01)
    monkeypatch.setattr(view.control.robot, 'cancel_goals', lambda: [goal])
    running.panel.stop()
    running.end()
    assert 'were canceled, but not all ended in time' in caplog.text


def test_port_is_closed_if_robots_fail_to_start(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[WebServer] = []

    def server(*arguments: Any) -> WebServer:
        made.append(WebServer(*arguments))
        return made[-1]

    monkeypatch.setattr(panel_module, 'WebServer', server)
    with pytest.raises(ZeroDivisionError):
        Panel('127.0.0.1', 0, None, fails, {}, allow_motion=False)
    with pytest.raises(OSError, match='refused'):
        PanelClient(made[0].port)
