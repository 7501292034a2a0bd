# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver demo --plan`: a pick and place that is planned on the spot, and executed.

The planner knows the obstacles and the arm's shape; driver and controller know neither. What the
joint states showed is put back among the obstacles afterwards: only that decides.
"""

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from epson_driver.cli import processes
from epson_driver.cli.demo_report import Recording, measure
from epson_driver.cli.plan_report import Executed, draw
from epson_driver.cli.ros_user import RosUser
from epson_driver.planning.plan import Plan, PlanningError, plan_task
from epson_driver.planning.task import HOME_RAD, draw_task
from epson_driver.planning.verdict import judge
from epson_driver.robots import RobotModel, load_robot_model

ROBOT = 'c3_a601s'

VACUUM = 8
"""The digital output that the gripper's valve would be on."""


COLUMNS = (
    'seed',
    'around',
    'found\n[s]',
    'plan\n[s]',
    'moved\n[s]',
    'stops',
    'nearest\n[mm]',
    'missed\n[mm]',
)
"""Seed, number of obstacles, time to plan, planned and real duration, stops on the way, smallest
distance to an obstacle, largest distance from where the part is and shall be.
"""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one seed: `executed`, or the sentence that says why not.

    `stranded`: the arm is not at home.
    """

    seed: int
    took: float
    executed: Executed | None
    failure: str = ''
    stranded: bool = False

    @property
    def faults(self) -> list[str]:
        """What was not as it must be."""
        if self.executed is None:
            return [self.failure]
        verdicts = self.executed.verdicts
        faults = [f'{" and ".join(v.pair)} collided' for v in verdicts if v.collides]
        names = ('the part was', 'its place was', 'home was')
        faults += [
            f'{name} missed by {verdict.missed * 1e3:.2f} mm, {np.degrees(verdict.turned):.2f}°'
            for name, verdict in zip(names, verdicts, strict=True)
            if not verdict.reached
        ]
        return faults


def run(seeds: range, picture: Path, console: Console) -> int:
    """Plan and execute the task of each seed. Returns 0 only if all was as it must be."""
    model = load_robot_model(ROBOT)
    outcomes = []
    with (
        tempfile.TemporaryDirectory(prefix='epson_driver_demo_') as folder,
        _cell(Path(folder), model, console) as user,
        Progress(
            TextColumn('{task.description}'), BarColumn(), TimeElapsedColumn(), console=console
        ) as progress,
    ):
        bar = progress.add_task('', total=4 * len(seeds))
        for seed in seeds:
            outcome = _attempt(seed, model, user, progress, bar)
            outcomes.append(outcome)
            if len(seeds) > 1:
                said = '; '.join(outcome.faults) or 'executed'
                progress.console.print(f'seed {seed}: {said}', highlight=False)
            if outcome.stranded:
                break  # what is planned begins at home
        progress.update(bar, description='done')
    return _report(outcomes, seeds, model, picture, console)


@contextlib.contextmanager
def _cell(folder: Path, model: RobotModel, console: Console) -> Iterator[RosUser]:
    """Start a controller with its arm at home and a driver; end both when the block is left."""
    domain = processes.free_ros_domain()
    start = ','.join(f'{position:.9g}' for position in HOME_RAD)
    controller = processes.sim_controller(
        folder / 'sim_controller.log', f'--robot={model.name}', f'--start={start}'
    )
    with processes.ended_at_exit(controller):
        ports = controller.ports()
        client = processes.client(folder / 'client.log', ports, domain, robot_model=model.name)
        with processes.ended_at_exit(client):
            console.print(
                f'sim_controller on 127.0.0.1:{ports.motion} (motion) and :{ports.state} (state), '
                f'client in ROS domain {domain}',
                highlight=False,
            )
            os.environ.update(processes.ros_environment(domain))
            user = RosUser(model.joint_names, client.check_alive)
            try:
                user.enable()
                yield user
            finally:
                user.close()


def _attempt(
    seed: int, model: RobotModel, user: RosUser, progress: Progress, bar: TaskID
) -> Outcome:
    began = time.monotonic()

    def tell(doing: str) -> None:
        progress.update(bar, description=f'seed {seed}: {doing}')

    tell('planning')
    try:
        plan = plan_task(draw_task(seed), model, lambda doing: tell(f'planning {doing}'))
    except PlanningError as error:
        return Outcome(seed, time.monotonic() - began, None, f'no plan: {error}')
    took = time.monotonic() - began
    progress.advance(bar)
    recordings = []
    for motion, vacuum in zip(plan.motions, (1, 0, 0), strict=True):
        tell(f'moving {motion.name}')
        text, succeeded = user.follow(motion.sent, lambda _: None)
        if not succeeded:
            return Outcome(seed, took, None, f'{motion.name}: {text}', stranded=True)
        recordings.append(user.recording())
        user.write_output(VACUUM, vacuum)
        progress.advance(bar)
    return Outcome(seed, took, _judged(plan, recordings))


def _judged(plan: Plan, recordings: Sequence[Recording]) -> Executed:
    pairs = list(zip(plan.motions, recordings, strict=True))
    return Executed(
        plan,
        tuple(recordings),
        tuple(
            judge(plan, motion, recording.times, recording.positions)
            for motion, recording in pairs
        ),
        tuple(measure(motion.sent, recording) for motion, recording in pairs),
    )


def _report(
    outcomes: list[Outcome], seeds: range, model: RobotModel, picture: Path, console: Console
) -> int:
    console.print(_table(outcomes))
    executed = [outcome.executed for outcome in outcomes if outcome.executed is not None]
    if executed:
        draw(picture, executed[-1], model)
        console.print(f'picture: {picture}', highlight=False)
    faults = [f'seed {each.seed}: {fault}' for each in outcomes for fault in each.faults]
    if faults or len(outcomes) < len(seeds):
        console.print(f'[bold red]not as it must be:[/] {"; ".join(faults)}', highlight=False)
        return 1
    nearest = min(each.nearest for each in executed)
    console.print(
        f'[bold green]{len(executed)} of {len(seeds)} executed, none in collision[/]: never '
        f'nearer than {nearest * 1e3:.1f} mm to an obstacle, as the joint states show',
        highlight=False,
    )
    return 0


def _table(outcomes: list[Outcome]) -> Table:
    table = Table(title='What happened', title_justify='left')
    for column in COLUMNS:
        table.add_column(escape(column), justify='right')
    table.add_column('')
    for outcome in outcomes:
        table.add_row(*_row(outcome))
    return table


def _row(outcome: Outcome) -> tuple[str, ...]:
    each = outcome.executed
    seed, took = f'{outcome.seed}', f'{outcome.took:.1f}'
    if each is None:
        return seed, '', took, '', '', '', '', '', outcome.failure
    return (
        seed,
        f'{len(each.plan.task.obstacles)}',
        took,
        f'{each.plan.duration:.2f}',
        f'{each.moved:.2f}',
        f'{sum(verdict.stops for verdict in each.verdicts)}',
        f'{each.nearest * 1e3:.1f}',
        f'{max(verdict.missed for verdict in each.verdicts) * 1e3:.3f}',
        '; '.join(outcome.faults) or 'in order',
    )
