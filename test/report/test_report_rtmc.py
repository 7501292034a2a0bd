# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The report of a run with Real-time Motion Control, from the trace of a driver."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import pose
from support.event_loop import now, until
from support.rtmc_cell import CYCLE, MODEL, goal, rtmc_cell

from epson_driver.driver.outcome import End
from epson_driver.error_texts import load_error_texts
from epson_driver.report.figures import figures
from epson_driver.report.run import NO, YES
from epson_driver.report.trace_run import read_trace
from epson_driver.sim_controller.condition.states import Event
from epson_driver.trace import Trace
from epson_driver.trace.trace import NANOSECONDS, open_trace

PASSWORD = 'secret'
NAMES = MODEL.limits.names


def begin(harness, folder):
    """Start a trace with the time of the test's loop."""
    (link,) = harness.driver.trace._links
    trace = Trace([link], lambda: round(now() * NANOSECONDS))
    trace.begin(open_trace(str(folder), 'run.pcap'))
    return link, trace


def read(trace, folder):
    trace.end('the test ends', timeout=60.0)
    return read_trace(folder / 'run.pcap', MODEL.limits, load_error_texts())


async def test_plan_of_the_report_equals_the_targets_on_the_wire(monkeypatch, tmp_path):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        _, trace = begin(harness, tmp_path)
        ends = pose(0.6, -0.1)[: len(NAMES)], pose(0.0)[: len(NAMES)]
        for end in ends:
            assert (await goal(harness, pose(0.3, 0.1), end).end()).end is End.SUCCEEDED
            await until(lambda: not cell.port.enabled)
        run = read(trace, tmp_path)
    targets = np.array(cell.targets)[:, : len(NAMES)]
    moving = np.abs(np.diff(targets, axis=0)).max(axis=1) > 0.0
    assert sum(len(plan.positions) - 1 for plan in run.plans) == pytest.approx(
        np.count_nonzero(moving),
        abs=1,  # the second motion holds the arm at its measured position
    )
    for plan, motion, end in zip(run.plans, figures(run).motions, ends, strict=True):
        first = np.flatnonzero(np.all(targets == plan.positions[1], axis=1))[0]
        assert np.array_equal(plan.positions, targets[first - 1 : first - 1 + len(plan.positions)])
        assert np.diff(plan.times) == pytest.approx(CYCLE, rel=0.1)
        assert motion.end_deviation < 1e-4
        assert plan.positions[-1] == pytest.approx(end, abs=1e-4)
        assert motion.moved == pytest.approx(motion.planned, rel=0.1)
        assert motion.stops == 0


async def test_estop_and_refusal_are_events_of_the_report(monkeypatch, tmp_path):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        _, trace = begin(harness, tmp_path)
        submitted = goal(harness, pose(0.9, 0.3))
        await harness.until_moving()
        cell.controller.apply(Event.ESTOP_PRESS)
        assert (await submitted.end()).end is End.ABORTED
        cell.controller.apply(Event.ESTOP_RELEASE)
        await asyncio.sleep(0.5)
        await harness.commands.reset_error()
        await harness.commands.enable()
        run = read(trace, tmp_path)
    flags = [condition.flag('e_stopped') for condition in run.conditions]
    assert flags[0] == NO
    assert YES in flags
    assert run.conditions[-1].flag('motion_possible') == YES
    texts = [event.text for event in run.events]
    assert {'E-stop pressed', 'reset requested', 'motors on requested'} <= set(texts)
    assert [text for text in texts if text.startswith('the controller refused MOVE: the E-stop')]


async def test_trace_contains_a_new_session_but_no_password(monkeypatch, tmp_path):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        link, trace = begin(harness, tmp_path)
        link._password, cell.port._password = PASSWORD, PASSWORD.encode()
        link.reconnect('the test reconnects')
        await until(lambda: not link.connected)
        await harness.ready()
        run = read(trace, tmp_path)
    assert PASSWORD.encode() not in (tmp_path / 'run.pcap').read_bytes()
    assert [up for _, _, up in run.links] == [True, True]
    assert {('CONNECT', 'driver'), ('CONNECT reply', 'controller')} <= {
        (traffic.name, traffic.sender) for traffic in run.traffic
    }
