# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`make bench-motion`: the smoother against stop-and-go, splines in time, and two optima.

Writes motion.json, motion.md and pictures to build/benchmark. Exit code 0, unless --check is
given and a required value is missed, or a reference is unsound.
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import repeat
from pathlib import Path

from benchmark import RESULTS, tables
from benchmark.cases import Case, Task, run_case
from benchmark.families import FamilyFigures, PlanCosts, run_family
from benchmark.family_members import FAMILIES, MEASURED_SEEDS
from benchmark.limit_sets import FACTORS, limit_set
from benchmark.references import References, ReferenceTimes, digest
from benchmark.results_file import Results, render, write
from benchmark.strategies import STRATEGIES
from benchmark.targets import outcomes
from benchmark.trajectories import BenchmarkTrajectory, benchmark_set

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
        references = _references(trajectories, args)
        cases = _cases(pool, trajectories, references, args)
        runs = _families(pool, args)
    families = _timed_alone(runs)
    results = outcomes(cases)
    write(args.output, Results(cases, results, families))
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
        help='folder for the results (default: build/benchmark for a whole run, '
        'build/bench-motion for a part)',
    )
    args = parser.parse_args(arguments)
    part = args.only or args.limits or args.strategy or args.quick
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


def _references(
    trajectories: list[BenchmarkTrajectory], args: argparse.Namespace
) -> dict[tuple[str, str], ReferenceTimes]:
    stored = References()
    return {
        (trajectory.name, name): stored[digest(trajectory.positions, limit_set(name))]
        for name in args.sets
        for trajectory in trajectories
    }


def _cases(
    pool: ProcessPoolExecutor,
    trajectories: list[BenchmarkTrajectory],
    references: dict[tuple[str, str], ReferenceTimes],
    args: argparse.Namespace,
) -> list[Case]:
    tasks = [
        Task(trajectory, name, references[trajectory.name, name], args.strategies)
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


def _families(
    pool: ProcessPoolExecutor, args: argparse.Namespace
) -> list[tuple[FamilyFigures, PlanCosts]]:
    """Run the families of the whole benchmark, or of --family alone."""
    part = args.only or args.limits or args.strategy or args.quick
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
