# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver demo`: a planned trajectory through real ROS 2 to a simulated controller.

Starts sim_controller and client as processes of their own, enables the arm, sends the trajectory
as a FollowJointTrajectory goal, and reports what the joint states showed. With --compare twice: a
controller that rests at every point, then one that smooths. With --plan the trajectory is planned
on the spot (demo_plan.py). With --stay controller and driver go on afterwards, with a panel in the
browser.
"""

import argparse
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from epson_driver.cli.arguments import argument, page, picture
from epson_driver.cli.cell import running_controller, running_driver
from epson_driver.cli.demo_report import TRACE, Drawn, draw, recorded_run, top_speed
from epson_driver.cli.demo_verdict import TOO_BUSY, deadlines_missed, verdict
from epson_driver.cli.interrupt import INTERRUPTED
from epson_driver.cli.panel import INSTALL as INSTALL_PANEL
from epson_driver.cli.panel import missing as panel_missing
from epson_driver.cli.processes import Ports, RunError
from epson_driver.cli.report import write_report
from epson_driver.cli.staying import panel_beside, stay
from epson_driver.cli.trajectory_file import read_trajectory
from epson_driver.inputs import InputError, count, printable
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.report.figures import Figures as PageFigures
from epson_driver.report.figures import figures
from epson_driver.report.measure import MAX_DEVIATION_RAD, Figures, Recording, measure
from epson_driver.report.run import Run as WireRun
from epson_driver.report.run import RunError as ReportError
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.robots.model import SCARA, SIX_AXIS
from epson_driver.share import share_file
from epson_driver.simple_message import LITTLE_ENDIAN, Ping, encode, request

PINGS = 50

MAX_SEEDS = 1_000_000

PLANNING = ('coal', 'ompl', 'pinocchio', 'py_opw_kinematics', 'scipy')
"""The additional modules that --plan needs."""

INSTALL = (
    "pip install 'epson_driver[planning]' (in the source tree: make demo ARGS=--plan); "
    'OMPL comes for Python up to 3.13'
)

SIGNALS = (signal.SIGINT, signal.SIGTERM)

ROBOT = 'c3_a601s'
TRAJECTORY = share_file('config', 'trajectories', 'around_pillar_11_points.yaml')
TRAJECTORY_OF_SCARAS = share_file('config', 'trajectories', 'scara_pick_and_place.yaml')
"""What is executed if nothing is said: the first for ROBOT, the second for all SCARAs."""

TITLES = {'ptp': 'point to point', 'smooth': 'smooth', 'spel': 'SPEL+ program'}

NATIVE = 'rc620'
"""The profile that a SPEL+ program is compared with: its program is built in."""


def main() -> int:
    """Run the demo. Returns 0 only if the arm did what was planned, 3 if that cannot be judged."""
    arguments = _arguments()
    console = Console()
    if arguments.plan:
        missing = [name for name in PLANNING if find_spec(name) is None]
        if missing:
            console.print(
                f'--plan needs {", ".join(missing)}: {INSTALL}', highlight=False, markup=False
            )
            return 2
    if arguments.panel and panel_missing():
        console.print(INSTALL_PANEL, highlight=False, markup=False)
        return 2
    staying, model = arguments.stay or arguments.panel, arguments.model
    for number in SIGNALS:  # SIGINT too: a shell's `&` passes it on ignored
        signal.signal(number, _on_signal)
    try:
        if arguments.plan:
            from epson_driver.cli import demo_plan  # imports the optional modules

            first = arguments.seed or 1
            seeds = range(first, first + (arguments.seeds or 1))
            return demo_plan.run(
                arguments.robot,
                seeds,
                arguments.picture,
                arguments.report,
                console,
                staying=staying,
            )
        trajectory = _fitting(arguments.trajectory, model)
        motions = _motions(arguments)
        runs = []
        for turn, motion in enumerate(motions, start=1):
            if arguments.compare:
                console.rule(f'{turn} of {len(motions)}: {TITLES[motion]}')
            native = arguments.spel and motion != 'spel'
            controller = NATIVE if native else arguments.controller
            with (
                tempfile.TemporaryDirectory(prefix='epson_driver_demo_') as folder,
                _executed(
                    arguments.robot, motion, controller, trajectory, Path(folder), console, staying
                ) as (
                    run,
                    go_on,
                ),
            ):
                runs.append(run)
                if staying:
                    code = _report(arguments, model, trajectory, runs, console)
                    go_on()
                    return code
        return _report(arguments, model, trajectory, runs, console)
    except _GoalError as error:
        return _unfinished(error, model, arguments.report, console)
    except (RunError, ReportError, InputError, OSError) as error:
        said = f'[bold red]demo failed:[/] {escape(printable(error))}'
        console.print(said, highlight=False, soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        console.print('stopped')
        return INTERRUPTED


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='epson_driver demo',
        description='A planned trajectory through ROS 2 to a simulated EPSON robot, and a report.',
    )
    parser.add_argument(
        '--robot',
        default=ROBOT,
        metavar='MODEL',
        help='the robot model, six-axis or SCARA (%(default)s); other six-axis ones need --plan '
        'or --trajectory',
    )
    parser.add_argument(
        '--trajectory',
        type=Path,
        metavar='FILE',
        help=f'a JointTrajectory as YAML (default: {TRAJECTORY.name}; for SCARAs: '
        f'{TRAJECTORY_OF_SCARAS.name})',
    )
    parser.add_argument(
        '--controller',
        default=NATIVE,
        help='controller profile, or a .yaml file; spel: the SPEL+ program for real controllers '
        '(%(default)s)',
    )
    parser.add_argument(
        '--motion',
        choices=('smooth', 'ptp'),
        help='how the controller moves: through all points, or resting at each (smooth)',
    )
    parser.add_argument(
        '--compare',
        action='store_true',
        help='run both, one after the other, in one picture; with a SPEL+ program: it and the '
        f'built-in one of {NATIVE}',
    )
    parser.add_argument(
        '--picture',
        type=picture,
        metavar='FILE',
        default=Path('demo-report.png'),
        help='where to draw positions and velocities (default: %(default)s)',
    )
    parser.add_argument(
        '--report',
        type=page,
        metavar='FILE',
        help='where to write the page with arm and figures (default: beside the picture)',
    )
    parser.add_argument(
        '--plan',
        action='store_true',
        help='plan a pick and place around obstacles, execute it, and check it for collisions',
    )
    parser.add_argument(
        '--seed',
        type=argument(count(1, 2**63 - 1)),
        metavar='N',
        help='seed of the random task of --plan (default: 1)',
    )
    parser.add_argument(
        '--seeds',
        type=argument(count(1, MAX_SEEDS)),
        metavar='COUNT',
        help='how many tasks --plan executes, one seed after the other (default: 1)',
    )
    parser.add_argument(
        '--stay',
        action='store_true',
        help='keep controller and driver running until Ctrl-C, for other terminals, and the panel '
        'if it is installed',
    )
    parser.add_argument(
        '--panel', action='store_true', help='the same, and the panel must be installed'
    )
    arguments = parser.parse_args()
    arguments.report = arguments.report or arguments.picture.with_suffix('.html')
    if arguments.plan and (arguments.compare or arguments.motion == 'ptp'):
        parser.error('--plan is for smooth motion: leave out --compare and --motion ptp')
    if arguments.plan and arguments.controller != NATIVE:
        parser.error(f'--plan is for {NATIVE}: leave out --controller')
    try:
        arguments.model = load_robot_model(arguments.robot)
        profile = load_controller_profile(arguments.controller)
    except (OSError, InputError) as error:
        parser.error(str(error))
    arguments.spel = bool(profile.spel.project)
    if arguments.spel and arguments.motion is not None:
        parser.error('--motion: a SPEL+ program moves as its statements say')
    if arguments.plan and arguments.trajectory is not None:
        parser.error('--plan makes a trajectory of its own: leave out --trajectory')
    if arguments.trajectory is None:
        scara = arguments.model.kind == SCARA
        if not (arguments.plan or scara or arguments.model.name == ROBOT):
            parser.error(
                f'--robot: the trajectory of the demo is for the {ROBOT}; add --plan, which plans '
                f'one for the {arguments.model.name}, or name a file with --trajectory'
            )
        arguments.trajectory = TRAJECTORY_OF_SCARAS if scara else TRAJECTORY
    if arguments.model.kind not in (SIX_AXIS, SCARA):
        parser.error(f'--robot: {arguments.model.name} is neither a six-axis arm nor a SCARA')
    if not arguments.plan and (arguments.seed is not None or arguments.seeds is not None):
        parser.error('--seed and --seeds say what --plan plans: add --plan, or leave them out')
    if arguments.compare and (arguments.stay or arguments.panel):
        parser.error('--compare has two runs: leave out --stay and --panel')
    return arguments


def _fitting(file: Path, model: RobotModel) -> Trajectory:
    """Return the trajectory in a file, its joints in the robot's order.

    Raises InputError if it has other joints, and as `read_trajectory` does.
    """
    trajectory = read_trajectory(file)
    if sorted(trajectory.joint_names) != sorted(model.joint_names):
        raise InputError(
            f'{file}: its joints are {", ".join(trajectory.joint_names)}; the {model.name} has '
            f'{", ".join(model.joint_names)}: name its model with --robot'
        )
    return trajectory.in_order(model.joint_names)


def _motions(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return what is run, one after the other; the last is of the controller asked for."""
    if arguments.spel:
        return ('smooth', 'spel') if arguments.compare else ('spel',)
    return ('ptp', 'smooth') if arguments.compare else (arguments.motion or 'smooth',)


def _on_signal(_number: int, _frame: object) -> NoReturn:
    """Leave, and ignore further signals, so that what was started is always ended."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


@dataclass(frozen=True, eq=False)
class Run:
    """One execution: what was measured, and what the driver and the controller said."""

    motion: str
    recording: Recording
    figures: Figures
    text: str
    latencies: dict[str, str]
    round_trips: list[float]
    missed: int
    """Deadlines that the controller missed meanwhile."""
    page: tuple[WireRun, PageFigures]
    """What went over the wire, and its figures: of them the page is made."""

    @property
    def faults(self) -> list[str]:
        """The ways in which the motion was not as planned, a sentence each."""
        faults = []
        if self.figures.waypoint_deviation > MAX_DEVIATION_RAD:
            faults.append(
                f'a waypoint was missed by {self.figures.waypoint_deviation:.4f} rad, '
                f'{MAX_DEVIATION_RAD:g} rad are allowed'
            )
        if self.motion != 'ptp' and self.figures.stops:
            times = 'once' if self.figures.stops == 1 else f'{self.figures.stops} times'
            faults.append(f'the arm stopped {times} on the way')
        return faults


def as_on_page(numbers: Figures, page: PageFigures) -> Figures:
    """Return the figures of a run with the stops that its page tells of, if those are more.

    `measure` goes by shares of the typical speed: behind a slow beginning it takes the whole of
    that for a standstill. The page tells of each standstill, and how long it was.
    """
    stood = len(page.stops) - numbers.commanded_stops
    return replace(numbers, stops=max(numbers.stops, stood, *(m.stops or 0 for m in page.motions)))


class _GoalError(RunError):
    """The goal was not reached; meanwhile the controller missed so many deadlines."""

    def __init__(self, text: str, missed: int, wire: WireRun) -> None:
        super().__init__(text)
        self.missed = missed
        self.wire = wire


@contextmanager
def _executed(
    robot: str,
    motion: str,
    controller: str,
    trajectory: Trajectory,
    folder: Path,
    console: Console,
    staying: bool,
) -> Iterator[tuple[Run, Callable[[], None]]]:
    """Execute the trajectory; controller and driver run on until the block ends.

    `staying`: with the panel. Yields the run, and what goes on until Ctrl-C. Raises RunError if
    the goal is not reached.
    """
    began = time.monotonic()
    model = load_robot_model(robot)
    start = trajectory.positions[0].tolist()
    how = [f'--controller={controller}', f'--robot={robot}']
    if motion != 'spel':
        how.append(f'--motion={motion}')
    with running_controller(folder, start, *how) as ports:
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
            panel_beside(folder, driver, console, wanted=staying) as panel,
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
    arguments: argparse.Namespace,
    model: RobotModel,
    trajectory: Trajectory,
    runs: list[Run],
    console: Console,
) -> int:
    console.print(_table(model, trajectory, runs))
    drawn = [Drawn(TITLES[run.motion], run.recording, run.figures) for run in runs]
    draw(arguments.picture, trajectory, drawn, model.limits)
    console.print(f'picture: {arguments.picture}', highlight=False)
    write_report([run.page for run in runs], model, arguments.report)
    faults = [f'{TITLES[run.motion]}: {fault}' for run in runs for fault in run.faults]
    gap = max(run.figures.longest_gap for run in runs)
    return _judged(console, faults, sum(run.missed for run in runs), gap)


def _unfinished(error: _GoalError, model: RobotModel, report: Path, console: Console) -> int:
    """Report what went over the wire until the goal failed: it shows why."""
    try:
        shown = figures(error.wire, model.limits.rad_per_unit)
        write_report([(error.wire, shown)], model, report)
    except OSError as why:
        console.print(f'no report: {escape(printable(why))}', highlight=False)
    return _judged(console, [str(error)], error.missed, 0.0)


def _judged(console: Console, faults: list[str], missed: int, gap: float) -> int:
    code, sentence = verdict(faults, missed, gap)
    colour = {0: 'green', TOO_BUSY: 'yellow'}.get(code, 'red')
    said = f'[bold {colour}]{escape(printable(sentence))}[/]'
    console.print(said, highlight=False, soft_wrap=True)
    return code


def _ping(ports: Ports) -> list[float]:
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
        stops += f', and {figures.commanded_stops} that the plan asks for'
    return (
        ('result', run.text),
        ('points', f'{len(trajectory.times)}'),
        (
            'duration',
            f'{figures.moved:.2f} s, planned {figures.planned:.2f} s '
            f'({figures.moved / figures.planned:.2f} times)',
        ),
        ('stops on the way', stops),
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
            f'({"after the move" if run.motion == "ptp" else "as its buffer has room"})',
        ),
        (
            'round trip to the controller',
            f'median {median:.2f} ms, longest {round_trips[-1] * 1e3:.2f} ms ({PINGS} pings)',
        ),
    )
