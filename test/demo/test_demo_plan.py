# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`demo --plan`: what is said of plans that are executed, missed, or not found."""

import contextlib
import io
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip('ompl')

from epson_driver.demo import plan as demo
from epson_driver.demo.verdict import TOO_BUSY
from epson_driver.planning.plan import PlanningError
from epson_driver.planning.verdict import Verdict

NAMES = ('to the part', 'to its place', 'home')


def verdict(*, clearance=0.05, collides=False, missed=0.0, stops=0):
    return Verdict(
        np.array([0.3, clearance]), 1.0, ('hand', 'pillar'), collides, stops, missed, 0.0
    )


class Played:
    """A run whose plans, motions and verdicts are given; what it said and did."""

    def __init__(self, monkeypatch, verdicts=(), *, fails=None, gap=0.01, missed=0):
        self.outputs, self.drawn, self.reports, self.stayed = [], [], [], []
        self.fails, self.said = fails, io.StringIO()
        counts = iter([5, 5 + missed])
        later = iter(verdicts)
        user = SimpleNamespace(
            follow=self.follow,
            recording=lambda: SimpleNamespace(times=None, positions=None),
            write_output=lambda index, value: self.outputs.append((index, value)),
        )
        driver = SimpleNamespace(user=user)
        figures = SimpleNamespace(moved=1.5, longest_gap=gap)
        for name, stand_in in {
            'running_controller': self.within(SimpleNamespace(remote=5000)),
            'running_driver': self.within(driver),
            'panel_beside': self.within('panel'),
            'deadlines_missed': lambda _port: next(counts),
            'plan_task': self.plan,
            'judge': lambda *_: next(later, verdict()),
            'measure': lambda *_: figures,
            'figures': lambda *_: None,
            'recorded_run': lambda *_: 'wire',
            'draw': lambda path, executed, _model: self.drawn.append((path, executed)),
            'write_report': lambda _rows, _models, path: self.reports.append(path),
            'stay': lambda *arguments: self.stayed.append(arguments),
        }.items():
            monkeypatch.setattr(demo, name, stand_in)

    @staticmethod
    def within(value):
        return lambda *_, **__: contextlib.nullcontext(value)

    def plan(self, task, _model, tell):
        tell('the way')
        if self.fails == 'to plan':
            raise PlanningError('the part is out of reach')
        motions = tuple(SimpleNamespace(name=name, sent=None) for name in NAMES)
        workspace = SimpleNamespace(metric=None)
        return SimpleNamespace(
            task=task, motions=motions, duration=4.0, scene=SimpleNamespace(workspace=workspace)
        )

    def follow(self, _sent, _on_feedback):
        return ('path tolerance violated', False) if self.fails == 'to move' else ('', True)

    def run(self, tmp_path, seeds, *, staying=False):
        console = Console(file=self.said, width=200)
        return demo.run(
            'c3_a601s', seeds, tmp_path / 'a.png', tmp_path / 'a.html', console, staying=staying
        )


def test_a_plan_that_is_executed_is_right_and_the_gripper_holds_the_part_between(
    monkeypatch, tmp_path
):
    played = Played(monkeypatch)
    assert played.run(tmp_path, range(3, 4), staying=True) == 0
    assert '1 of 1 executed, none in collision' in played.said.getvalue()
    assert 'never nearer than 50.0 mm' in played.said.getvalue()
    assert 'in order' in played.said.getvalue()
    assert played.outputs == [(demo.VACUUM_OUTPUT, value) for value in (1, 0, 0)]
    assert [path for path, _ in played.drawn] == [tmp_path / 'a.png']
    assert played.reports == [tmp_path / 'a.html']
    assert len(played.stayed) == 1


@pytest.mark.parametrize(
    ('verdicts', 'options', 'code', 'said'),
    [
        ([verdict(collides=True)], {}, 1, 'seed 1: hand and pillar collided'),
        ([verdict(), verdict(missed=0.02)], {}, 1, 'its place was missed by 20.00 mm, 0.00°'),
        ([verdict(missed=0.02)], {'missed': 3}, TOO_BUSY, 'too busy to judge'),
        ([verdict(missed=0.02)], {'gap': 0.5}, TOO_BUSY, 'up to 500 ms'),
        ([verdict(collides=True)], {'missed': 3}, 1, 'something went wrong'),
        ([], {'fails': 'to plan'}, 1, 'no plan: the part is out of reach'),
        ([], {'fails': 'to move'}, 1, 'to the part: path tolerance violated'),
    ],
)
def test_what_went_wrong_is_said(monkeypatch, tmp_path, verdicts, options, code, said):
    played = Played(monkeypatch, verdicts, **options)
    assert played.run(tmp_path, range(1, 2)) == code
    assert said in played.said.getvalue()
    assert played.stayed == []


@pytest.mark.parametrize(('fails', 'tried'), [('to plan', 2), ('to move', 1)])
def test_the_next_task_begins_only_at_home(monkeypatch, tmp_path, fails, tried):
    played = Played(monkeypatch, fails=fails)
    assert played.run(tmp_path, range(1, 3)) == 1
    found = [seed for seed in (1, 2) if f'seed {seed}: ' in played.said.getvalue()]
    assert found == [1, 2][:tried]
    assert played.drawn == []
