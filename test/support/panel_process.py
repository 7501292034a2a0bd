# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A panel as a process of its own, for the robots of one ROS domain."""

import time
from pathlib import Path

import numpy as np

from epson_driver.cli import processes
from epson_driver.cli.trajectory_file import write_trajectory
from epson_driver.motion import Trajectory
from support import patient
from support.cell import LASTS, START
from support.panel_client import PanelClient
from support.ros_peer import JOINTS, PATIENCE

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
