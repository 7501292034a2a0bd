# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Worlds of fixed seeds hold, equal seeds give equal runs, and failures are found and reduced."""

import asyncio
import contextlib
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.examples import quickly
from support.old_defects import DEFECTS, finds

from epson_driver.driver.stopping.stopper import Stopper
from simulation import processes
from simulation.events import Event, events_of
from simulation.oracles import BrokenError
from simulation.processes import NodeProcess
from simulation.shrink import shrunk
from simulation.world import World

ROOT = Path(__file__).resolve().parents[2]
QUICK, ALL, BLOCK = 1, 4, 6
"""Blocks of worlds in the quick tests and with the slow ones, and worlds per block."""


@pytest.mark.invariant(1, 2, 3, 4, 5, 6, 8, 9)
@pytest.mark.parametrize(
    'block',
    [
        *range(QUICK),
        *(pytest.param(block, marks=pytest.mark.slow) for block in range(QUICK, ALL)),
    ],
)
def test_world_holds_the_invariants(block):
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        world = World(str(seed))
        world.play(events_of(str(seed)))
        assert world.broken is None


@pytest.mark.invariant(1, 2, 3, 4, 5, 6, 8, 9)
@pytest.mark.parametrize('seed', ['28', pytest.param('92', marks=pytest.mark.slow)])
def test_world_with_real_time_motion_holds_the_invariants(seed):
    world = World(seed)
    assert world.profile_name == 'rtmc'
    world.play(events_of(seed))


@pytest.mark.parametrize('trusted', [False, True])
def test_setting_the_system_clock_moves_no_arm(monkeypatch, trusted):
    """A driver that trusts the clock would extend a stream by the time that it is set back."""

    def trusting(received):
        return time.monotonic() - (time.time() - received * 1e-9)

    if trusted:
        monkeypatch.setattr(processes, 'came_at', trusting)
    with pytest.raises(BrokenError, match='3: ') if trusted else contextlib.nullcontext():
        World('683').play(events_of('683'))


@pytest.mark.parametrize('what', ['task', 'timer'])
def test_growing_number_of_tasks_is_detected(monkeypatch, what):
    submit, kept = NodeProcess._submit, []

    async def forever():
        await asyncio.get_running_loop().create_future()

    def leave_work(*given):
        submit(*given)
        loop = asyncio.get_running_loop()
        kept.append(
            asyncio.create_task(forever()) if what == 'task' else loop.call_later(1e6, print)
        )

    monkeypatch.setattr(NodeProcess, '_submit', leave_work)
    still = {'step': 1.0, 'offsets': [[0.0] * 6], 'from_here': True}
    with pytest.raises(BrokenError, match='tasks and timers of driver and controller are left'):
        World('1').play([Event(0.5, 'goal', still)] * 6)


@pytest.mark.slow
def test_same_seed_gives_the_same_run_in_every_process():
    def log(hash_seed, **variables):
        return subprocess.run(
            [sys.executable, '-m', 'simulation', '--seed', '1004', '--log'],
            cwd=ROOT,
            env={'PYTHONHASHSEED': hash_seed, 'PYTHONPATH': str(ROOT), **variables},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.rpartition('\n1 worlds')[0]  # the last line has the processor time

    here = log('1')
    assert len(here.splitlines()) > 20
    assert log('2', OPENBLAS_CORETYPE='Prescott') == here  # another matrix kernel


def broken(seeds):
    """Return the first of these seeds whose world breaks, its events and the failure."""
    for seed in seeds:
        events = [*events_of(seed), Event(0.1, 'stop', {})]
        try:
            World(seed).play(events)
        except BrokenError as failure:
            return seed, events, failure
    raise AssertionError('no world breaks')


@pytest.mark.slow
def test_failure_is_reduced_to_few_events(monkeypatch):
    monkeypatch.setattr(Stopper, 'stop', lambda self: None)
    seed, events, failure = broken(map(str, range(7, 20)))
    fewer = shrunk(seed, events, failure)
    assert len(fewer) < len(events) / 4
    with pytest.raises(BrokenError):
        World(seed).play(fewer)


USUAL_DEFECTS = ('a_held_stream_is_followed_at_once', 'an_arm_outlives_its_client')


@pytest.mark.parametrize('name', quickly(USUAL_DEFECTS, DEFECTS, several=False))
def test_simulation_finds_a_reintroduced_old_defect(name: str) -> None:
    seed, _ = DEFECTS[name]
    assert finds(seed, name), f'search for another seed with {finds.__module__}'
