# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The short form of `make fuzz`, and all cases that it has found."""

from pathlib import Path

import pytest

from benchmark.fuzz import controller_target, runner, socket_targets
from benchmark.fuzz.cases import Case, FoundError
from benchmark.fuzz.runner import Fuzzer
from benchmark.fuzz.targets import Target, in_process

pytestmark = pytest.mark.invariant(1, 2, 5, 7)

SEED = 20
FOUND = sorted(Path(__file__).with_name('cases').glob('*.json'))
TARGETS = {target.name: target for target in in_process()}
SLOW = ('spel', 'smooth')
"""Parts of the names of targets that need seconds to start."""


def all_held(target: Target, seed: int, inputs: int) -> None:
    fuzzer = Fuzzer(target, seed, None)
    fuzzer.run(lambda figures: figures.inputs >= inputs)
    assert not fuzzer.figures.found, fuzzer.figures.found[0]


@pytest.mark.parametrize('path', FOUND, ids=lambda path: path.stem)
def test_found_case_no_longer_fails(path: Path) -> None:
    case = Case.read(path)
    with runner.listening(runner.Novelty()):
        assert runner.why_it_fails(TARGETS[case.target], case) == ''


@pytest.mark.parametrize(
    'name', [name for name in TARGETS if not any(word in name for word in SLOW)]
)
def test_one_case_of_each_target_passes(name: str) -> None:
    all_held(TARGETS[name], SEED, 1)


@pytest.mark.slow
@pytest.mark.parametrize('name', TARGETS)
def test_thousands_of_inputs_break_no_target(name: str) -> None:
    all_held(TARGETS[name], SEED + 1, 3_000)


@pytest.mark.slow
@pytest.mark.parametrize('name', socket_targets.TARGETS)
def test_processes_withstand_random_input(name: str) -> None:
    figures = socket_targets.TARGETS[name](2_000, SEED)
    assert not figures.found, figures.found[0]


# --- the fuzzer itself ------------------------------------------------------------------------


def test_fuzzer_finds_a_case_that_never_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, 'HANG_S', 0.05)

    class Hanging:
        name = 'hanging'

        def run(self, _case):
            while True:
                pass

    assert 'HangError' in runner.why_it_fails(Hanging(), Case('hanging', ()))


def test_fuzzer_finds_an_arm_that_moves_without_power(monkeypatch: pytest.MonkeyPatch) -> None:
    target = TARGETS['controller simulated, motors off: motion, state, io']
    world = controller_target._World(target)
    world.controller.servo.actual[0] += 1e-9
    with pytest.raises(FoundError, match='without power has moved'):
        world.take(('send', 'state', b''))
