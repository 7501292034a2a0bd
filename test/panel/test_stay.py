# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`demo --stay`, `demo --panel` and `sim_controller --panel`: what goes on, and ends together."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('viser')

from support.panel_client import PanelClient
from support.ros_peer import PATIENCE

from epson_driver.cli import processes
from epson_driver.cli.demo_verdict import TOO_BUSY
from epson_driver.cli.panel import PORT

DEMO = (sys.executable, '-m', 'epson_driver.cli', 'demo')


@pytest.mark.slow
def test_demo_stays_with_a_panel_until_it_is_interrupted(tmp_path: Path) -> None:
    run = subprocess.Popen(
        [*DEMO, '--stay', '--motion=ptp', f'--picture={tmp_path / "x.png"}'],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {'PYTHONUNBUFFERED': '1'},
    )
    assert run.stdout is not None
    said = ''
    try:
        while said.count('panel: http') < 2:  # before the run, and with what is exported
            line = run.stdout.readline()
            assert line, said
            said += line
        assert 'the arm did what was planned' in said or 'too busy to judge' in said
        assert re.search(r'(?m)^export ROS_DOMAIN_ID=\d+$', said)
        assert 'export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST\n' in said
        address = re.search(r'panel: http://127\.0\.0\.1:(\d+)/', said)
        assert address is not None, said
        with PanelClient(int(address[1])) as client:
            client.wait_for_lamp('Link', 'good')
            client.wait_for_lamp('Arm gate', 'good')
    finally:
        run.send_signal(signal.SIGINT)
        run.stdout.read()
        assert run.wait(PATIENCE) in (0, TOO_BUSY)
    with pytest.raises(ConnectionError):
        PanelClient(int(address[1]))


def test_two_runs_cannot_stay() -> None:
    run = subprocess.run(
        [*DEMO, '--compare', '--stay'], capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    assert 'leave out --stay and --panel' in run.stderr


def test_demo_with_a_panel_says_what_is_missing() -> None:
    code = (
        'import sys; sys.modules["viser"] = None; sys.argv = ["", "demo", "--panel"]\n'
        'from epson_driver.cli.__main__ import main; sys.exit(main())'
    )
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert 'make demo ARGS=--panel' in ' '.join(run.stdout.split())


@pytest.mark.slow
def test_the_panel_of_a_simulated_controller_ends_with_it(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('127.0.0.1', PORT))
        except OSError:
            pytest.skip(f'port {PORT} is taken on this machine')
    environment = processes.ros_environment(processes.free_ros_domain())
    controller = processes.sim_controller(
        tmp_path / 'controller.log', '--panel', environment=environment
    )
    with processes.ended_at_exit(controller):
        controller.ports()
        assert controller.address() == f'http://127.0.0.1:{PORT}/'
        PanelClient(PORT).close()
        assert controller.end(signal.SIGTERM) == 0
    with pytest.raises(ConnectionError):
        PanelClient(PORT)
