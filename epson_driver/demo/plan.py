# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver demo --plan`: a pick and place that is planned on the spot, and executed.

The planner knows the obstacles and the arm's shape; driver and controller know neither. Afterwards
the recorded joint states are checked against the obstacles: only that decides.
"""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from epson_driver.demo.cell import panel_beside, running_controller, running_driver, stay
from epson_driver.demo.picture import TRACE, recorded_run
from epson_driver.demo.plan_picture import Executed, draw
from epson_driver.demo.ros_client import RosClient
from epson_driver.demo.verdict import TOO_BUSY, deadlines_missed, verdict
from epson_driver.planning.plan import Plan, PlanningError, plan_task
from epson_driver.planning.task import draw_task
from epson_driver.planning.verdict import judge
from epson_driver.planning.workspace import workspace
from epson_driver.report.figures import figures
from epson_driver.report.measure import Recording, measure
from epson_driver.report.page import write_report
from epson_driver.robots import RobotModel, load_robot_model

VACUUM_OUTPUT = 8
"""The digital output that would switch the gripper's valve."""


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
"""Seed, number of obstacles, time to plan, planned and actual duration, stops on the way, smallest
distance to an obstacle, largest distance by which the part, its place or home was missed.
"""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result for one seed: `executed`, or the sentence that says why not.

    `stranded`: the arm is not at home, so that the next task cannot start.
    """

    seed: int
    took: float
    executed: Executed | None
    failure: str = ''
    stranded: bool = False

    @property
    def faults(self) -> list[str]:
        """The faults of the execution, a sentence for each."""
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


def run(
    robot: str,
    seeds: range,
    picture: Path,
    report: Path,
    console: Console,
    *,
    staying: bool,
) -> int:
    """Plan and execute the task of each seed.

    Returns 0 only if nothing was wrong with any, TOO_BUSY if nobody can tell. `staying`: with the
    panel, and until Ctrl-C.
    """
    model = load_robot_model(robot)
    home = workspace(model).home.tolist()
    outcomes = []
    with (
        tempfile.TemporaryDirectory(prefix='epson_driver_demo_') as name,
        running_controller(folder := Path(name), home, f'--robot={robot}') as ports,
        running_driver(
            folder,
            ports,
            model.joint_names,
            console,
            robot_model=robot,
            trace_folder=str(folder),
            trace_file=TRACE,
        ) as driver,
        panel_beside(folder, driver, console, wanted=staying) as panel,
    ):
        with Progress(
            TextColumn('{task.description}'), BarColumn(), TimeElapsedColumn(), console=console
        ) as progress:
            bar = progress.add_task('', total=4 * len(seeds))
            missed = deadlines_missed(ports.remote)
            for seed in seeds:
                outcome = _attempt(seed, model, driver.user, progress, bar)
                outcomes.append(outcome)
                if len(seeds) > 1:
                    said = '; '.join(outcome.faults) or 'executed'
                    progress.console.print(f'seed {seed}: {said}', highlight=False)
                if outcome.stranded:
                    break  # every plan begins at home
            progress.update(bar, description='done')
            missed = deadlines_missed(ports.remote) - missed
        wire = recorded_run(folder / TRACE, model, 'pick and place')
        code = _report(outcomes, seeds, model, picture, console, missed)
        write_report([(wire, figures(wire, model.limits.rad_per_unit))], model, report)
        if staying:
            stay(driver, panel, console)
    return code


def _attempt(
    seed: int, model: RobotModel, user: RosClient, progress: Progress, bar: TaskID
) -> Outcome:
    began = time.monotonic()

    def tell(doing: str) -> None:
        progress.update(bar, description=f'seed {seed}: {doing}')

    tell('planning')
    try:
        plan = plan_task(draw_task(seed, model), model, lambda doing: tell(f'planning {doing}'))
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
        user.write_output(VACUUM_OUTPUT, vacuum)
        progress.advance(bar)
    return Outcome(seed, took, _judged(plan, recordings))


def _judged(plan: Plan, recordings: Sequence[Recording]) -> Executed:
    pairs = list(zip(plan.motions, recordings, strict=True))
    metric = plan.scene.workspace.metric
    return Executed(
        plan,
        tuple(recordings),
        tuple(
            judge(plan, motion, recording.times, recording.positions)
            for motion, recording in pairs
        ),
        tuple(measure(motion.sent, recording, metric) for motion, recording in pairs),
    )


def _report(
    outcomes: list[Outcome],
    seeds: range,
    model: RobotModel,
    picture: Path,
    console: Console,
    missed: int,
) -> int:
    console.print(_table(outcomes))
    executed = [outcome.executed for outcome in outcomes if outcome.executed is not None]
    if executed:
        draw(picture, executed[-1], model)
        console.print(f'picture: {picture}', highlight=False)
    faults = [f'seed {each.seed}: {fault}' for each in outcomes for fault in each.faults]
    if faults or len(outcomes) < len(seeds):
        gap = max((f.longest_gap for each in executed for f in each.figures), default=0.0)
        planned = all(each.executed is not None or each.stranded for each in outcomes)
        collided = any(v.collides for each in executed for v in each.verdicts)
        code, sentence = verdict(faults, missed, gap)
        if planned and not collided and code == TOO_BUSY:
            console.print(f'[bold yellow]{escape(sentence)}[/]', highlight=False)
            return TOO_BUSY
        console.print(f'[bold red]something went wrong:[/] {"; ".join(faults)}', highlight=False)
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
