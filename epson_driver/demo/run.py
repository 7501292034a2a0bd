# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Executes a planned trajectory with a controller and a driver.

The motion is measured, judged and reported.
"""

import asyncio
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from epson_driver.demo.cell import panel_beside, running_driver, stay
from epson_driver.demo.picture import TRACE, Drawn, draw, recorded_run, top_speed
from epson_driver.inputs import printable
from epson_driver.motion import Trajectory
from epson_driver.processes import processes
from epson_driver.processes.processes import Ports, RunError
from epson_driver.remote_ethernet.client import execute
from epson_driver.report.figures import Figures as PageFigures
from epson_driver.report.figures import figures
from epson_driver.report.measure import MAX_DEVIATION_RAD, Figures, Recording, measure
from epson_driver.report.page import write_report
from epson_driver.report.run import Run as WireRun
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.simple_message import LITTLE_ENDIAN, Ping, encode, request

TOO_BUSY = 3  # the exit code of a run that cannot be judged
MAX_GAP_S = 0.1  # maximum gap between joint states for a run that can be evaluated, s
PINGS = 50
TIMEOUT_S = 5.0

TITLES = {'ptp': 'point to point', 'smooth': 'smooth', 'spel': 'SPEL+ program'}


def deadlines_missed(remote_port: int) -> int:
    """Return the number of deadlines missed by the simulated controller on this machine.

    The controller counts late motion cycles and late plans of the smoother by its own clock.
    """
    command = execute('127.0.0.1', remote_port, ['Sim,timing'], TIMEOUT_S)
    cycles, plans, *_ = asyncio.run(command)[0].split(',')
    return int(cycles) + int(plans)


def verdict(faults: Sequence[str], missed: int, longest_gap: float) -> tuple[int, str]:
    """Return the exit code of a run, and a sentence about it.

    `faults`: deviations from the plan. `longest_gap`: longest interval between two joint states,
    s. A run without faults passes, even if the machine was busy.
    """
    if not faults:
        return 0, 'the arm followed the plan'
    if missed or longest_gap > MAX_GAP_S:
        return TOO_BUSY, (
            f'this machine was too busy to judge the motion: the simulated controller missed '
            f'{missed} of its deadlines, and joint states were up to {longest_gap * 1e3:.0f} ms '
            f'apart ({", ".join(faults)}). Try again with a lower load'
        )
    return 1, f'the motion differs from the plan: {", ".join(faults)}'


def run(
    trajectory: Trajectory,
    robot: str,
    motions: Sequence[tuple[str, str]],
    picture: Path,
    report: Path,
    console: Console,
    *,
    staying: bool,
) -> int:
    """Execute a trajectory once per motion and controller profile, and return the exit code.

    The exit code is 0 if the arm followed the plan, TOO_BUSY if a busy machine makes this
    uncertain, else 1. `staying`: also run the panel, and keep everything running until Ctrl-C.
    This requires a single motion.
    """
    model = load_robot_model(robot)
    runs = []
    try:
        for turn, (motion, controller) in enumerate(motions, start=1):
            if len(motions) > 1:
                console.rule(f'{turn} of {len(motions)}: {TITLES[motion]}')
            with (
                tempfile.TemporaryDirectory(prefix='epson_driver_demo_') as folder,
                _executed(
                    robot, model, motion, controller, trajectory, Path(folder), console, staying
                ) as (done, go_on),
            ):
                runs.append(done)
                if staying:
                    code = _report(model, trajectory, runs, picture, report, console)
                    go_on()
                    return code
    except _GoalError as error:
        return _unfinished(error, model, report, console)
    return _report(model, trajectory, runs, picture, report, console)


@dataclass(frozen=True, eq=False)
class Run:
    """One execution of the trajectory: measurements, and reports of driver and controller."""

    motion: str
    recording: Recording
    figures: Figures
    text: str
    latencies: dict[str, str]
    round_trips: list[float]
    missed: int  # deadlines missed by the controller during the run
    page: tuple[WireRun, PageFigures]  # the run on the wire and its figures, for the report page

    @property
    def faults(self) -> list[str]:
        faults = []
        if self.figures.waypoint_deviation > MAX_DEVIATION_RAD:
            faults.append(
                f'a waypoint was missed by {self.figures.waypoint_deviation:.4f} rad '
                f'(allowed: {MAX_DEVIATION_RAD:g} rad)'
            )
        if self.motion != 'ptp' and self.figures.stops:
            times = 'once' if self.figures.stops == 1 else f'{self.figures.stops} times'
            faults.append(f'the arm stopped {times} during the motion')
        return faults


def as_on_page(numbers: Figures, page: PageFigures) -> Figures:
    """Return the measured values of a run with the larger one of two stop counts.

    One count is from `measure`, the other from the run's report page. `measure` detects stops
    relative to the typical speed, so it may merge a slow start and the stops after it into one
    stop. The page counts each stop separately.
    """
    stood = len(page.stops) - numbers.commanded_stops
    return replace(numbers, stops=max(numbers.stops, stood, *(m.stops or 0 for m in page.motions)))


class _GoalError(RunError):
    """The arm did not reach a goal.

    `missed`: deadlines that the controller missed during the motion.
    """

    def __init__(self, text: str, missed: int, wire: WireRun) -> None:
        super().__init__(text)
        self.missed = missed
        self.wire = wire


@contextmanager
def _executed(
    robot: str,
    model: RobotModel,
    motion: str,
    controller: str,
    trajectory: Trajectory,
    folder: Path,
    console: Console,
    staying: bool,
) -> Iterator[tuple[Run, Callable[[], None]]]:
    """Execute the trajectory with a controller and driver that run until the block ends.

    Yields the run, and a function that keeps the cell running until Ctrl-C.
    """
    began = time.monotonic()
    start = trajectory.positions[0].tolist()
    how = [f'--controller={controller}', f'--robot={robot}']
    if motion != 'spel':
        how.append(f'--motion={motion}')
    sim_controller = processes.sim_controller(folder / 'sim_controller.log', *how, start=start)
    with processes.ended_at_exit(sim_controller):
        ports = sim_controller.ports()
        round_trips = _ping(ports) if staying else []
        with (
            running_driver(
                folder,
                ports,
                trajectory.joint_names,
                console,
                controller=controller,
                robot_model=robot,
                allow_nonzero_velocity_at_trajectory_end='true',
                trace_folder=str(folder),
                trace_file=TRACE,
            ) as driver,
            panel_beside(folder, driver, console, enabled=staying) as panel,
        ):
            user = driver.user
            missed = deadlines_missed(ports.remote)
            console.print(f'robot ready after {time.monotonic() - began:.1f} s')
            text, succeeded = user.execute(trajectory, console)
            missed = deadlines_missed(ports.remote) - missed
            wire = recorded_run(folder / TRACE, model, TITLES[motion])
            if not succeeded:
                raise _GoalError(f'the goal was not reached: {text}', missed, wire)
            latencies = user.reply_latencies()
            run = user.recording()
            metric = model.limits.rad_per_unit
            page = figures(wire, metric)
            numbers = as_on_page(measure(trajectory, run, metric), page)
            done = Run(motion, run, numbers, text, latencies, round_trips, missed, (wire, page))
            if staying:
                yield done, partial(stay, driver, panel, console)
                return
        round_trips += _ping(ports)  # with the controller to itself
        yield done, lambda: None


def _report(
    model: RobotModel,
    trajectory: Trajectory,
    runs: list[Run],
    picture: Path,
    report: Path,
    console: Console,
) -> int:
    console.print(_table(model, trajectory, runs))
    drawn = [Drawn(TITLES[run.motion], run.recording, run.figures) for run in runs]
    draw(picture, trajectory, drawn, model.limits)
    console.print(f'picture: {picture}', highlight=False)
    write_report([run.page for run in runs], model, report)
    faults = [f'{TITLES[run.motion]}: {fault}' for run in runs for fault in run.faults]
    gap = max(run.figures.longest_gap for run in runs)
    return _judged(console, faults, sum(run.missed for run in runs), gap)


def _unfinished(error: _GoalError, model: RobotModel, report: Path, console: Console) -> int:
    try:
        shown = figures(error.wire, model.limits.rad_per_unit)
        write_report([(error.wire, shown)], model, report)
    except OSError as why:
        console.print(f'no report: {escape(printable(why))}', highlight=False)
    gap = float(np.max(np.diff(error.wire.times), initial=0.0))  # also covers a stalled driver
    return _judged(console, [str(error)], error.missed, gap)


def _judged(console: Console, faults: list[str], missed: int, gap: float) -> int:
    code, sentence = verdict(faults, missed, gap)
    colour = {0: 'green', TOO_BUSY: 'yellow'}.get(code, 'red')
    message = f'[bold {colour}]{escape(printable(sentence))}[/]'
    console.print(message, highlight=False, soft_wrap=True)
    return code


def _ping(ports: Ports) -> list[float]:
    """Return the round-trip times of PINGs to the controller's I/O port, s, sorted.

    A connection that is refused is retried, because a SPEL+ program closes the port for a moment
    when a client disconnects.
    """
    until = time.monotonic() + TIMEOUT_S
    while True:
        try:
            return _round_trips(ports.io)
        except ConnectionError as error:
            if time.monotonic() >= until:
                raise RunError(f'the controller closed its I/O port: {error}') from error
            time.sleep(0.1)


def _round_trips(port: int) -> list[float]:
    frame = encode(request(Ping()), LITTLE_ENDIAN)
    times = []
    with socket.create_connection(('127.0.0.1', port), timeout=TIMEOUT_S) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(PINGS):
            sent = time.perf_counter()
            connection.sendall(frame)
            answer = b''
            while len(answer) < len(frame):
                chunk = connection.recv(len(frame) - len(answer))
                if not chunk:
                    raise ConnectionAbortedError('it ended the connection')
                answer += chunk
            times.append(time.perf_counter() - sent)
    return sorted(times)


def _table(model: RobotModel, trajectory: Trajectory, runs: list[Run]) -> Table:
    table = Table(show_header=len(runs) > 1, title='What happened', title_justify='left')
    table.add_column('')
    for run in runs:
        table.add_column(TITLES[run.motion])
    columns = [_rows(model, trajectory, run) for run in runs]
    for rows in zip(*columns, strict=True):
        table.add_row(rows[0][0], *(text for _, text in rows))
    return table


def _rows(model: RobotModel, trajectory: Trajectory, run: Run) -> tuple[tuple[str, str], ...]:
    figures, latencies, round_trips = run.figures, run.latencies, run.round_trips
    median = round_trips[len(round_trips) // 2] * 1e3
    stops = f'{figures.stops}'
    if figures.commanded_stops:
        stops += f', and {figures.commanded_stops} in the plan'
    return (
        ('result', run.text),
        ('points', f'{len(trajectory.times)}'),
        (
            'duration',
            f'{figures.moved:.2f} s, planned {figures.planned:.2f} s '
            f'({figures.moved / figures.planned:.2f} times)',
        ),
        ('intermediate stops', stops),
        ('highest velocity', top_speed(run.recording, model.limits)),
        ('worst deviation at a waypoint', f'{figures.waypoint_deviation * 1e3:.2f} mrad'),
        ('deviation at the end', f'{figures.end_deviation * 1e3:.4f} mrad'),
        (
            'joint states',
            f'{figures.rate:.0f} Hz, longest gap {figures.longest_gap * 1e3:.0f} ms',
        ),
        (
            'reply to a point',
            f'median {latencies.get("reply latency median [ms]", "?")} ms, '
            f'p99 {latencies.get("reply latency p99 [ms]", "?")} ms '
            f'({"after the move" if run.motion == "ptp" else "when its buffer has room"})',
        ),
        (
            'round trip to the controller',
            f'median {median:.2f} ms, longest {round_trips[-1] * 1e3:.2f} ms ({PINGS} pings)',
        ),
    )
