# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Any failure is reported and stops the arm, and every request is answered (invariant 9).

Failures are injected into the real client (failing_client.py) during a motion. Another client of
the controller observes the arm.
"""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from epson_msgs.msg import IoPoint
from epson_msgs.srv import ReadIo, SetSpeedScaling
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support.cell import START, TIMEOUTS
from support.ros_peer import PATIENCE, RosPeer, trajectory
from support.watcher import PROFILE, Watcher

from epson_driver.processes import processes

pytestmark = pytest.mark.invariant(9)

LOOP = (
    'state link',
    'motion link',
    'io link',
    'asking for the io',
    'state packet',
    'status',
    'reply',
    'state of the goal',
    'diagnostics',
    'watching the status',
    'publish joints',
    'publish status',
    'publish feedback',
    'cancelled task',
    'callback',
    'timer',
    'task',
    'exit',
    'exit of a callback',
    'interrupt',
)
THREADS = ('executor', 'executor, always', 'exit of the executor', 'thread')


class Robot:
    """A controller with an observed arm, and a client with injectable failures."""

    def __init__(self, folder: Path, domain: int | None = None, namespace: str = '') -> None:
        folder.mkdir(exist_ok=True)
        profile = folder / 'measured.yaml'
        profile.write_text(PROFILE.format(kind='simulated'), encoding='utf-8')
        start = ','.join(map(str, START))
        self.controller = processes.sim_controller(
            folder / 'controller.log',
            f'--controller={profile}',
            '--motion=smooth',
            f'--start={start}',
        )
        self.ports = self.controller.ports()
        self._folder = folder
        self._profile = profile
        self._file = folder / 'fails'
        self._clients = 0
        self.namespace = namespace
        self.prefix = f'/{namespace}' if namespace else ''
        self.domain = processes.free_ros_domain() if domain is None else domain
        self.peer = RosPeer(self.domain, self.prefix)
        self.client: subprocess.Popen[bytes] | None = None
        self.watcher: Watcher | None = None
        self.log = folder / 'none'

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the client."""
        ports = {f'{name}_port': port for name, port in asdict(self.ports).items()}
        return (
            TIMEOUTS
            | ports
            | {'io_timeout': 1.0}  # makes the I/O task run soon
            | {'controller': str(self._profile), 'trace_folder': str(self._folder)}
        )

    def start_client(self, *others: 'Robot') -> None:
        """Start a client for this and other robots, and watch and enable their arms."""
        self._clients += 1
        self.log = self._folder / f'client_{self._clients}.log'
        robots = (self, *others)
        file = self._folder / 'parameters.yaml'
        content = {
            f'{robot.prefix}/epson_driver': {'ros__parameters': robot.parameters()}
            for robot in robots
        }
        file.write_text(json.dumps(content), encoding='utf-8')  # JSON is valid YAML
        script = Path(__file__).parents[1] / 'support' / 'failing_client.py'
        names = [f'--namespace={robot.namespace}' for robot in robots if robot.namespace]
        for robot in robots:  # with a new peer, without old discovery data
            robot.peer.close()
            robot.peer = RosPeer(robot.domain, robot.prefix)
        with self.log.open('wb') as log:
            self.client = subprocess.Popen(
                [
                    *(sys.executable, str(script), str(self._file), *names),
                    *('--ros-args', '--params-file', str(file)),
                ],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=processes.ros_environment(self.domain),
            )
        for robot in robots:
            peer = robot.peer
            peer.wait_until_ready()
            peer.enable()
            robot.watcher = Watcher(robot.ports.state)

    def fail(self, name: str) -> None:
        """Inject a failure into the next call of a part."""
        assert self.client is not None
        self._file.write_text(name, encoding='utf-8')
        self.client.send_signal(signal.SIGUSR1)
        end = time.monotonic() + PATIENCE
        while self._file.exists() and self.client.poll() is None:  # until the signal is handled
            assert time.monotonic() < end, 'the client does not handle the signal'
            time.sleep(0.002)

    def move(self) -> Any:
        """Start a long motion to the far side, and return once the arm moves."""
        peer = self.peer
        peer.enable()  # independent of the previous test
        here = peer.position()
        far = here.copy()
        far[0] = -2.5 if here[0] > 0.0 else 2.5
        # 1 s to accelerate and to brake, and long enough for a slow machine
        shares = np.concatenate([[0.0], np.linspace(0.04, 0.96, 59), [1.0]])
        places = here + shares[:, None] * (far - here)
        times = np.concatenate([[0.0], np.linspace(1.0, 19.0, 59), [20.0]])
        goal = peer.goal(trajectory(*zip(times.tolist(), places.tolist(), strict=True)))
        peer.wait_for(lambda: abs(peer.joint_states[-1].position[0] - here[0]) > 0.1, 'a motion')
        return goal

    def assert_stopped(self) -> None:
        """Assert that the arm stops within its limits, before its target."""
        assert self.watcher is not None
        self.watcher.until_at_rest()
        assert abs(self.watcher.seen[-1].positions[0]) < 2.4
        self.watcher.assert_within_limits()

    def log_text(self) -> str:
        return self.log.read_text(encoding='utf-8', errors='replace')

    def end_client(self) -> None:
        if self.watcher is not None:
            self.watcher.close()
            self.watcher = None
        if self.client is not None:
            if self.client.poll() is None:
                self.client.kill()
            self.client.wait()
            self.client = None

    def close(self) -> None:
        self.end_client()
        self.peer.close()
        self.controller.end()


@pytest.fixture(scope='module')
def one_robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    robot = Robot(tmp_path_factory.mktemp('robot'))
    yield robot
    robot.close()


@pytest.fixture
def robot(one_robot: Robot) -> Iterator[Robot]:
    """A robot with a new client."""
    one_robot.start_client()
    yield one_robot
    one_robot.end_client()


def ends(robot: Robot) -> int:
    assert robot.client is not None
    return robot.client.wait(PATIENCE)


@pytest.mark.parametrize(
    'name',
    [
        *THREADS,
        *(
            name if index % 3 == 0 else pytest.param(name, marks=pytest.mark.soak)
            for index, name in enumerate(LOOP)
        ),
    ],
)
def test_failure_in_any_task_or_thread_stops_the_arm_and_the_process(
    robot: Robot, name: str
) -> None:
    goal = robot.move()
    robot.fail(name)
    if name in THREADS:  # they wait for a request
        robot.peer.in_executor(goal.handle.get_result_async)
    assert ends(robot) == 1
    robot.assert_stopped()
    log = robot.log_text()
    assert 'stopping all arms and the driver' in log
    assert 'injected' in log or name == 'cancelled task'
    assert 'Traceback' in log
    if name != 'executor, always':  # it can send no result
        assert goal.result()[0] == 'aborted'
    assert log.count('goal aborted: ') <= 1


def test_goal_with_an_unexpected_exception_is_answered(robot: Robot) -> None:
    first = robot.move()
    robot.fail('submit')
    second = robot.peer.goal(trajectory((1.0, [0.0] * 6)))
    assert ends(robot) == 1
    robot.assert_stopped()
    assert first.result()[0] == 'aborted'
    assert second.result() == ('aborted', -1, 'the driver has ended')


@pytest.mark.parametrize('name', ['cancel in the loop', 'rclpy'])
def test_failing_cancel_stops_the_arm_and_ends_the_process(robot: Robot, name: str) -> None:
    goal = robot.move()
    robot.fail(name)
    robot.peer.in_executor(goal.handle.cancel_goal_async)
    assert ends(robot) == 1
    robot.assert_stopped()
    assert goal.result()[0] in ('aborted', 'canceled')


def test_service_whose_callback_raises_system_exit_is_answered(robot: Robot) -> None:
    goal = robot.move()
    robot.fail('exit of ~/reset_error')
    answer = ask(robot, Trigger, 'epson_driver/reset_error')
    assert not answer.success
    assert 'SystemExit' in answer.message
    assert ends(robot) == 1
    robot.assert_stopped()
    assert goal.result()[0] == 'aborted'


@pytest.mark.parametrize('name', ['callback', 'executor'])
def test_failure_stops_all_robots_of_the_process(tmp_path: Path, name: str) -> None:
    left = Robot(tmp_path / 'left', namespace='left')
    right = Robot(tmp_path / 'right', left.domain, namespace='right')
    try:
        left.start_client(right)
        goals = [robot.move() for robot in (left, right)]
        left.fail(name)
        left.peer.in_executor(goals[0].handle.get_result_async)
        assert ends(left) == 1
        for robot in (left, right):
            robot.assert_stopped()
        assert [goal.result()[0] for goal in goals] == ['aborted', 'aborted']
    finally:
        for robot in (left, right):
            robot.close()


def ask(robot: Robot, kind: Any, name: str, request: Any = None) -> Any:
    """Call a service and return its response."""
    peer = robot.peer
    with peer.client(kind, name) as client:
        return peer.complete(client.call_async(request or kind.Request()))


POINTS = [IoPoint(type=IoPoint.DIGITAL_OUTPUT, index=1)]
REQUESTS = {
    '~/stop': (Trigger, None),
    '~/read_io': (ReadIo, ReadIo.Request(points=POINTS)),
    '~/set_speed_scaling': (SetSpeedScaling, SetSpeedScaling.Request(factor=0.5)),
}


def assert_still_serves(robot: Robot) -> None:
    """Assert that the arm stopped, and that the client still works after enabling."""
    robot.assert_stopped()
    assert robot.client is not None
    assert robot.client.poll() is None
    assert 'not enabled' in robot.peer.goal(trajectory((0.5, [0.0] * 6))).result()[2]
    robot.peer.enable()
    here = robot.peer.position().tolist()
    near = [here[0] * 0.95, *here[1:]]
    ended, _, text = robot.peer.goal(trajectory((0.0, here), (1.0, near))).result()
    assert ended == 'succeeded', text


@pytest.fixture(scope='module')
def serving(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """One client for all tests that it survives."""
    with closing(Robot(tmp_path_factory.mktemp('serving'))) as robot:
        robot.start_client()
        yield robot


@pytest.mark.parametrize('name', REQUESTS)
def test_failing_service_reports_the_error_and_stops_the_arm(serving: Robot, name: str) -> None:
    kind, request = REQUESTS[name]
    goal = serving.move()
    serving.fail(name)
    answer = ask(serving, kind, name.replace('~', 'epson_driver'), request)
    assert not answer.success
    assert name in answer.message
    assert 'injected' in answer.message
    assert 'stopped and disabled' in answer.message
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert 'injected' in text
    assert_still_serves(serving)


def test_failing_trace_ends_without_affecting_the_driver(serving: Robot) -> None:
    name = Parameter('trace_file', value='a.pcap').to_parameter_msg()
    request = SetParameters.Request(parameters=[name])
    [result] = ask(serving, SetParameters, 'epson_driver/set_parameters', request).results
    assert result.successful, result.reason
    goal = serving.move()
    serving.fail('trace')
    serving.peer.wait_for(lambda: 'InjectedError' in serving.log_text(), 'the end of the trace')
    assert serving.peer.call('stop')[0]
    assert 'stopped on request' in goal.result()[2]
    serving.assert_stopped()
