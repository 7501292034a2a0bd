# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever happens in whatever order, a goal ends at most once (docs/invariants.md, 5)."""

import pytest
from execution_bench import CYCLE, LINE, Bench
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.client.execution import Settings
from epson_driver.client.goal import End
from epson_driver.client.goal_states import FINAL
from epson_driver.client.points import STOP
from epson_driver.simple_message import TriState

pytestmark = pytest.mark.invariant(5)

HAPPENINGS = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(('answer', 'refuse')), st.integers(0, 5)),
        st.tuples(st.just('see'), st.floats(0.0, 0.4)),
        st.tuples(st.just('move'), st.floats(-0.5, 0.5)),
        st.tuples(st.just('go'), st.none()),
        st.tuples(st.just('wait'), st.floats(0.0, 10.0)),
        st.tuples(st.just('status'), st.sampled_from(list(TriState))),
        st.tuples(st.sampled_from(('cancel', 'stop', 'fault', 'withdraw')), st.none()),
        st.tuples(st.just('link'), st.booleans()),
        st.tuples(st.just('forget'), st.none()),
        st.tuples(st.just('scale'), st.sampled_from((0.0, 0.01, 0.5, 1.0))),
        st.tuples(st.just('possible'), st.sampled_from(list(TriState))),
        st.tuples(st.just('prepared'), st.none()),
    ),
    max_size=25,
)


def apply(bench, what, value):
    execution = bench.execution
    if what in ('answer', 'refuse'):
        if bench.sent:
            getattr(bench, what)(message=value % len(bench.sent))
    elif what == 'see':
        bench.see(value)
    elif what == 'move':
        bench.see(0.1, moving=value)
    elif what == 'go':
        if bench.state == 'streaming' and bench.sent:  # at speed 0 no point is sent
            bench.go_and_answer()
    elif what == 'wait':
        bench.pass_time(value)
    elif what == 'status':
        bench.in_motion = value
        bench.status()
    elif what == 'cancel':
        execution.cancel(bench.now)
    elif what == 'stop':
        execution.stop('replaced', bench.now)
    elif what == 'fault':
        execution.fault('a fault')
    elif what == 'withdraw':
        execution.on_unsolicited_failure(bench.now)
    elif what == 'prepared':
        bench.start()
    elif what == 'scale':
        bench.scaling.set(value, bench.now)
    elif what == 'possible':
        bench.status(motion_possible=value)
    elif what == 'link':
        bench.broken = value
    else:
        bench.robot.clear()


@settings(max_examples=examples(300))
@given(st.sampled_from((LINE, CYCLE)), st.booleans(), HAPPENINGS)
def test_inv5_a_goal_ends_once_with_an_outcome_that_fits_its_state(path, start, happenings):
    """docs/invariants.md, 5."""
    bench = Bench(path, settings=Settings(reply_timeout=3.0), goal_time=20.0, start=start)
    for what, value in happenings:
        before = bench.execution.state
        sent = len(bench.sent)
        apply(bench, what, value)
        if before in FINAL:
            assert bench.execution.state is before
        if bench.state == 'preparing':
            assert not bench.sent
            assert len(bench.sent) == sent
        assert len(bench.outcomes) == (bench.execution.state in FINAL)
    assert bench.execution.ended == bool(bench.outcomes)
    if bench.outcomes:
        assert bench.outcome.end.value == bench.state
        assert bench.outcome.text
    points = [message for message in bench.sent if message != STOP]
    assert [point.sequence for point in points] == list(range(len(points)))
    if STOP in bench.sent:  # nothing moves after a STOP
        assert STOP not in points
        assert bench.sent.index(STOP) >= len(points)


@settings(max_examples=examples(100))
@given(HAPPENINGS)
def test_inv5_success_is_never_reported_beside_the_goal(happenings):
    """docs/invariants.md, 5."""
    bench = Bench(settings=Settings(reply_timeout=3.0))
    for what, value in happenings:
        apply(bench, what, value)
        if bench.outcomes:
            break
    if bench.outcomes and bench.outcome.end is End.SUCCEEDED:
        assert abs(bench.at - LINE[-1]).max() <= 0.01
        assert len([message for message in bench.sent if message != STOP]) == len(LINE)


def test_inv5_every_goal_ends_while_states_come():
    """docs/invariants.md, 5: whatever the controller leaves out, patience runs out."""
    for replies in range(len(LINE) + 1):
        for how in (None, 'cancel', 'stop'):
            bench = Bench(settings=Settings(reply_timeout=3.0))
            for _ in range(replies):
                bench.answer()
            if how is not None:
                apply(bench, how, None)
            bench.see(8.0)
            assert bench.execution.ended, (replies, how)
