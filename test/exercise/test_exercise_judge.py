# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on programs, the JUnit report, and the case of every fault."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from epson_driver.exercise.cell import MOVED, standstill
from epson_driver.exercise.judge import GOOD, Observed, Result, Verdict, judge, junit
from epson_driver.exercise.runner import CASES, for_kind
from epson_driver.remote_ethernet.hand import action
from epson_driver.sim_controller.faults.fault_kinds import FAULTS

USUAL = Observed('no fault', 0, 5.0, 'there', 1, np.array([1.0, 0.0]))


@pytest.mark.parametrize(
    ('changes', 'verdict', 'why'),
    [
        ({}, Verdict.FINISHED, 'there'),
        (
            {'code': 1, 'last_line': 'the E-stop is pressed'},
            Verdict.GAVE_UP,
            'the E-stop is pressed',
        ),
        ({'code': 1, 'last_line': ''}, Verdict.GAVE_UP_SILENTLY, 'exit code 1'),
        ({'code': -11, 'last_line': ''}, Verdict.GAVE_UP_SILENTLY, 'exit code -11'),
        ({'code': None, 'seconds': 60.0}, Verdict.HUNG, 'killed after 60 s'),
        ({'end': np.array([0.5, 0.0])}, Verdict.CLAIMED, '0.500 rad or m away'),
        ({'end': np.array([1.005, 0.0])}, Verdict.FINISHED, 'there'),
        ({'trajectories': 3}, Verdict.REPEATED, '3 trajectories, but 1 without the fault'),
        ({'trajectories': 3, 'code': 1}, Verdict.REPEATED, '3 trajectories'),
        ({'moved': False, 'code': 1}, Verdict.NO_MOTION, 'did not move'),
        ({'refused': 'not in this state'}, Verdict.REFUSED, 'refused the fault: not in this'),
        ({'moved_after_stop': True, 'code': None}, Verdict.MOVED_AFTER_ESTOP, 'moved again'),
        ({'moved_after_stop': True, 'trajectories': 9}, Verdict.MOVED_AFTER_ESTOP, 'moved'),
    ],
)
def test_each_behaviour_of_the_program_has_its_verdict(changes, verdict, why):
    result = judge(replace(USUAL, **changes), USUAL)
    assert result.verdict is verdict
    assert why in result.why
    assert result.good == (verdict in GOOD)


def test_junit_has_a_case_per_fault_and_failures():
    results = [
        Result('cut', Verdict.GAVE_UP, 'link lost', 2.0),
        Result('estop', Verdict.HUNG, 'last said: \x1b[31m<&>', 60.0),
    ]
    suite = ElementTree.fromstring(junit(results, 'prog --flag "a & b"'))
    assert (suite.get('tests'), suite.get('failures')) == ('2', '1')
    cut, estop = suite.findall('testcase')
    assert cut.find('failure') is None
    assert estop.find('failure').get('message') == 'hung'
    assert '<&>' in estop.find('failure').text
    assert float(estop.get('time')) == 60.0


def test_every_fault_of_the_simulated_controller_has_a_case():
    assert CASES.keys() >= FAULTS.keys()
    for case in CASES.values():
        for words in (*case.trigger, *case.person):
            assert action(words).commands


def test_spel_program_is_stopped_before_blocked_actions():
    assert for_kind(('motors off',), spel=True) == ('stop', 'motors off')
    assert for_kind(('estop release', 'reset'), spel=True) == ('estop release', 'stop', 'reset')
    for case in CASES.values():
        assert for_kind(case.trigger, spel=False) == case.trigger


@pytest.mark.invariant(4)
def test_no_case_enables_the_arm():
    words = [words for case in CASES.values() for words in (*case.trigger, *case.person)]
    assert 'motors on' not in words
    assert {name for name, case in CASES.items() if case.stops} == {'estop', 'estop_at_point'}


def test_standstill_is_found_after_braking():
    times = np.arange(200) * 0.01
    positions = np.minimum(times, 0.5)[:, None]
    assert times[standstill(times, positions)] == pytest.approx(0.5, abs=0.02)
    assert standstill(times[:60], positions[:60]) is None
    again = positions + np.where(times > 1.5, 2 * MOVED, 0.0)[:, None]
    assert times[standstill(times, again)] == pytest.approx(0.5, abs=0.02)
