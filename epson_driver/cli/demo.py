# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver demo`: a planned trajectory through real ROS 2 to a simulated controller.

Starts sim_controller and client as processes of their own, enables the arm, sends the trajectory
as a FollowJointTrajectory goal, and reports what the joint states showed.
"""

import argparse
import os
import signal
import socket
import sys
import tempfile
import time
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.table import Table

from epson_driver.cli import processes
from epson_driver.cli.demo_report import DEVIATION_ALLOWED, Figures, draw, measure
from epson_driver.cli.processes import RunError
from epson_driver.cli.ros_user import RosUser
from epson_driver.cli.trajectory_file import TrajectoryFileError, read_trajectory
from epson_driver.motion import Trajectory
from epson_driver.share import share_file
from epson_driver.simple_message import LITTLE_ENDIAN, Ping, encode, request

PINGS = 50


def main() -> int:
    """Run the demo. Returns 0 only if the arm did what was planned."""
    arguments = _arguments()
    console = Console()
    for number in (
        signal.SIGINT,
        signal.SIGTERM,
    ):  # SIGINT too: a shell's `&` passes it on ignored
        signal.signal(number, _on_terminate)
    try:
        trajectory = read_trajectory(arguments.trajectory)
        with tempfile.TemporaryDirectory(prefix='epson_driver_demo_') as folder:
            return _run(arguments, trajectory, Path(folder), console)
    except (RunError, TrajectoryFileError, OSError) as error:
        console.print(f'[bold red]demo failed:[/] {error}', highlight=False)
        return 1
    except KeyboardInterrupt:
        console.print('stopped')
        return 130


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='epson_driver demo',
        description='A planned trajectory through ROS 2 to a simulated EPSON C3, and a report.',
    )
    parser.add_argument(
        '--trajectory',
        type=Path,
        metavar='FILE',
        default=share_file('config', 'trajectories', 'around_pillar_11_points.yaml'),
        help='a JointTrajectory as YAML (default: %(default)s)',
    )
    parser.add_argument(
        '--motion', choices=['ptp'], default='ptp', help='how the controller moves'
    )
    parser.add_argument(
        '--picture',
        type=Path,
        metavar='FILE',
        default=Path('demo-report.png'),
        help='where to draw positions and velocities (default: %(default)s)',
    )
    return parser.parse_args()


def _on_terminate(_number: int, _frame: object) -> NoReturn:
    raise KeyboardInterrupt


def _run(
    arguments: argparse.Namespace, trajectory: Trajectory, folder: Path, console: Console
) -> int:
    began = time.monotonic()
    domain = processes.free_ros_domain()
    start = ','.join(f'{position:.9g}' for position in trajectory.positions[0])
    controller = processes.sim_controller(
        folder / 'sim_controller.log', f'--motion={arguments.motion}', f'--start={start}'
    )
    with processes.ended_at_exit(controller):
        ports = controller.ports()
        names = '[' + ','.join(trajectory.joint_names) + ']'
        client = processes.client(
            folder / 'client.log',
            ports,
            domain,
            joint_names=names,
            allow_nonzero_velocity_at_trajectory_end='true',
        )
        with processes.ended_at_exit(client):
            console.print(
                f'sim_controller on 127.0.0.1:{ports.motion} (motion) and :{ports.state} (state), '
                f'client in ROS domain {domain}',
                highlight=False,
            )
            os.environ.update(processes.ros_environment(domain))
            user = RosUser(trajectory, lambda: _check_alive(client))
            try:
                user.enable()
                console.print(f'robot ready after {time.monotonic() - began:.1f} s')
                text, succeeded = user.execute(console)
                latencies = user.reply_latencies()
                run = user.recording()
            finally:
                user.close()
        round_trips = _ping(ports)
    if not succeeded:
        raise RunError(f'the goal was not reached: {text}')
    figures = measure(trajectory, run)
    right = figures.waypoint_deviation <= DEVIATION_ALLOWED
    console.print(_table(trajectory, figures, text, latencies, round_trips))
    draw(arguments.picture, trajectory, run, figures)
    console.print(f'picture: {arguments.picture}', highlight=False)
    if not right:
        console.print('[bold red]the motion was not as planned[/]')
        return 1
    console.print('[bold green]the arm did what was planned[/]')
    return 0


def _check_alive(process: processes.Process) -> None:
    if process.returncode is not None:
        raise RunError(f'{process.name} ended with {process.returncode}:\n{process.log_text()}')


def _ping(ports: processes.Ports) -> list[float]:
    """Return the round-trip times of PINGs to the controller's I/O port, s, sorted."""
    frame = encode(request(Ping()), LITTLE_ENDIAN)
    times = []
    with socket.create_connection(('127.0.0.1', ports.io), timeout=5.0) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(PINGS):
            sent = time.perf_counter()
            connection.sendall(frame)
            answer = b''
            while len(answer) < len(frame):
                chunk = connection.recv(len(frame) - len(answer))
                if not chunk:
                    raise RunError('the controller closed its I/O port')
                answer += chunk
            times.append(time.perf_counter() - sent)
    return sorted(times)


def _table(
    trajectory: Trajectory,
    figures: Figures,
    text: str,
    latencies: dict[str, str],
    round_trips: list[float],
) -> Table:
    table = Table(show_header=False, title='What happened', title_justify='left')
    median = round_trips[len(round_trips) // 2] * 1e3
    rows = (
        ('result', text),
        ('points', f'{len(trajectory.times)}'),
        (
            'duration',
            f'{figures.moved:.2f} s, planned {figures.planned:.2f} s '
            f'({figures.moved / figures.planned:.2f} times)',
        ),
        ('stops on the way', f'{figures.stops}'),
        ('worst deviation at a waypoint', f'{figures.waypoint_deviation * 1e3:.2f} mrad'),
        ('deviation at the end', f'{figures.end_deviation * 1e3:.4f} mrad'),
        (
            'joint states',
            f'{figures.rate:.0f} Hz, longest gap {figures.longest_gap * 1e3:.0f} ms',
        ),
        (
            'reply to a point',
            f'median {latencies.get("reply latency median [ms]", "?")} ms, '
            f'p99 {latencies.get("reply latency p99 [ms]", "?")} ms (after the move)',
        ),
        (
            'round trip to the controller',
            f'median {median:.2f} ms, longest {round_trips[-1] * 1e3:.2f} ms ({PINGS} pings)',
        ),
    )
    for row in rows:
        table.add_row(*row)
    return table


if __name__ == '__main__':
    sys.exit(main())
