# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel as tests use it: its process, its pages, its clients."""

import contextlib
import http.client
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from epson_driver.motion import Trajectory
from epson_driver.processes import processes
from epson_driver.trajectory_file import write_trajectory
from support import patient
from support.cell import LASTS, START
from support.ros_peer import JOINTS, PATIENCE

msgspec = pytest.importorskip('msgspec')
zstandard = pytest.importorskip('zstandard')
connect = pytest.importorskip('websockets.sync.client').connect

PROTOCOL = 'viser-v1.1.1'

CAMERA: dict[str, Any] = {
    'type': 'ViewerCameraMessage',
    'wxyz': (1.0, 0.0, 0.0, 0.0),
    'position': (1.0, 1.0, 1.0),
    'fov': 1.0,
    'near': 0.1,
    'far': 10.0,
    'image_height': 100,
    'image_width': 100,
    'look_at': (0.0, 0.0, 0.0),
    'up_direction': (0.0, 0.0, 1.0),
}


class PanelClient:
    """One window of the panel at a port; `headers` are added to those of its request.

    It keeps the elements of the page by their ids. Raises websockets' InvalidStatus if it is not
    let in.
    """

    def __init__(
        self, port: int, origin: str | None = '', headers: Mapping[str, str] | None = None
    ) -> None:
        self.elements: dict[str, dict[str, Any]] = {}
        self.first: list[dict[str, Any]] = []
        """Each element as it was when it came."""
        self.notifications: list[str] = []
        self.kinds: set[str] = set()
        own = f'http://127.0.0.1:{port}' if origin == '' else origin
        self._socket = connect(
            f'ws://127.0.0.1:{port}',
            subprotocols=[PROTOCOL],
            origin=own,
            additional_headers=dict(headers or {}),
            max_size=None,
            open_timeout=PATIENCE,
            compression=None,
        )
        self._news = threading.Condition()
        self._port = port
        self._headers = dict(headers or {})
        self._closed = threading.Event()
        self.lives = threading.Event()
        """Set when it has given a sign of life."""
        self._threads = [
            threading.Thread(target=each, daemon=True) for each in (self._read, self._live)
        ]
        for thread in self._threads:
            thread.start()
        self.send(CAMERA)

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

    def send(self, message: Mapping[str, Any]) -> None:
        self._socket.send(msgspec.msgpack.encode(message))

    # --- what it shows ----------------------------------------------------------------------

    def buttons(self, label: str) -> list[str]:
        """Return the ids of the buttons with a label."""
        return [
            uuid
            for uuid, each in list(self.elements.items())
            if each.get('label') == label and each['type'] == 'GuiButtonMessage'
        ]

    @property
    def labels(self) -> set[str]:
        """All labels of inputs and buttons."""
        return {str(each.get('label')) for each in list(self.elements.values())}

    def disabled(self, label: str) -> bool:
        """Return whether a button, once it is there, is shown as one that cannot be pressed."""
        self.wait(lambda: self.buttons(label), f'a button {label}')
        return bool(self.elements[self.buttons(label)[0]]['disabled'])

    def html(self, part: str) -> str:
        """Return the part of the page that is named so by data-part."""
        texts = [each.get('content', '') for each in list(self.elements.values())]
        return next((text for text in texts if f'data-part="{part}"' in text), '')

    def newest_log(self) -> str:
        """Return the line of the log that came last."""
        return self.html('log').partition('</div>')[0]

    def lamp(self, name: str) -> str:
        """Return the colour of a lamp."""
        _, found, rest = self.html('lamps').partition(f'data-lamp="{name}" data-colour="')
        return rest.partition('"')[0] if found else ''

    def wait(self, true: Callable[[], object], what: str) -> None:
        """Wait until something is so. Raises AssertionError with what was said meanwhile."""
        until = time.monotonic() + PATIENCE
        with self._news:
            while not true():
                left = until - time.monotonic()
                said = f'{self.notifications}, {self.html("log")}'
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

        def newer() -> str:
            log = self.html('log')  # the newest line is the first
            return log.partition(after)[0] if after else log

        self.wait(lambda: text in newer(), f'{text!r} in the log, after {after!r}')

    def wait_for_notification(self, text: str) -> None:
        self.wait(
            lambda: any(text in each for each in self.notifications), f'a notification {text!r}'
        )

    # --- what a person does -----------------------------------------------------------------

    def click(self, label: str) -> None:
        """Click a button, whether it is shown as disabled or not."""
        self.wait(lambda: self.buttons(label), f'a button {label}')
        self.click_id(self.buttons(label)[0])

    def click_id(self, uuid: str) -> None:
        self.send({'type': 'GuiUpdateMessage', 'uuid': uuid, 'updates': {'value': True}})

    def set(self, label: str, value: object) -> None:
        """Set an input, or click one of a group of buttons."""

        def found() -> list[str]:
            return [
                uuid for uuid, each in list(self.elements.items()) if each.get('label') == label
            ]

        self.wait(found, f'an input {label}')
        self.send({'type': 'GuiUpdateMessage', 'uuid': found()[0], 'updates': {'value': value}})

    # --- what the page does by itself -------------------------------------------------------

    def _live(self) -> None:
        """Give signs of life, as the script of the page does."""
        while not self._closed.wait(0.1):
            texts = [each.get('content', '') for each in list(self.elements.values())]
            found = re.search(r"fetch\('([^']+)'\)", ''.join(map(str, texts)))
            if found is not None:
                connection = http.client.HTTPConnection('127.0.0.1', self._port, timeout=PATIENCE)
                with contextlib.suppress(OSError):
                    connection.request('GET', found[1], headers=self._headers)
                    connection.getresponse().read()
                    self.lives.set()
                connection.close()

    def _read(self) -> None:
        for frame in self._socket:
            assert isinstance(frame, bytes)
            size, packed = (int.from_bytes(frame[at : at + 8], 'little') for at in (0, 8))
            inner = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed], size)
            with self._news:
                for message in msgspec.msgpack.decode(inner)['messages']:
                    self._take(message)
                self._news.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        kind, uuid = message['type'], message.get('uuid')
        self.kinds.add(kind)
        if kind == 'NotificationShowMessage' or kind.startswith('Notification'):
            self.notifications += list(_texts(message.get('props')))
        elif kind == 'GuiUpdateMessage' and uuid in self.elements:
            self.elements[uuid] |= message['updates']
        elif kind == 'GuiRemoveMessage':
            self.elements.pop(str(uuid), None)
        elif kind.startswith('Gui') and uuid is not None:
            self.elements[uuid] = {'type': kind} | message.get('props', {})
            self.first.append(dict(self.elements[uuid]))


def _texts(props: Any) -> Iterator[str]:
    if isinstance(props, dict):
        yield f'{props.get("title")}: {props.get("body")}'


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
        client.wait(lambda: client.buttons('Arm'), 'its controls')
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
        while client.disabled('Enable'):
            assert time.monotonic() < until, f'not armed: {client.notifications}'
            client.notifications.clear()
            client.click('Arm')
            client.wait(lambda: client.notifications or not client.disabled('Enable'), 'an answer')

    def close_windows(self) -> None:
        """Close what a test has opened; one that failed may have left an armed window."""
        while self._windows:
            self._windows.pop().close()

    def end(self) -> int:
        return self.process.end()
