# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The states of a goal and everything that moves it from one to another.

Rules:
1. Every change of a goal's state is a row of TRANSITIONS. The three final states have no row:
   a goal ends once. Nothing is sent for a goal before it is prepared: its motion may have to be
   planned first.
2. One point is on its way at a time; its reply lets the next one go (streaming, REP-I0006).
3. Success needs all replies positive, the arm at the goal within tolerance, and standing, as
   measured after the last reply, and not before the time of the plan has passed (reference.py):
   a way that is shorter than the tolerance may not have begun yet. Where the controller does not
   say whether the arm moves, it must have stood for longer, nearer to the goal than to its start.
4. Cancel, stop and replacement send STOP at once, never behind a pending reply, and end the goal
   when the arm stands. If STOP's answer was taken for that of a point which never came, the state
   decides: an arm that has stood for longer. A fault sends STOP and ends the goal at once: it
   cannot wait for an arm that it may no longer see.
5. After a FAILURE reply STOP is sent, and the next STATUS is awaited for CAUSE_TIMEOUT_S at most:
   it has the reason. While the arm still brakes, the reason may be yet to come, and is awaited.
6. A joint that leaves its path tolerance stops the arm; the goal ends when it stands. It is held
   against the plan at that moment (reference.py), until the plan's end.
7. A controller that is paused (PauseDetector) is waited for, however long: the clock stands
   and no patience runs out.
8. A pause (speed scaling 0) is a STOP that keeps the goal. No point is sent while the arm is at
   rest. At another factor the rest of the plan is checked, prepared and sent like a new goal, from
   where the arm rests. A pause that is not confirmed ends the goal as any STOP would.
9. A goal breaks off when the controller does not answer in time, or rejects what follows points
   that it had taken. Nobody knows then what it will do with them: the arm must be enabled again.
   That time begins when the plan is where the answer is due, at the speed with which points were
   sent: until then the plan may have the arm rest.
10. What is known of the arm when a goal has ended follows from the change that ended it
    (AFTERMATH).
"""

from dataclasses import dataclass
from enum import Enum


class GoalState(Enum):
    """Where a goal is.

    Rejected: a point was refused, and none was taken before it; rejected midway: one was. While it
    is canceling, stopping or pausing, STOP is pending. Confirmed: STOP was
    acknowledged. Paused: the arm is at rest, and the goal waits for another factor.
    """

    PREPARING = 'preparing'
    STREAMING = 'streaming'
    SETTLING = 'settling'
    REJECTED = 'rejected'
    REJECTED_MIDWAY = 'rejected midway'
    CANCELING = 'canceling'
    CANCELING_CONFIRMED = 'canceling, confirmed'
    STOPPING = 'stopping'
    STOPPING_CONFIRMED = 'stopping, confirmed'
    PAUSING = 'pausing'
    PAUSING_CONFIRMED = 'pausing, confirmed'
    PAUSED = 'paused'
    SUCCEEDED = 'succeeded'
    CANCELED = 'canceled'
    ABORTED = 'aborted'


class GoalEvent(Enum):
    """What happens to a goal."""

    PREPARED = 'prepared'
    LAST_REPLY = 'last reply'
    REJECTION = 'rejection'
    REJECTION_MIDWAY = 'rejection midway'
    AT_GOAL = 'at the goal'
    CANCEL = 'cancel'
    STOP = 'stop'
    STOP_CONFIRMED = 'STOP confirmed'
    AT_REST = 'at rest'
    NO_REPLY = 'no reply'
    FAULT = 'fault'
    PAUSE = 'pause'
    RESUME = 'resume'


TRANSITIONS: dict[tuple[GoalState, GoalEvent], GoalState] = {
    (GoalState.PREPARING, GoalEvent.PREPARED): GoalState.STREAMING,
    (GoalState.PREPARING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.PREPARING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.PREPARING, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.PREPARING, GoalEvent.PAUSE): GoalState.PAUSED,
    (GoalState.STREAMING, GoalEvent.LAST_REPLY): GoalState.SETTLING,
    (GoalState.STREAMING, GoalEvent.REJECTION): GoalState.REJECTED,
    (GoalState.STREAMING, GoalEvent.REJECTION_MIDWAY): GoalState.REJECTED_MIDWAY,
    (GoalState.STREAMING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.STREAMING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.STREAMING, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.STREAMING, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.STREAMING, GoalEvent.PAUSE): GoalState.PAUSING,
    (GoalState.SETTLING, GoalEvent.AT_GOAL): GoalState.SUCCEEDED,
    (GoalState.SETTLING, GoalEvent.REJECTION_MIDWAY): GoalState.REJECTED_MIDWAY,
    (GoalState.SETTLING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.SETTLING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.SETTLING, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.SETTLING, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.SETTLING, GoalEvent.PAUSE): GoalState.PAUSING,
    (GoalState.REJECTED, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.REJECTED_MIDWAY, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.CANCELING, GoalEvent.STOP_CONFIRMED): GoalState.CANCELING_CONFIRMED,
    (GoalState.CANCELING, GoalEvent.AT_REST): GoalState.CANCELED,
    (GoalState.CANCELING, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.CANCELING, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.CANCELING_CONFIRMED, GoalEvent.AT_REST): GoalState.CANCELED,
    (GoalState.CANCELING_CONFIRMED, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.CANCELING_CONFIRMED, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.STOPPING, GoalEvent.STOP_CONFIRMED): GoalState.STOPPING_CONFIRMED,
    (GoalState.STOPPING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.STOPPING, GoalEvent.AT_REST): GoalState.ABORTED,
    (GoalState.STOPPING, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.STOPPING, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.STOPPING_CONFIRMED, GoalEvent.CANCEL): GoalState.CANCELING_CONFIRMED,
    (GoalState.STOPPING_CONFIRMED, GoalEvent.AT_REST): GoalState.ABORTED,
    (GoalState.STOPPING_CONFIRMED, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.STOPPING_CONFIRMED, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.PAUSING, GoalEvent.STOP_CONFIRMED): GoalState.PAUSING_CONFIRMED,
    (GoalState.PAUSING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.PAUSING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.PAUSING, GoalEvent.AT_REST): GoalState.ABORTED,
    (GoalState.PAUSING, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.PAUSING, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.CANCEL): GoalState.CANCELING_CONFIRMED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.STOP): GoalState.STOPPING_CONFIRMED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.AT_REST): GoalState.PAUSED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.NO_REPLY): GoalState.ABORTED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.FAULT): GoalState.ABORTED,
    (GoalState.PAUSED, GoalEvent.RESUME): GoalState.PREPARING,
    (GoalState.PAUSED, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.PAUSED, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.PAUSED, GoalEvent.FAULT): GoalState.ABORTED,
}

FINAL_STATES = frozenset({GoalState.SUCCEEDED, GoalState.CANCELED, GoalState.ABORTED})
RUNNING_STATES = frozenset({GoalState.STREAMING, GoalState.SETTLING})
REJECTED_STATES = frozenset({GoalState.REJECTED, GoalState.REJECTED_MIDWAY})
UNCONFIRMED_STATES = frozenset({GoalState.CANCELING, GoalState.STOPPING, GoalState.PAUSING})
CONFIRMED_STATES = frozenset(
    {GoalState.CANCELING_CONFIRMED, GoalState.STOPPING_CONFIRMED, GoalState.PAUSING_CONFIRMED}
)
BRAKING_STATES = UNCONFIRMED_STATES | CONFIRMED_STATES


@dataclass(frozen=True, slots=True)
class Aftermath:
    """The state of arm and controller, as far as known, when a goal has ended.

    at_rest: the arm stands. broken_off: nobody knows what the controller will do with the points
    that it has taken. unanswered: because an answer is missing, which may come later.
    """

    at_rest: bool = False
    broken_off: bool = False
    unanswered: bool = False


AT_REST = Aftermath(at_rest=True)
AT_REST_UNCONFIRMED = Aftermath(at_rest=True, broken_off=True, unanswered=True)
REJECTED_MIDWAY = Aftermath(broken_off=True)
NO_REPLY = Aftermath(broken_off=True, unanswered=True)
UNKNOWN = Aftermath()
"""Of a goal that has not ended, and where a fault ended it."""

AFTERMATH: dict[tuple[GoalState, GoalEvent], Aftermath] = {
    (GoalState.SETTLING, GoalEvent.AT_GOAL): AT_REST,
    (GoalState.REJECTED_MIDWAY, GoalEvent.FAULT): REJECTED_MIDWAY,
    **{
        (state, GoalEvent.AT_REST): AT_REST
        for state in CONFIRMED_STATES - {GoalState.PAUSING_CONFIRMED}
    },
    **{(state, GoalEvent.AT_REST): AT_REST_UNCONFIRMED for state in UNCONFIRMED_STATES},
    **{(state, GoalEvent.NO_REPLY): NO_REPLY for state in RUNNING_STATES | BRAKING_STATES},
}
"""What follows from the change that ended a goal; from any other fault, UNKNOWN."""
