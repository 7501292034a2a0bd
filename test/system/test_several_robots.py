# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two robots of one process, each in its namespace, do not affect each other."""

import signal
from contextlib import closing

import pytest
from support.cell import LASTS
from support.fleet import Fleet
from support.ros_peer import trajectory


@pytest.fixture(scope='module')
def fleet(tmp_path_factory):
    """Two enabled robots. The last test ends their driver."""
    with closing(Fleet(tmp_path_factory.mktemp('fleet'), together=True)) as robots:
        yield robots.enabled()


def move(peer, by, seconds=0.5):
    """Send a goal for the first joint."""
    here = peer.position().tolist()
    return peer.goal(trajectory((0.0, here), (seconds, [here[0] + by, *here[1:]])))


def test_killed_controller_does_not_affect_the_other_robot(fleet):
    left, right = fleet.peers.values()
    start = right.position()[0]
    goals = [move(left, 1.0, seconds=LASTS), move(right, 0.5, seconds=5.0)]
    left.wait_for_motion()
    fleet.controllers['left'].kill()
    ended, _, text = goals[0].result()
    assert ended == 'aborted'
    assert 'link was lost' in text
    assert goals[1].result()[0] == 'succeeded'
    assert right.assert_still()[0] == pytest.approx(start + 0.5, abs=1e-5)
    assert set(right.link_states[right.link_states.index('connected') :]) == {'connected'}
    fleet.restart('left')
    left.wait_for(lambda: left.link_states[-1] == 'connected', 'a new connection')
    left.enable()


def test_signal_stops_all_arms_and_ends_each_goal_once(fleet):
    goals = [move(peer, 1.0, seconds=LASTS) for peer in fleet.peers.values()]
    for peer in fleet.peers.values():
        peer.wait_for_motion()
    (client,) = fleet.clients
    before = len(client.log_text())
    assert client.end(signal.SIGINT) == 0
    for goal in goals:
        ended, _, text = goal.result()
        assert ended == 'aborted'
        assert 'shut down' in text
    log = client.log_text()[before:]
    assert 'Traceback' not in log
    for name in fleet.peers:
        assert log.count(f'[{name}.epson_driver]: goal aborted') == 1
