# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The states of a goal and everything that moves it from one to another.

Rules:
1. Every change of a goal's state is a row of TRANSITIONS. The three final states have no row:
   a goal ends once. Nothing is sent for a goal before it is prepared: its motion may have to be
   planned first.
2. One point is on its way at a time; its reply lets the next one go (streaming, REP-I0006).
3. Success needs all replies positive, the arm at the goal within tolerance, and standing, as
   measured after the last reply, and not before the time of the plan has passed (goal_clock.py):
   a way that is shorter than the tolerance may not have begun yet.
4. Cancel, stop and replacement send STOP at once, never behind a pending reply, and end the goal
   when the arm stands. If STOP's answer was taken for that of a point which never came, the state
   decides: an arm that has stood for longer. A fault sends STOP and ends the goal at once: it
   cannot wait for an arm that it may no longer see.
5. After a FAILURE reply STOP is sent, and the next STATUS is awaited for CAUSE_TIME at most: it
   has the reason. While the arm still brakes, the reason may be yet to come, and is awaited.
6. A joint that leaves its path tolerance stops the arm; the goal ends when it stands. It is held
   against the plan at that moment (goal_clock.py), until the plan's end.
7. A controller that is paused (pause.py) is waited for, however long: the clock stands and no
   patience runs out.
8. While the speed scaling is 0 no point is sent; what was acknowledged runs on.
9. A goal breaks off when the controller does not answer in time, or refuses what follows points
   that it had taken. Nobody knows then what it will do with them: the arm must be enabled again.
"""

from enum import Enum


class State(Enum):
    """Where a goal is."""

    PREPARING = 'preparing'
    STREAMING = 'streaming'
    SETTLING = 'settling'
    REFUSED = 'refused'
    CANCELING = 'canceling'
    STOPPING = 'stopping'
    SUCCEEDED = 'succeeded'
    CANCELED = 'canceled'
    ABORTED = 'aborted'


class Event(Enum):
    """What happens to a goal."""

    PREPARED = 'prepared'
    LAST_REPLY = 'last reply'
    REFUSAL = 'refusal'
    AT_GOAL = 'at the goal'
    CANCEL = 'cancel'
    STOP = 'stop'
    AT_REST = 'at rest'
    FAULT = 'fault'


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.PREPARING, Event.PREPARED): State.STREAMING,
    (State.PREPARING, Event.CANCEL): State.CANCELING,
    (State.PREPARING, Event.STOP): State.STOPPING,
    (State.PREPARING, Event.FAULT): State.ABORTED,
    (State.STREAMING, Event.LAST_REPLY): State.SETTLING,
    (State.STREAMING, Event.REFUSAL): State.REFUSED,
    (State.STREAMING, Event.CANCEL): State.CANCELING,
    (State.STREAMING, Event.STOP): State.STOPPING,
    (State.STREAMING, Event.FAULT): State.ABORTED,
    (State.REFUSED, Event.FAULT): State.ABORTED,
    (State.SETTLING, Event.AT_GOAL): State.SUCCEEDED,
    (State.SETTLING, Event.REFUSAL): State.REFUSED,
    (State.SETTLING, Event.CANCEL): State.CANCELING,
    (State.SETTLING, Event.STOP): State.STOPPING,
    (State.SETTLING, Event.FAULT): State.ABORTED,
    (State.CANCELING, Event.AT_REST): State.CANCELED,
    (State.CANCELING, Event.FAULT): State.ABORTED,
    (State.STOPPING, Event.CANCEL): State.CANCELING,
    (State.STOPPING, Event.AT_REST): State.ABORTED,
    (State.STOPPING, Event.FAULT): State.ABORTED,
}

FINAL = frozenset({State.SUCCEEDED, State.CANCELED, State.ABORTED})
