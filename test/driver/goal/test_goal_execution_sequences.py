# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever happens in whatever order, a goal ends at most once (docs/invariants.md, 5)."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.goal_execution_harness import CYCLE, LINE, Harness

from epson_driver.driver.delivery.streaming import STOP
from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.goal.goal_states import FINAL_STATES
from epson_driver.driver.outcome import End
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


def apply(harness, what, value):
    execution = harness.execution
    if what in ('answer', 'refuse'):
        if harness.sent:
            getattr(harness, what)(message=value % len(harness.sent))
    elif what == 'see':
        harness.see(value)
    elif what == 'move':
        harness.see(0.1, moving=value)
    elif what == 'go':
        if harness.state == 'streaming' and harness.sent:  # at speed 0 no point is sent
            harness.go_and_answer()
    elif what == 'wait':
        harness.pass_time(value)
    elif what == 'status':
        harness.in_motion = value
        harness.status()
    elif what == 'cancel':
        execution.cancel(harness.now)
    elif what == 'stop':
        execution.stop('replaced', harness.now)
    elif what == 'fault':
        execution.fault('a fault')
    elif what == 'withdraw':
        execution.on_unsolicited_failure(harness.now)
    elif what == 'prepared':
        harness.start()
    elif what == 'scale':
        harness.set_speed(value)
    elif what == 'possible':
        harness.status(motion_possible=value)
    elif what == 'link':
        harness.broken = value
    else:
        harness.robot.clear()


def split(messages, separator):
    """Return the messages between those that are a separator."""
    parts = [[]]
    for message in messages:
        if message == separator:
            parts.append([])
        else:
            parts[-1].append(message)
    return parts


@settings(max_examples=examples(300))
@given(st.sampled_from((LINE, CYCLE)), st.booleans(), HAPPENINGS)
def test_inv5_any_sequence_ends_goal_once_with_matching_outcome(path, start, happenings):
    """docs/invariants.md, 5."""
    harness = Harness(path, settings=GoalSettings(reply_timeout=3.0), goal_time=20.0, start=start)
    for what, value in happenings:
        before = harness.execution.state
        sent = len(harness.sent)
        apply(harness, what, value)
        harness.resume()
        if before in FINAL_STATES:
            assert harness.execution.state is before
        if harness.state in ('preparing', 'paused'):
            assert len(harness.sent) == sent
        assert len(harness.outcomes) == (harness.execution.state in FINAL_STATES)
    assert harness.execution.ended == bool(harness.outcomes)
    if harness.outcomes:
        assert harness.outcome.end.value == harness.state
        assert harness.outcome.text
    *legs, last = split(harness.sent, STOP)  # each pause is one, and so is the end
    for points in (*legs, last):
        assert [point.sequence for point in points] == list(range(len(points)))
    if 'scale' not in dict(happenings):
        assert not legs or not last


@settings(max_examples=examples(100))
@given(HAPPENINGS)
def test_inv5_success_is_reported_only_at_the_goal(happenings):
    """docs/invariants.md, 5."""
    harness = Harness(settings=GoalSettings(reply_timeout=3.0))
    for what, value in happenings:
        apply(harness, what, value)
        if harness.outcomes:
            break
    if harness.outcomes and harness.outcome.end is End.SUCCEEDED:
        assert abs(harness.at - LINE[-1]).max() <= 0.01
        assert len([message for message in harness.sent if message != STOP]) >= len(LINE) - 1


def test_inv5_every_goal_ends_while_states_arrive():
    """docs/invariants.md, 5: a timeout ends the goal, whatever the controller omits."""
    for replies in range(len(LINE) + 1):
        for how in (None, 'cancel', 'stop'):
            harness = Harness(settings=GoalSettings(reply_timeout=3.0))
            for _ in range(replies):
                harness.answer()
            if how is not None:
                apply(harness, how, None)
            harness.see(8.0)
            assert harness.execution.ended, (replies, how)
