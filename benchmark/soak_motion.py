# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An hour of varied motion, after which the driver's resources must be unchanged.

`make soak-motion` (`python -m benchmark.soak_motion --minutes 60`): the real client, a simulated
controller, and a user who sends goals, cancels and replaces them, streams setpoints, calls
services, changes parameters, presses the E-stop and cuts the cable, at random moments. Every goal
must end once, with the true outcome. Between the episodes, the memory of both processes, and the
descriptors, threads and asyncio tasks of the client must be as after the warm-up. Prints the
figures of docs/reliability.md. Exit code 1 if a check fails. Linux only.
"""

import argparse
import os
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from benchmark.soak_user import FAR, SoakUser
from epson_driver.processes import processes
from epson_driver.processes.processes import Process

WARM_UP_S = 75.0
"""The driver stores goals for 60 s."""

FIRST_ROUNDS = 2
"""Number of times that each episode is played first. Its code is loaded at its first use."""

MAX_GROWTH_BYTES = 1_000_000
"""Maximum growth of either process, from the first tenth after the warm-up to the last one,
bytes."""

SAMPLE_S = 2.0
"""Minimum time between two measurements, s, which are made between episodes."""

PATIENCE_S = 30.0
"""Timeouts between driver and controller, s: an overloaded machine is not a finding."""

PATIENT = """\
name: patient
description: A controller that waits for its driver
like: {controller}
server: {{client_timeout: {patience}}}
"""

MIN_SAMPLES = 8
PAGE_BYTES = os.sysconf('SC_PAGE_SIZE')


@dataclass(frozen=True)
class Sample:
    """Resources of the processes at a moment without motion. Memory in bytes."""

    seconds: float
    goals: int
    memory: int
    controller_memory: int
    descriptors: int
    threads: int
    tasks: int


class Episodes:
    """The user's actions. Each method is an episode.

    An episode returns its goals with the allowed outcomes. Violations are added to `problems`.
    """

    def __init__(self, user: SoakUser, chance: random.Random) -> None:
        self._user = user
        self._chance = chance
        self.problems: list[str] = []
        self.outcomes: dict[str, Counter[str]] = defaultdict(Counter)
        self.goals = 0

    def play(self, number: int | None = None) -> None:
        """Play an episode, by default a random one, and check that the arm is at rest after it."""
        name, episode = EPISODES[number] if number is not None else self._chance.choice(EPISODES)
        expected = episode(self)
        for goal, allowed in expected:
            ended, text = self._user.result(goal)
            self.goals += 1
            self.outcomes[name][ended] += 1
            if ended not in allowed:
                self._problem(name, f'ended {ended}, not {" or ".join(allowed)}: {text}')
            if not text:
                self._problem(name, f'ended {ended} without a sentence')
            last = goal is expected[-1][0]  # the next goal starts before a replaced one is checked
            if last and ended == 'succeeded' and (far := self._user.distance(goal)) > FAR:
                self._problem(name, f'succeeded {far:.3f} rad from its goal')
        if not expected:
            self.outcomes[name]['no goal'] += 1
        self._user.at_rest()
        self._user.enabled()

    def _problem(self, name: str, text: str) -> None:
        self.problems.append(f'{name}: {text}')
        print(f'PROBLEM {name}: {text}', flush=True)

    def _pause(self) -> None:
        time.sleep(self._chance.uniform(0.0, 1.2))

    def _goal(self) -> Any:
        return self._user.goal(self._chance.uniform(0.2, 1.0), self._chance.uniform(-0.4, 0.4))

    def finished(self) -> list[Any]:
        """Wait for a goal to complete."""
        return [(self._goal(), ('succeeded',))]

    def canceled(self) -> list[Any]:
        """Cancel a goal."""
        goal = self._goal()
        self._pause()
        self._user.cancel(goal)
        return [(goal, ('canceled', 'succeeded'))]

    def replaced(self) -> list[Any]:
        """Replace a goal by another one."""
        first = self._goal()
        self._pause()
        return [(first, ('aborted', 'succeeded')), (self._goal(), ('succeeded',))]

    def streamed(self) -> list[Any]:
        """Stream setpoints."""
        self._user.stream(self._chance.uniform(0.3, 1.5), self._chance.uniform(-0.3, 0.3))
        return []

    def stopped(self) -> list[Any]:
        """Call ~/stop."""
        goal = self._goal()
        self._pause()
        self._user.call('stop')
        return [(goal, ('aborted', 'succeeded'))]

    def disabled(self) -> list[Any]:
        """Call ~/disable."""
        goal = self._goal()
        self._pause()
        self._user.call('disable')
        return [(goal, ('aborted', 'succeeded'))]

    def estop(self) -> list[Any]:
        """Press the E-stop, and release it when the arm is at rest."""
        goal = self._goal()
        self._pause()
        self._user.pendant('Sim,estop,press')
        self._user.result(goal)
        self._user.at_rest()
        self._user.pendant('Sim,estop,release')
        return [(goal, ('aborted', 'succeeded'))]

    def cut(self) -> list[Any]:
        """Cut the cable for a moment."""
        goal = self._goal()
        self._pause()
        ports = self._chance.choice(('motion', 'state', 'motion+state', 'motion+state+io'))
        seconds = self._chance.uniform(0.05, 0.5)
        self._user.pendant(f'Sim,fault,cut,for={seconds:.2f},port={ports}')
        return [(goal, ('aborted', 'succeeded'))]

    def parameters(self) -> list[Any]:
        """Change parameters while a goal runs."""
        goal = self._goal()
        self._user.set_parameter('servo.scale', self._chance.uniform(0.1, 0.5))
        self._user.set_parameter('constraints.joint_1.goal', self._chance.uniform(0.01, 0.02))
        return [(goal, ('succeeded',))]

    def slowed(self) -> list[Any]:
        """Slow a goal down that stays faster than 1 %, the minimum of a SPEL+ program."""
        far = -0.3 if self._user.joints()[0] > 0.0 else 0.3
        goal = self._user.goal(self._chance.uniform(0.2, 1.0), far)
        self._user.speed(self._chance.uniform(0.3, 0.9))
        self._user.result(goal)
        self._user.speed(1.0)
        return [(goal, ('succeeded',))]

    def inputs(self) -> list[Any]:
        """Read I/O."""
        for _ in range(10):
            self._user.read()
        return []


EPISODES: tuple[tuple[str, Callable[[Episodes], list[Any]]], ...] = (
    ('runs to its end', Episodes.finished),
    ('is canceled', Episodes.canceled),
    ('is replaced', Episodes.replaced),
    ('stream of setpoints', Episodes.streamed),
    ('~/stop', Episodes.stopped),
    ('~/disable', Episodes.disabled),
    ('E-stop', Episodes.estop),
    ('cable cut', Episodes.cut),
    ('parameters change', Episodes.parameters),
    ('speed scaling', Episodes.slowed),
    ('I/O is read', Episodes.inputs),
)
"""Episodes with and without a goal."""


def resident(process: Process) -> int:
    """Return the resident memory of a process, bytes."""
    text = Path(f'/proc/{process.process_id}/statm').read_text(encoding='ascii')
    return int(text.split()[1]) * PAGE_BYTES


def measured(
    seconds: float, goals: int, client: Process, controller: Process, tasks: Path
) -> Sample:
    """Return the current resources of the processes."""
    folder = Path(f'/proc/{client.process_id}')
    status = (folder / 'status').read_text(encoding='ascii')
    threads = next(line for line in status.splitlines() if line.startswith('Threads:'))
    return Sample(
        seconds,
        goals,
        resident(client),
        resident(controller),
        len(list((folder / 'fd').iterdir())),
        int(threads.split()[1]),
        int(tasks.read_text(encoding='ascii').split()[-1]),
    )


def flat(samples: list[Sample], warm_up: float) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return the figures after the warm-up, and the resources that have grown.

    Memory is compared by the median of the first and of the last tenth. A leak of descriptors,
    threads or tasks raises both their minimum and their maximum from the first half to the second
    half. A command that is just being executed, or a link that is just down, changes only one.
    """
    warm = [sample for sample in samples if sample.seconds >= warm_up]
    if len(warm) < MIN_SAMPLES:
        raise ValueError(f'only {len(warm)} samples after the warm-up of {warm_up:g} s')
    tenth, half = max(len(warm) // 10, 3), len(warm) // 2
    figures, problems = {}, []
    for name, scale, most in (
        ('memory', 1e-6, MAX_GROWTH_BYTES * 1e-6),
        ('controller_memory', 1e-6, MAX_GROWTH_BYTES * 1e-6),
        ('descriptors', 1, 0),
        ('threads', 1, 0),
        ('tasks', 1, 0),
    ):
        values = [getattr(item, name) * scale for item in warm]
        first, last = median(values[:tenth]), median(values[-tenth:])
        growth = last - first
        if not most:
            before, after = values[:half], values[half:]
            growth = min(min(after) - min(before), max(after) - max(before))
        figures[name] = {
            'warm': round(first, 3),
            'last': round(last, 3),
            'most': round(max(values), 3),
        }
        if growth > most:
            problems.append(f'{name}: {first:.2f} after the warm-up, {last:.2f} at the end')
    return figures, problems


def soak(
    minutes: float,
    seed: int,
    folder: Path,
    warm_up: float = WARM_UP_S,
    controller_profile: str = 'simulated',
) -> dict[str, Any]:
    """Play episodes for `minutes` and return the figures."""
    domain, tasks = processes.free_ros_domain(), folder / 'tasks'
    patient = folder / 'patient.yaml'
    profile = PATIENT.format(controller=controller_profile, patience=PATIENCE_S)
    patient.write_text(profile, 'utf-8')
    built_in = controller_profile == 'simulated'  # a SPEL+ program sets both itself
    # a third of a C3's state rate, because this is about duration, not load
    options = ['--motion=ptp', '--state-period=0.015'] if built_in else []
    controller = processes.sim_controller(
        folder / 'controller.log',
        f'--controller={patient}',
        *options,
    )
    with processes.ended_at_exit(controller):
        ports = controller.ports()
        client = processes.client(
            folder / 'client.log',
            ports,
            domain,
            run=(sys.executable, '-m', 'benchmark.watched_client', str(tasks)),
            controller=str(patient),
            state_timeout=PATIENCE_S,
            io_timeout=PATIENCE_S,
            reply_timeout=PATIENCE_S,
            start_tolerance=1.0,  # a replacing goal starts at the last received position
            require_planned_speed=False,  # the speed of a SPEL+ program is at least 1 %
        )
        with processes.ended_at_exit(client):
            user = SoakUser(domain, ports.remote)
            try:
                user.enabled()
                episodes, samples = _run(minutes, seed, user, (client, controller, tasks), warm_up)
                problems = episodes.problems + user.problems()
            finally:
                user.close()
            if code := client.end():
                problems.append(f'the client ended with {code}')
            if 'Traceback' in client.log_text():
                problems.append(f'a traceback in the log:\n{client.log_text()[-3000:]}')
    figures, leaks = flat(samples, warm_up)
    return {
        'minutes': minutes,
        'seed': seed,
        'goals': episodes.goals,
        'episodes': {name: dict(counts) for name, counts in sorted(episodes.outcomes.items())},
        'flat': figures,
        'problems': problems + leaks,
    }


def _run(
    minutes: float, seed: int, user: SoakUser, parts: tuple[Process, Process, Path], warm_up: float
) -> tuple[Episodes, list[Sample]]:
    client, controller, tasks = parts
    episodes = Episodes(user, random.Random(seed))
    for _ in range(FIRST_ROUNDS):
        for number in range(len(EPISODES)):
            episodes.play(number)
    samples: list[Sample] = []
    began, next_line = time.monotonic(), 0.0
    while (seconds := time.monotonic() - began) < 60.0 * minutes:
        if not samples or seconds - samples[-1].seconds >= SAMPLE_S:
            samples.append(measured(seconds, episodes.goals, client, controller, tasks))
        if seconds >= next_line:
            now = samples[-1]
            print(
                f'{seconds / 60.0:6.1f} min {episodes.goals:6} goals {now.memory / 1e6:8.2f} MB '
                f'(controller {now.controller_memory / 1e6:.2f}) {now.descriptors} descriptors '
                f'{now.threads} threads {now.tasks} tasks',
                flush=True,
            )
            next_line += max(60.0 * minutes / 20.0, warm_up / 5.0)
        episodes.play()
        client.check_alive()
    return episodes, samples


def main() -> int:
    """Run it and write the figures. Returns 1 if a check fails."""
    parser = argparse.ArgumentParser(prog='benchmark.soak_motion', description=__doc__)
    parser.add_argument('--minutes', type=float, default=60.0)
    parser.add_argument('--seed', type=int, default=20)
    parser.add_argument('--controller', default='simulated', metavar='PROFILE')
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        figures = soak(
            arguments.minutes, arguments.seed, Path(folder), WARM_UP_S, arguments.controller
        )
    for name, values in figures['flat'].items():
        warm, last, most = (values[when] for when in ('warm', 'last', 'most'))
        print(f'{name}: {warm} after the warm-up, {last} at the end, {most} at most')
    print(f'{figures["minutes"]:g} minutes, {figures["goals"]} goals, seed {figures["seed"]}')
    for name, outcomes in figures['episodes'].items():
        print(f'{name}: {", ".join(f"{count} {word}" for word, count in outcomes.items())}')
    for problem in figures['problems']:
        print(f'PROBLEM {problem}')
    return int(bool(figures['problems']))


if __name__ == '__main__':
    sys.exit(main())
