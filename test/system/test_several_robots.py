# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two robots of one process, each in its namespace, do not affect each other."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.node import Node
from support.cell import LASTS
from support.fleet import Fleet
from support.ros_peer import RosPeer, trajectory

from epson_driver.processes import processes

NAMES = ('left', 'right')

ABSOLUTE = {'/diagnostics', '/rosout', '/parameter_events', '/tf_static'}
"""Topics shared by all nodes, whose entries name the robot."""


@pytest.fixture(scope='module')
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    """Two enabled robots. The last test ends their driver."""
    with closing(Fleet(tmp_path_factory.mktemp('fleet'), together=True, names=NAMES)) as robots:
        yield robots.enabled()


def move(peer: RosPeer, by: float, seconds: float = 0.5) -> Any:
    """Send a goal for the first joint."""
    here = peer.position().tolist()
    return peer.goal(trajectory((0.0, here), (seconds, [here[0] + by, *here[1:]])))


def names_of(peer: RosPeer, robot: str) -> set[tuple[str, str]]:
    """Return kind and name of a node's publishers, subscribers, services and actions."""
    queries = {
        'publisher': Node.get_publisher_names_and_types_by_node,
        'subscriber': Node.get_subscriber_names_and_types_by_node,
        'service': Node.get_service_names_and_types_by_node,
        'action': get_action_server_names_and_types_by_node,
    }
    return {
        (kind, name)
        for kind, query in queries.items()
        for name, _ in query(peer.node, 'epson_driver', f'/{robot}')
    }


def test_each_robot_has_its_full_set_of_names_and_diagnostics(fleet: Fleet) -> None:
    sets = []
    for robot, peer in fleet.peers.items():
        result = names_of(peer, robot)
        assert {name for _, name in result if not name.startswith(f'/{robot}/')} <= ABSOLUTE
        sets.append({(kind, name.removeprefix(f'/{robot}')) for kind, name in result})
    assert sets[0] == sets[1]
    assert {
        ('publisher', '/joint_states'),
        ('publisher', '/epson_driver/io_states'),
        ('subscriber', '/joint_path_command'),
        ('service', '/epson_driver/set_parameters'),
        ('action', '/epson_driver/follow_joint_trajectory'),
    } <= sets[0]
    wanted = {
        f'{robot}/epson_driver: {part}'
        for robot in NAMES
        for part in ('state link', 'motion link', 'io link', 'arm')
    }

    def shown() -> dict[str, str]:
        arrays = fleet.peers['left'].diagnostics
        return {status.name: status.hardware_id for array in arrays for status in array.status}

    fleet.peers['left'].wait_for(lambda: wanted <= set(shown()), 'diagnostics of both')
    assert set(shown()) == wanted
    for robot in NAMES:
        place = f'127.0.0.1:{fleet.ports[robot].state}'
        assert shown()[f'{robot}/epson_driver: state link'] == place


def test_goal_moves_only_its_robot(fleet: Fleet) -> None:
    left, right = fleet.peers.values()
    before = [peer.position()[0] for peer in fleet.peers.values()]
    assert move(left, 0.2).result()[0] == 'succeeded'
    after = [peer.assert_still()[0] for peer in fleet.peers.values()]
    assert np.allclose(np.array(after) - before, [0.2, 0.0], atol=1e-5)
    assert np.ptp([state.position[0] for state in right.joint_states]) == 0.0
    assert not right.controller_states


def test_estop_leaves_the_other_robot_enabled(fleet: Fleet) -> None:
    left, right = fleet.peers.values()
    goals = [move(left, -1.0, seconds=LASTS), move(right, -0.3, seconds=5.0)]
    left.wait_for_motion()
    fleet.pendant('left', 'estop', 'press')
    assert goals[0].result()[:2] == ('aborted', -4)
    assert goals[1].result()[0] == 'succeeded'
    assert 'not enabled' in move(left, 0.1).result()[2]
    assert move(right, 0.1).result()[0] == 'succeeded'
    assert not any(status.e_stopped.val == 1 for status in right.robot_status)
    fleet.pendant('left', 'estop', 'release')
    assert left.call('reset_error')[0]
    left.wait_for(lambda: left.robot_status[-1].e_stopped.val == 0, 'a reset E-stop')
    left.enable()
    assert move(left, 0.1).result()[0] == 'succeeded'


def test_killed_controller_does_not_affect_the_other_robot(fleet: Fleet) -> None:
    left, right = fleet.peers.values()
    goals = [move(left, 1.0, seconds=LASTS), move(right, 0.5, seconds=5.0)]
    left.wait_for_motion()
    fleet.controllers['left'].kill()
    ended, code, text = goals[0].result()
    assert (ended, code) == ('aborted', -4)
    assert 'link was lost' in text
    left.wait_for(lambda: 'backing_off' in left.link_states, 'backing_off')
    assert goals[1].result()[0] == 'succeeded'
    assert set(right.link_states[right.link_states.index('connected') :]) == {'connected'}
    assert move(right, -0.1).result()[0] == 'succeeded'
    fleet.restart('left')
    left.wait_for(lambda: left.link_states[-1] == 'connected', 'a new connection')
    left.enable()


def test_signal_stops_all_arms_and_ends_each_goal_once(fleet: Fleet) -> None:
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
    for name in fleet.names:
        assert log.count(f'[{name}.epson_driver]: goal aborted') == 1


def run_clients(tmp_path: Path, *arguments: str, file: str = '') -> subprocess.CompletedProcess:
    """Run drivers that must end with an error."""
    parameters = tmp_path / 'robots.yaml'
    parameters.write_text(file or '/**: {ros__parameters: {io_port: 0}}', encoding='utf-8')
    return subprocess.run(
        [
            *(sys.executable, '-m', 'epson_driver.cli', 'client', *arguments),
            *('--ros-args', '--params-file', str(parameters)),
        ],
        env=processes.ros_environment(processes.free_ros_domain()),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_robot_with_invalid_parameter_is_named(tmp_path: Path) -> None:
    file = (
        '/left/epson_driver: {ros__parameters: {byte_order: middle}}\n'
        '/right/epson_driver: {ros__parameters: {robot_model: c9}}\n'
    )
    names = ('--namespace=left', '--namespace=middle', '--namespace=right')
    run = run_clients(tmp_path, *names, file=file)
    assert run.returncode == 1
    assert 'Traceback' not in run.stderr
    wrong = [line for line in run.stderr.splitlines() if 'FATAL' in line]
    assert len(wrong) == 2
    assert '/left/epson_driver: parameter byte_order' in wrong[0]
    assert '/right/epson_driver: ' in wrong[1]
    assert 'c9' in wrong[1]
    assert 'connected' not in run.stderr


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('--namespace=left', '--namespace=left'), ('/left/epson_driver', 'two robots')),
        (('--namespace=not-a-name',), ('--namespace not-a-name', 'nvalid')),
    ],
)
def test_invalid_or_duplicate_namespaces_are_rejected(
    tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    run = run_clients(tmp_path, *arguments)
    assert run.returncode == 1, run.stderr
    assert 'Traceback' not in run.stderr
    for word in words:
        assert word in run.stderr
