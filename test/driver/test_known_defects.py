# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Targets of docs/migration.md, and defects of the old client that no other file tests."""

import re
from pathlib import Path

import pytest
from support.driver_harness import (
    HOME,
    Harness,
    ScriptedController,
    frame,
    open_gate,
    pose,
    scripted_cell,
)
from support.event_loop import until
from support.pages import unwrapped

from epson_driver.driver.arm_commands import CommandError
from epson_driver.processes.command import EXECUTABLES
from epson_driver.profiles import load_controller_profile
from epson_driver.setup.setup import make_setup
from epson_driver.setup.table import ROWS

PAGE = Path(__file__).parents[2] / 'docs' / 'migration.md'


def names_here(title):
    """Return the names to which a section of the page maps old names."""
    section = PAGE.read_text('utf-8').split(f'\n## {title}\n')[1].split('\n## ')[0]
    for line in unwrapped(section).splitlines():
        if ' → ' in line:
            target, _, _ = line.split(' → ')[1].partition(' — ')
            yield from re.findall(r'`([^`]+)`', target)


@pytest.mark.parametrize('title', ['Topics, services, actions', 'Parameters'])
def test_names_on_the_migration_page_are_documented(title):
    documented = (PAGE.parent / 'ros_interface.md').read_text('utf-8')
    names = list(names_here(title))
    assert len(names) > 5
    for name in names:
        assert f'* `{name}` (' in documented


def test_nodes_on_the_migration_page_exist():
    for name in names_here('Nodes'):
        if ': ' in name:
            parameter, value = name.split(': ')
            assert value in ROWS[parameter].choices or parameter == 'controller'
        elif name not in ('motoman', 'fanuc', 'abb'):
            assert name in EXECUTABLES
    for name in ('motoman', 'fanuc', 'abb'):
        assert load_controller_profile(name).name == name


async def test_b1_frame_of_4000_bytes_is_skipped():
    """The old library overwrote its stack."""
    async with ScriptedController() as controller, Harness(controller.ports) as harness:
        await harness.ready()
        controller.extra = frame(10, 1, 0, bytes(4000 - 12))
        counted = harness.driver.state_link.statistics
        await until(lambda: counted.bad_frames)
        assert counted.bad_frames == {'body': 1}
        seen = len(harness.events.samples)
        await until(lambda: len(harness.events.samples) > seen + 2)
        assert counted.connections == 1


def test_147_more_than_ten_joints_are_refused():
    names = [f'joint_{number}' for number in range(1, 12)]
    with pytest.raises(ValueError, match='parameter joint_names has 11 names'):
        make_setup({'joint_names': names})


async def test_191_first_point_is_sent_immediately():
    """There is no timer, sleep or loop iteration between the goal and its first point."""
    async with scripted_cell() as (harness, controller):
        sent = harness.driver.motion_link.statistics.frames_sent
        goal = harness.submit(pose(0.1))
        assert harness.driver.motion_link.statistics.frames_sent == sent + 1
        await until(lambda: controller.received)
        assert controller.received[0] == 0
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()


async def test_motoman_228_trajectory_without_a_joint_state_is_refused():
    controller = ScriptedController()
    controller.shows_joints = False
    async with controller, Harness(controller.ports) as harness:
        await until(lambda: harness.driver.robot.status is not None)
        await until(lambda: harness.driver.motion_link.connected)
        with pytest.raises(CommandError, match='no joint state from the controller'):
            await harness.commands.enable()
        open_gate(harness.driver.gate)
        goal = harness.submit(pose(0.1), start=HOME)
        assert 'no joint state' in (await goal.end()).text
        assert controller.received == []


@pytest.mark.parametrize(
    ('status', 'words'),
    [
        ((1, 1, 0, 0, 0, 2, 0), 'E-stop'),
        ((1, 0, 4031, 1, 0, 2, 0), 'in error 4031'),
        ((0, 0, 0, 0, 0, 2, 0), 'motors are off'),
    ],
    ids=['E-stop', 'error', 'motors off'],
)
async def test_271_status_alone_ends_the_goal_and_closes_the_gate(status, words):
    """Only the STATUS reports the cause, without a reply or a lost link."""
    async with scripted_cell(lambda _: b'') as (harness, controller):
        goal = harness.submit(pose(0.1))
        await until(lambda: controller.received)
        controller.status = status
        assert words in (await goal.end()).text
        assert words in harness.gate
        controller.status = ScriptedController.STATUS
        seen = len(harness.events.statuses)
        await until(lambda: len(harness.events.statuses) > seen + 2)
        assert words in harness.submit(pose(0.1)).outcome.text
