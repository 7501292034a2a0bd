# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel as tests use it: its process, its pages, its clients."""

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
"""What a button asks for."""


class PanelClient:
    """One window of the panel at a port; `headers` are added to those of its request.

    It keeps the parts of the page by their names, and shows the first robot, or the one whose
    label is given. Raises websockets' InvalidStatus if it is not let in.
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
        """The node of the robot that it shows."""
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
        """Set when it has given a sign of life for a robot that it shows."""
        self._threads = [
            threading.Thread(target=each, daemon=True) for each in (self._read, self._live)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> 'PanelClient':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.freeze()
        self._socket.close()
        self._threads[0].join(PATIENCE)

    def freeze(self) -> None:
        """Give no sign of life any more, as a page that hangs; the websocket stays."""
        self._closed.set()
        self._threads[1].join(PATIENCE)

    def ask(self, word: str, **more: Any) -> None:
        """Send a request, as the page does."""
        self.send({'do': word, 'robot': self.robot, 'at': time.monotonic()} | more)

    def send(self, message: Any) -> None:
        self._socket.send(json.dumps(message))

    # --- what it shows ----------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """Whether what moves the robot can be pressed."""
        return bool(self.parts.get('controls', {}).get('armed') == 'yes')

    @property
    def log(self) -> list[str]:
        """The lines of the log, the newest first."""
        return [text for _, _, text in reversed(self.parts.get('log', []))]

    def newest_log(self) -> str:
        """Return the line of the log that came last."""
        return next(iter(self.log), '')

    @property
    def advice(self) -> str:
        """What is in the way, and the remedy."""
        found = self.parts.get('advice', {'reason': '', 'remedy': ''})
        return f'{found["reason"]} → {found["remedy"]}'

    def lamp(self, name: str) -> str:
        """Return the colour of a lamp."""
        return next((each[2] for each in self.parts.get('lamps', []) if each[0] == name), '')

    def point(self, kind: int, index: int) -> int | None:
        """Return what an input (1) or output (2) is, None if it is not shown."""
        for each in self.parts.get('io', []):
            place = index - each['start']
            if each['type'] == kind and 0 <= place < len(each['values']):
                found: int = each['values'][place]
                return found
        return None

    def wait(self, true: Callable[[], object], what: str) -> None:
        """Wait until something is so. Raises AssertionError with what was said meanwhile."""
        until = time.monotonic() + PATIENCE
        with self._news:
            while not true():
                left = until - time.monotonic()
                said = f'{self.notifications}, {self.log}'
                assert left > 0, f'not: {what}; said: {said}'
                assert self._threads[0].is_alive(), (
                    f'the panel has closed; not: {what}; said: {said}'
                )
                self._news.wait(min(left, 0.5))

    def wait_for_lamp(self, name: str, colour: str) -> None:
        self.wait(lambda: self.lamp(name) == colour, f'{name} is {colour}')

    def wait_for_log(self, text: str, after: str = '') -> None:
        """Wait for a line of the log, newer than the newest one with `after`.

        The log is that of the panel: other windows may have written the same line before.
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
            lambda: any(text in each for each in self.notifications), f'a notification {text!r}'
        )

    # --- what a person does -----------------------------------------------------------------

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
            word = {'Execute': 'execute', 'Go to its start, slowly': 'go_to_start'}[label]
            self.ask(word, name=SWING)

    def set(self, label: str, value: Any) -> None:
        """Set an input, or click one of a group of buttons."""
        if label in self.inputs:
            self.inputs[label] = value
        elif label == 'Speed [%]':
            self.ask('speed', value=value / 100.0)
        elif label == 'Switch output':
            self.ask('output', index=int(value))
        else:
            self.ask('press', what=label, how=value)

    # --- what the page does by itself -------------------------------------------------------

    def _live(self) -> None:
        """Give signs of life, as the script of the page does."""
        with contextlib.suppress(ConnectionClosed):
            while not self._closed.wait(ALIVE_S):
                self.send({'do': 'alive'})
                if 'controls' in self.parts:
                    self.lives.set()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosedOK):  # what is asked as it closes goes nowhere
            for frame in self._socket:
                parts = json.loads(frame)
                with self._news:
                    self.notifications += parts.pop('notes', [])
                    if 'robots' in parts:
                        self._choose(parts['robots'])
                    if parts.pop('robot') != self.robot:  # of the one that was shown before
                        parts = {key: parts[key] for key in ('robots', 'alarms') if key in parts}
                    self.parts |= parts
                    self._news.notify_all()

    def show(self, robot: str) -> None:
        """Show another robot, by its label."""
        with self._news:
            self._wanted = robot
            self._choose(self.parts['robots'])

    def _choose(self, robots: list[dict[str, str]]) -> None:
        names = [each['name'] for each in robots if self._wanted in ('', each['label'])]
        if self.robot not in names and names:
            self.robot = names[0]
            self.ask('choose')


SWING = 'swing'


class PanelProcess:
    """It offers one trajectory, SWING: from START, slowly.

    It is patient with a machine that is busy, unless `patience` is False.
    """

    def __init__(self, folder: Path, domain: int, *arguments: str, patience: bool = True) -> None:
        file = folder / f'{SWING}.yaml'
        there = np.array([START, [0.8, *START[1:]]])
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
        client.wait_for_lamp('Door', 'good')  # the simulated controller has said what it is
        self.arm(client)
        return client

    def arm(self, client: PanelClient) -> None:
        """Arm a window; a controller that has just come, or come back, is not known at once."""
        until = time.monotonic() + PATIENCE
        while not client.armed:
            assert time.monotonic() < until, f'not armed: {client.notifications}'
            client.notifications.clear()
            client.click('Arm')
            client.wait(lambda: client.notifications or client.armed, 'an answer')

    def close_windows(self) -> None:
        """Close what a test has opened; one that failed may have left an armed window."""
        while self._windows:
            self._windows.pop().close()

    def end(self) -> int:
        return self.process.end()
