# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/tutorial.md to the letter: each command runs, and prints what the page shows."""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.interrupts import obey_interrupts
from support.ros_peer import PATIENCE

from epson_driver.processes import processes

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(
    r'(?ms)^(?:## (?P<section>[^\n]*)$|```console ?(?P<needs>\w*)\n(?P<text>.*?)^```)'
)
NEEDS = {'ros2': ('ros2',), 'moveit': ('ros2', 'move_group')}


def sections() -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Yield each section with its commands and outputs, without blocks for missing tools."""
    title, commands = '', []
    for found in BLOCK.finditer((ROOT / 'docs' / 'tutorial.md').read_text(encoding='utf-8')):
        if found['section']:
            yield title, commands
            title, commands = found['section'], []
        elif all(shutil.which(tool) for tool in NEEDS.get(found['needs'], ())):
            parts = re.split(r'(?m)^\$ (.*)\n', found['text'])
            commands += zip(parts[1::2], parts[2::2], strict=True)
    yield title, commands


def pattern(shown: str) -> 're.Pattern[str]':
    """Return the pattern of an output: an ellipsis stands for any text."""
    return re.compile('.*?'.join(map(re.escape, shown.strip().split('…'))), re.DOTALL)


class Terminal:
    """Runs commands as they are on the page, at an address and in a ROS domain of their own."""

    def __init__(self, folder: Path) -> None:
        address = f'127.{random.randrange(1, 255)}.{random.randrange(256)}.1'
        self._own = {
            'sim_controller': f'sim_controller --host {address}',
            'pendant': f'pendant --host {address}',
            '--ros-args': f'--ros-args -p robot_ip:={address}',
            '127.0.0.1': address,
        }
        self._folder = folder
        shutil.copytree(ROOT / 'examples', folder / 'examples')
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']])
        domain = processes.free_ros_domain()
        self._environment = os.environ | {'PATH': path, 'ROS_DOMAIN_ID': str(domain)}
        self._running: list[subprocess.Popen[str]] = []

    def run(self, command: str, shown: str) -> None:
        """Run a command. It ends with exit code 0, or, with `&`, runs until `close`."""
        stays = command.endswith(' &')
        command = command.removesuffix(' &')
        for word, own in self._own.items():
            command = command.replace(word, own)
            shown = shown.replace(word, own) if word == '127.0.0.1' else shown
        process = subprocess.Popen(
            f'exec {command}',
            shell=True,
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=obey_interrupts,
        )
        assert process.stdout is not None
        expected, text = pattern(shown), ''
        if stays:
            self._running.append(process)
            while not expected.search(text):
                line = process.stdout.readline()
                assert line, text
                text += line
        else:
            text, _ = process.communicate(timeout=10 * PATIENCE)
            assert process.returncode == 0, text
            assert expected.search(text), f'{command}: {text}'

    def close(self) -> None:
        """End the running commands like Ctrl-C, the newest first."""
        while self._running:
            process = self._running.pop()
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=PATIENCE)


@pytest.fixture(scope='module')
def terminal(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path_factory.mktemp('tutorial'))
    yield terminal
    terminal.close()


@pytest.mark.slow
def test_commands_of_the_tutorial_run_as_printed(terminal: Terminal) -> None:
    done = 0
    for title, commands in sections():
        if title[:2] in ('4.', '5.', '6.'):  # the page ends the processes there
            terminal.close()
        for command, shown in commands:
            if 'controller spel' in command or 'ros2 launch' in command:
                terminal.close()
            terminal.run(command, shown)
            done += 1
    assert done >= 15
