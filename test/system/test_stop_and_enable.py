# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""~/stop, ~/enable and ~/disable of the real node: what they answer is what was seen."""

import random
import time
from pathlib import Path
from typing import Any

import pytest
from support.cell import LASTS, START, Cell
from support.ros_peer import trajectory

RACES = 20


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('program', 'remote'),
    [
        ('built-in', True),
        pytest.param('built-in', False, marks=pytest.mark.slow),
        pytest.param('spel', True, marks=pytest.mark.slow),
    ],
)
def test_invariant_4_no_enable_on_its_way_arms_after_disable(
    make_cell: Any, program: str, remote: bool
) -> None:
    cell: Cell = make_cell(program=program, **({} if remote else {'remote_port': 0})).ready()
    peer = cell.peer
    if not remote:
        cell.pendant('motors', 'on')
        peer.wait_for(lambda: peer.robot_status[-1].drives_powered.val == 1, 'drives on')
    chance = random.Random(4)
    here = peer.position().tolist()
    there = [here[0] + 0.1, *here[1:]]
    for _ in range(RACES):
        enabling = peer.begin_call('enable')
        time.sleep(chance.uniform(0.0, 0.08))  # the races' moment, not a wait for anything
        success, message = peer.call('disable')
        assert success, message
        if remote:
            assert 'the motors are off' in message
        peer.complete(enabling)
        ended, _, text = peer.goal(trajectory((0.0, here), (1.0, there))).result()
        assert ended == 'aborted', text
        assert 'disabled by ~/disable' in text or 'not enabled' in text
    assert peer.assert_still().tolist() == here
    peer.enable()
    ended, _, text = peer.goal(trajectory((0.0, here), (1.0, there))).result()
    assert ended == 'succeeded', text


@pytest.mark.invariant(3)
def test_invariant_3_a_controller_that_does_not_stop_is_said_and_its_motors_go_off(
    make_cell: Any, tmp_path: Path
) -> None:
    profile = tmp_path / 'deaf.yaml'
    profile.write_text(
        'like: rc620\nname: deaf\ndescription: does not stop\nprogram:\n  stop_works: false\n',
        encoding='utf-8',
    )
    from epson_driver.share import share_file

    text = share_file('config', 'controllers', 'rc620.yaml').read_text(encoding='utf-8')
    (tmp_path / 'rc620.yaml').write_text(text, encoding='utf-8')
    cell: Cell = make_cell(f'--controller={profile}', patience=False).ready()
    peer = cell.peer
    peer.enable()
    goal = peer.goal(trajectory((0.0, START), (LASTS, [1.5, *START[1:]])))
    peer.wait_for_motion()
    success, message = peer.call('stop')
    assert not success, message
    assert 'STOP' in message
    peer.wait_for(lambda: peer.robot_status[-1].drives_powered.val == 0, 'drives off')
    assert peer.wait_until_still()[0] < 1.4
    assert goal.result()[0] == 'aborted'

    def alarm() -> bool:
        arms = [each for each in peer.diagnostics[-1].status if each.name.endswith(': arm')]
        return any(each.level == b'\x02' and 'STOP did not work' in each.message for each in arms)

    peer.wait_for(alarm, 'diagnostics')
    ended, _, text = peer.goal(trajectory((0.0, START), (1.0, START))).result()
    assert ended == 'aborted'
    assert 'not enabled' in text
