# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel for tests: its process and a websocket client."""

import contextlib
import json
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, ConnectionClosedOK

from epson_driver.motion import Trajectory
from epson_driver.processes import processes
from epson_driver.trajectory_file import write_trajectory
from support import patient
from support.cell import LASTS, START
from support.ros_peer import JOINTS, PATIENCE

connect = pytest.importorskip('websockets.sync.client').connect

ALIVE_S = 0.1

CLICKS = {
    'STOP': 'stop',
    'Disable': 'disable',
    'Arm': 'arm',
    'Disarm': 'disarm',
    'Enable': 'enable',
    'Reset error': 'reset_error',
    'Clear all faults': 'clear_faults',
}
"""The request of each button."""


class PanelClient:
    """A window of the panel, without a browser. `headers` are added to its request.

    It stores the parts of the page by name, and shows the first robot or the given label.
    Raises websockets' InvalidStatus if the server rejects it.
    """

    def __init__(
        self,
        port: int,
        origin: str | None = '',
        headers: Mapping[str, str] | None = None,
        robot: str = '',
    ) -> None:
        self.parts: dict[str, Any] = {}
        self.notifications: list[str] = []
        self.inputs = {'Input': 0, 'Fault': '', 'Details': ''}
        self.robot = ''
        """The node name of the shown robot."""
        self._wanted = robot
        own = f'http://127.0.0.1:{port}' if origin == '' else origin
        self._socket = connect(
            f'ws://127.0.0.1:{port}',
            origin=own,
            additional_headers=dict(headers or {}),
            max_size=None,
            open_timeout=PATIENCE,
            compression=None,
        )
        self._news = threading.Condition()
        self._closed = threading.Event()
        self.lives = threading.Event()
        """Set after its first heartbeat for a shown robot."""
        self._threads = [
            threading.Thread(target=item, daemon=True) for item in (self._read, self._live)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> 'PanelClient':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._closed.set()
        self._threads[1].join(PATIENCE)
        self._socket.close()
        self._threads[0].join(PATIENCE)

    def ask(self, word: str, **more: Any) -> None:
        """Send a request, as the page does."""
        self.send({'do': word, 'robot': self.robot, 'at': time.monotonic()} | more)

    def send(self, message: Any) -> None:
        self._socket.send(json.dumps(message))

    # --- shown state ------------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """Whether this window is armed."""
        return bool(self.parts.get('controls', {}).get('armed') == 'yes')

    @property
    def log(self) -> list[str]:
        """The lines of the log, the newest first."""
        return [text for _, _, text in reversed(self.parts.get('log', []))]

    @property
    def advice(self) -> str:
        """The reason why the arm cannot move, and the remedy."""
        result = self.parts.get('advice', {'reason': '', 'remedy': ''})
        return f'{result["reason"]} → {result["remedy"]}'

    def lamp(self, name: str) -> str:
        """Return the colour of a lamp."""
        return next((item[2] for item in self.parts.get('lamps', []) if item[0] == name), '')

    def point(self, kind: int, index: int) -> int | None:
        """Return the value of an input (1) or output (2), None if it is not shown."""
        for item in self.parts.get('io', []):
            place = index - item['start']
            if item['type'] == kind and 0 <= place < len(item['values']):
                result: int = item['values'][place]
                return result
        return None

    def wait(self, true: Callable[[], object], what: str) -> None:
        """Wait until `true()`. Raises AssertionError with notifications and log on time-out."""
        until = time.monotonic() + PATIENCE
        with self._news:
            while not true():
                left = until - time.monotonic()
                text = f'not: {what}, log: {self.notifications}, {self.log}'
                assert left > 0, text
                assert self._threads[0].is_alive(), f'the panel has closed, {text}'
                self._news.wait(min(left, 0.5))

    def wait_for_lamp(self, name: str, colour: str) -> None:
        self.wait(lambda: self.lamp(name) == colour, f'{name} is {colour}')

    def wait_for_log(self, text: str, after: str = '') -> None:
        """Wait for a line of the log, newer than the newest line with `after`.

        All windows share one log, so the same line may be in it already.
        """

        def newer() -> list[str]:
            log = self.log
            old = next((at for at, line in enumerate(log) if after and after in line), len(log))
            return log[:old]

        self.wait(
            lambda: any(text in line for line in newer()), f'{text!r} in the log, after {after!r}'
        )

    def wait_for_notification(self, text: str) -> None:
        self.wait(
            lambda: any(text in notification for notification in self.notifications),
            f'a notification {text!r}',
        )

    # --- user actions -----------------------------------------------------------------------

    def click(self, label: str) -> None:
        """Click a button, whether it is shown as disabled or not."""
        self.wait(lambda: 'controls' in self.parts, 'the controls')
        if label in CLICKS:
            self.ask(CLICKS[label])
        elif label == 'Switch this input':
            self.ask('input', index=self.inputs['Input'])
        elif label == 'Start this fault':
            self.ask('fault', text=f'{self.inputs["Fault"]} {self.inputs["Details"]}'.strip())
        else:
            word = {'Execute': 'execute', 'Move to its start, slowly': 'go_to_start'}[label]
            self.ask(word, name=SWING)

    def set(self, label: str, value: Any) -> None:
        """Set an input, or click a button of a group."""
        if label in self.inputs:
            self.inputs[label] = value
        elif label == 'Speed [%]':
            self.ask('speed', value=value / 100.0)
        elif label == 'Switch output':
            self.ask('output', index=int(value))
        else:
            self.ask('press', what=label, how=value)

    # --- automatic messages of the page -----------------------------------------------------

    def _live(self) -> None:
        """Send heartbeats like the page."""
        with contextlib.suppress(ConnectionClosed):
            while not self._closed.wait(ALIVE_S):
                self.send({'do': 'alive'})
                if 'controls' in self.parts:
                    self.lives.set()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosedOK):  # a request during close is dropped
            for frame in self._socket:
                parts = json.loads(frame)
                with self._news:
                    self.notifications += parts.pop('notes', [])
                    if 'robots' in parts:
                        self._choose(parts['robots'])
                    if parts.pop('robot') != self.robot:  # of the previously shown robot
                        parts = {key: parts[key] for key in ('robots', 'alarms') if key in parts}
                    self.parts |= parts
                    self._news.notify_all()

    def show(self, robot: str) -> None:
        """Show another robot, by its label."""
        with self._news:
            self._wanted = robot
            self._choose(self.parts['robots'])

    def _choose(self, robots: list[dict[str, str]]) -> None:
        names = [item['name'] for item in robots if self._wanted in ('', item['label'])]
        if self.robot not in names and names:
            self.robot = names[0]
            self.ask('choose')


SWING, SWING_END = 'swing', 0.8
"""The trajectory of `PanelProcess`, and its last position of the first joint, rad."""


class PanelProcess:
    """A panel process that offers one slow trajectory from START.

    Its time-outs are longer than a user's, for busy machines, unless `patience` is False.
    """

    def __init__(self, folder: Path, domain: int, *arguments: str, patience: bool = True) -> None:
        file = folder / f'{SWING}.yaml'
        there = np.array([START, [SWING_END, *START[1:]]])
        write_trajectory(file, Trajectory(tuple(JOINTS), np.array([0.0, LASTS]), there), 'a swing')
        self.process = processes.Process(
            'panel',
            ['--port=0', f'--trajectory={file}', *arguments],
            folder / 'panel.log',
            processes.ros_environment(domain),
            run=patient.COMMAND if patience else processes.EXECUTABLE,
        )
        self.address = self.process.address()
        self._windows: list[PanelClient] = []
        self.port = int(self.address.split(':')[2].partition('/')[0])

    def window(self) -> PanelClient:
        """Open a window and wait until it shows a robot that is connected."""
        client = PanelClient(self.port)
        self._windows.append(client)
        client.wait_for_lamp('Link', 'good')
        client.wait(lambda: 'controls' in client.parts, 'its controls')
        assert client.lives.wait(PATIENCE)
        return client

    def armed(self) -> PanelClient:
        """Open a window and arm it."""
        client = self.window()
        client.wait_for_lamp('Door', 'good')  # known to be simulated
        self.arm(client)
        return client

    def arm(self, client: PanelClient) -> None:
        """Arm a window. Repeats the request until a new controller is known."""
        until = time.monotonic() + PATIENCE
        while not client.armed:
            assert time.monotonic() < until, f'not armed: {client.notifications}'
            client.notifications.clear()
            client.click('Arm')
            client.wait(lambda: client.notifications or client.armed, 'an answer')

    def close_windows(self) -> None:
        """Close all windows. A failed test may have left an armed window."""
        while self._windows:
            self._windows.pop().close()

    def end(self) -> int:
        return self.process.end()
