# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`make bench-motion`: the smoother against stop-and-go, splines in time, and two optima.

Writes motion.json, motion.md and pictures to benchmark/results/. Exit code 0, unless --check is
given and a required value is missed, or a reference is unsound.
"""

import argparse
import sys
import time
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from itertools import repeat
from pathlib import Path

from benchmark import tables
from benchmark.cases import Case, Task, factory, run_case
from benchmark.families import FamilyFigures, PlanCosts, run_family
from benchmark.family_members import FAMILIES, MEASURED_SEEDS
from benchmark.limit_sets import FACTORS, limit_set
from benchmark.look_ahead import TRAJECTORIES, Curve, CurveTask, run_curve
from benchmark.references import ReferenceFile, ReferenceTimes, compute, digest
from benchmark.results_file import Results, render, write
from benchmark.strategies import STRATEGIES
from benchmark.targets import outcomes
from benchmark.trajectories import BenchmarkTrajectory, benchmark_set

RESULTS = Path(__file__).with_name('results')
DRIVER = 'benchmark.driver:DriverSmoother'
MAX_QUICK_POINTS = 60
QUICK_STRATEGIES = (
    'time-optimal, all known',
    'time-preserving, all known',
    'time-preserving, 3·A/J known',
)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return the exit code."""
    args = _arguments(arguments)
    if args.render:
        render(args.output)
        return 0
    began = time.monotonic()
    trajectories = _chosen(args)
    with ProcessPoolExecutor(args.jobs) as pool:
        references = _references(pool, trajectories, args)
        smoother = _available(args.smoother)
        cases = _cases(pool, trajectories, references, args, smoother)
        curves = _curves(pool, trajectories, args, smoother)
        runs = _families(pool, args)
    families = _timed_alone(runs)
    results = outcomes(cases)
    write(args.output, Results(cases, curves, results, families))
    print(tables.summary(cases), tables.targets(results), sep='\n\n')
    missed = [result.metric for result in results if not result.met and result.worst is not None]
    missed += [f'{one.name}: {text}' for one in families for text in one.missed]
    unknown = [result.metric for result in results if result.worst is None]
    unsound = [f'{c.name}, {c.limits}' for c in cases if not c.references.sound()]
    failed = sum(len(case.errors) for case in cases)
    print()
    texts = ('MISSED', 'NOT MEASURED', 'UNSOUND REFERENCE')
    for text, found in zip(texts, (missed, unknown, unsound), strict=True):
        for one in found:
            print(f'{text}: {one}')
    if failed:
        print(f'ERRORS: {failed} runs raised; they are listed in motion.md')
    if not (missed or unknown or unsound or failed):
        print('all that is required is met')
    print(f'{args.output}, after {time.monotonic() - began:.0f} s')
    return 1 if args.check and (missed or unknown or unsound or failed) else 0


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='benchmark.motion', description=__doc__)
    parser.add_argument(
        '--only',
        action='append',
        metavar='NAME',
        default=[],
        help='only trajectories whose name contains NAME (repeatable)',
    )
    parser.add_argument('--limits', choices=FACTORS, help='only one set of limits')
    parser.add_argument(
        '--strategy',
        action='append',
        metavar='NAME',
        default=[],
        choices=STRATEGIES,
        help='only this strategy (repeatable)',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help='short trajectories and three strategies, at full limits',
    )
    parser.add_argument(
        '--family',
        action='append',
        metavar='NAME',
        default=[],
        choices=FAMILIES,
        help='this family of hard trajectories as well (repeatable); a whole run has them all',
    )
    parser.add_argument(
        '--seeds',
        nargs=2,
        type=int,
        metavar=('FIRST', 'END'),
        default=(MEASURED_SEEDS.start, MEASURED_SEEDS.stop),
        help='of the families (default: %(default)s; 0 8 are those to work with)',
    )
    parser.add_argument(
        '--reference', action='store_true', help='compute the reference times anew'
    )
    parser.add_argument(
        '--render',
        action='store_true',
        help='run nothing: make report and pictures again from the stored figures',
    )
    parser.add_argument(
        '--check', action='store_true', help='exit 1 if a required value is missed'
    )
    parser.add_argument('--jobs', type=int, default=2, help='processes (default: %(default)s)')
    parser.add_argument(
        '--output',
        type=Path,
        default=None,
        help='folder for the results (default: benchmark/results for a whole run, '
        'build/bench-motion for a part)',
    )
    parser.add_argument(
        '--smoother',
        default=DRIVER,
        metavar='MODULE:NAME',
        help='one like %(default)s, or none',
    )
    args = parser.parse_args(arguments)
    part = args.only or args.limits or args.strategy or args.quick or args.smoother != DRIVER
    if args.output is None:
        args.output = Path('build', 'bench-motion') if part else RESULTS
    args.sets = [args.limits] if args.limits else ['full'] if args.quick else list(FACTORS)
    args.strategies = tuple(args.strategy or (QUICK_STRATEGIES if args.quick else STRATEGIES))
    return args


def _chosen(args: argparse.Namespace) -> list[BenchmarkTrajectory]:
    chosen = [
        trajectory
        for trajectory in benchmark_set()
        if not args.only or any(name in trajectory.name for name in args.only)
        if not args.quick or len(trajectory.positions) <= MAX_QUICK_POINTS
    ]
    if not chosen:
        sys.exit('no trajectory has such a name')
    return chosen


def _available(smoother: str) -> str:
    """Return the smoother's name, or nothing if there is none to run."""
    if smoother == 'none':
        return ''
    try:
        make = factory(smoother)
        make(limit_set('full'), benchmark_set()[0].positions[0], False, 0.0)
    except ImportError as error:
        print(f'no smoother to run ({error}): references and splines only', flush=True)
        return ''
    return smoother


def _references(
    pool: ProcessPoolExecutor, trajectories: list[BenchmarkTrajectory], args: argparse.Namespace
) -> dict[tuple[str, str], ReferenceTimes]:
    stored = ReferenceFile(forget=args.reference)
    wanted = [(trajectory, name) for name in args.sets for trajectory in trajectories]
    keys = {
        (trajectory.name, name): digest(trajectory.positions, limit_set(name))
        for trajectory, name in wanted
    }
    waiting: dict[str, Future[ReferenceTimes]] = {}
    for trajectory, name in wanted:
        key = keys[trajectory.name, name]
        if key not in stored and key not in waiting:
            waiting[key] = pool.submit(compute, trajectory.positions, limit_set(name))
    for trajectory, name in wanted:
        key = keys[trajectory.name, name]
        if key in waiting:
            stored.put(key, trajectory.name, name, waiting.pop(key).result())
            print(f'reference of {trajectory.name}, {name}', flush=True)
    return {pair: stored[key] for pair, key in keys.items()}


def _cases(
    pool: ProcessPoolExecutor,
    trajectories: list[BenchmarkTrajectory],
    references: dict[tuple[str, str], ReferenceTimes],
    args: argparse.Namespace,
    smoother: str,
) -> list[Case]:
    tasks = [
        Task(trajectory, name, references[trajectory.name, name], args.strategies, smoother)
        for name in args.sets
        for trajectory in trajectories
    ]
    # the longest first, so that no process is left alone with it at the end
    order = sorted(range(len(tasks)), key=lambda i: -(tasks[i].trajectory.commanded or 0.0))
    jobs = {pool.submit(run_case, tasks[i]): i for i in order}
    cases: dict[int, Case] = {}
    for count, job in enumerate(as_completed(jobs), 1):
        case = cases[jobs[job]] = job.result()
        print(f'{count}/{len(jobs)} {_progress(case)}', flush=True)
    return [cases[i] for i in range(len(tasks))]


def _progress(case: Case) -> str:
    ratios = [
        f'{name.split(" ")[0]} {metrics.duration / case.references.opt:.2f} · optimum'
        for name, metrics in case.strategies.items()
        if name.endswith('all known')
    ]
    errors = [f'{len(case.errors)} errors'] if case.errors else []
    return f'{case.name}, {case.limits}: ' + ' '.join([*ratios, *errors, f'({case.took:.0f} s)'])


def _curves(
    pool: ProcessPoolExecutor,
    trajectories: list[BenchmarkTrajectory],
    args: argparse.Namespace,
    smoother: str,
) -> list[Curve]:
    if not smoother or args.strategy or args.quick:
        return []
    jobs = [
        pool.submit(run_curve, CurveTask(trajectory, name, timed, smoother))
        for name in args.sets
        for trajectory in trajectories
        if trajectory.name in TRAJECTORIES
        for timed in (False, True)
    ]
    curves = []
    for job in jobs:
        try:
            curves.append(job.result())
        except Exception as error:  # noqa: BLE001  whatever the class under test raises
            print(f'no look-ahead curve: {type(error).__name__}: {error}', flush=True)
    return curves


def _families(
    pool: ProcessPoolExecutor, args: argparse.Namespace
) -> list[tuple[FamilyFigures, PlanCosts]]:
    """Run the families of the whole benchmark, or of --family alone."""
    part = args.only or args.limits or args.strategy or args.quick or args.smoother != DRIVER
    names = args.family or ([] if part else list(FAMILIES))
    found = []
    for figures, costs in pool.map(run_family, names, repeat(range(*args.seeds))):
        print(f'{figures.name}: {figures.plans} plans', flush=True)
        found.append((figures, costs))
    return found


def _timed_alone(runs: list[tuple[FamilyFigures, PlanCosts]]) -> list[FamilyFigures]:
    """Time the slowest plans again, now that nothing runs beside; return the figures."""
    for figures, costs in runs:
        costs.time_again()
        costs.put_into(figures)
        print(f'{figures.name}: {", ".join(figures.missed) or "all met"}', flush=True)
    return [figures for figures, _ in runs]


if __name__ == '__main__':
    sys.exit(main())
