# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The states of a goal and all transitions between them.

Rules:
1. Every change of a goal's state is a row of TRANSITIONS. The three final states have no row, so a
   goal ends exactly once. Nothing is sent for a goal before it is prepared, because its motion may
   have to be planned first.
2. Only one point is pending at a time. Its reply releases the next one (streaming, REP-I0006).
3. A goal succeeds if all replies are positive and the arm is at rest at the goal, within the
   tolerance. Rest only counts after the last reply and after the planned time (reference.py),
   because on a path that is shorter than the tolerance the arm may not have started yet. If the
   controller does not report whether the arm moves, the arm must have been at rest for longer, and
   it must be nearer to the goal than to its start.
4. Cancel, stop and replacement send STOP immediately, never after a pending reply, and end the
   goal when the arm is at rest. If the STOP reply was mistaken for a missing point reply, a longer
   standstill in the joint state decides. A fault sends STOP and ends the goal immediately, because
   it cannot wait for an arm whose state may no longer be available.
5. After a FAILURE reply the goal sends STOP and waits up to `cause_timeout` for the next STATUS,
   which contains the cause. While the arm brakes, STATUS may not have the cause yet. Then the goal
   waits up to the reply timeout.
6. If a joint leaves its path tolerance, the arm is stopped, and the goal ends when the arm is at
   rest. Until the plan ends, each joint is compared with its planned position at the time of its
   measurement (reference.py).
7. While the controller is paused (PauseDetector), the goal waits without a time limit: the plan's
   clock stops and no timeout expires.
8. A pause (speed scaling 0) is a STOP that keeps the goal. No point is sent during the pause. When
   the speed scaling is above 0 again, the rest of the plan is checked, prepared and sent like a
   new goal, starting from the arm's position. If STOP is not acknowledged, the goal ends.
9. A goal breaks off when the controller does not reply in time, or rejects a message after it has
   accepted points. It is then unknown whether it will still execute those points, so the arm must
   be enabled again. The reply timeout starts at the planned time of the pending point, including
   the speed scaling, because the plan may keep the arm at rest until this time.
10. AFTERMATH defines what is known about the arm after each transition that ends a goal.
"""

from dataclasses import dataclass
from enum import Enum


class GoalState(Enum):
    """The state of a goal.

    * Rejected: a point was refused and none was accepted before it.
    * Rejected midway: a point was refused after others were accepted.
    * Canceling, stopping and pausing: the reply to STOP is pending. Confirmed: it has arrived.
    * Paused: the arm is at rest, and the goal waits until the speed scaling is above 0.
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


FINAL_STATES = frozenset({GoalState.SUCCEEDED, GoalState.CANCELED, GoalState.ABORTED})
RUNNING_STATES = frozenset({GoalState.STREAMING, GoalState.SETTLING})
REJECTED_STATES = frozenset({GoalState.REJECTED, GoalState.REJECTED_MIDWAY})
UNCONFIRMED_STATES = frozenset({GoalState.CANCELING, GoalState.STOPPING, GoalState.PAUSING})
CONFIRMED_STATES = frozenset(
    {GoalState.CANCELING_CONFIRMED, GoalState.STOPPING_CONFIRMED, GoalState.PAUSING_CONFIRMED}
)
BRAKING_STATES = UNCONFIRMED_STATES | CONFIRMED_STATES

TRANSITIONS: dict[tuple[GoalState, GoalEvent], GoalState] = {
    (GoalState.PREPARING, GoalEvent.PREPARED): GoalState.STREAMING,
    (GoalState.PREPARING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.PREPARING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.PREPARING, GoalEvent.PAUSE): GoalState.PAUSED,
    (GoalState.STREAMING, GoalEvent.LAST_REPLY): GoalState.SETTLING,
    (GoalState.STREAMING, GoalEvent.REJECTION): GoalState.REJECTED,
    (GoalState.STREAMING, GoalEvent.REJECTION_MIDWAY): GoalState.REJECTED_MIDWAY,
    (GoalState.STREAMING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.STREAMING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.STREAMING, GoalEvent.PAUSE): GoalState.PAUSING,
    (GoalState.SETTLING, GoalEvent.AT_GOAL): GoalState.SUCCEEDED,
    (GoalState.SETTLING, GoalEvent.REJECTION_MIDWAY): GoalState.REJECTED_MIDWAY,
    (GoalState.SETTLING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.SETTLING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.SETTLING, GoalEvent.PAUSE): GoalState.PAUSING,
    (GoalState.CANCELING, GoalEvent.STOP_CONFIRMED): GoalState.CANCELING_CONFIRMED,
    (GoalState.CANCELING, GoalEvent.AT_REST): GoalState.CANCELED,
    (GoalState.CANCELING_CONFIRMED, GoalEvent.AT_REST): GoalState.CANCELED,
    (GoalState.STOPPING, GoalEvent.STOP_CONFIRMED): GoalState.STOPPING_CONFIRMED,
    (GoalState.STOPPING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.STOPPING, GoalEvent.AT_REST): GoalState.ABORTED,
    (GoalState.STOPPING_CONFIRMED, GoalEvent.CANCEL): GoalState.CANCELING_CONFIRMED,
    (GoalState.STOPPING_CONFIRMED, GoalEvent.AT_REST): GoalState.ABORTED,
    (GoalState.PAUSING, GoalEvent.STOP_CONFIRMED): GoalState.PAUSING_CONFIRMED,
    (GoalState.PAUSING, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.PAUSING, GoalEvent.STOP): GoalState.STOPPING,
    (GoalState.PAUSING, GoalEvent.AT_REST): GoalState.ABORTED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.CANCEL): GoalState.CANCELING_CONFIRMED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.STOP): GoalState.STOPPING_CONFIRMED,
    (GoalState.PAUSING_CONFIRMED, GoalEvent.AT_REST): GoalState.PAUSED,
    (GoalState.PAUSED, GoalEvent.RESUME): GoalState.PREPARING,
    (GoalState.PAUSED, GoalEvent.CANCEL): GoalState.CANCELING,
    (GoalState.PAUSED, GoalEvent.STOP): GoalState.STOPPING,
    **{
        (state, GoalEvent.NO_REPLY): GoalState.ABORTED for state in RUNNING_STATES | BRAKING_STATES
    },
    **{
        (state, GoalEvent.FAULT): GoalState.ABORTED
        for state in GoalState
        if state not in FINAL_STATES
    },
}


@dataclass(frozen=True, slots=True)
class FinalArmState:
    """The arm after a goal. `broken_off`: the controller may still execute accepted points."""

    at_rest: bool = False  # the arm is at rest
    broken_off: bool = False
    unanswered: bool = False  # the cause is a missing reply, which may come later


AT_REST = FinalArmState(at_rest=True)
AT_REST_UNCONFIRMED = FinalArmState(at_rest=True, broken_off=True, unanswered=True)
REJECTED_MIDWAY = FinalArmState(broken_off=True)
NO_REPLY = FinalArmState(broken_off=True, unanswered=True)
UNKNOWN = FinalArmState()  # state after a fault, and before the goal has ended

AFTERMATH: dict[tuple[GoalState, GoalEvent], FinalArmState] = {
    (GoalState.SETTLING, GoalEvent.AT_GOAL): AT_REST,
    (GoalState.REJECTED_MIDWAY, GoalEvent.FAULT): REJECTED_MIDWAY,
    **{
        (state, GoalEvent.AT_REST): AT_REST
        for state in CONFIRMED_STATES - {GoalState.PAUSING_CONFIRMED}
    },
    **{(state, GoalEvent.AT_REST): AT_REST_UNCONFIRMED for state in UNCONFIRMED_STATES},
    **{(state, GoalEvent.NO_REPLY): NO_REPLY for state in RUNNING_STATES | BRAKING_STATES},
}
"""State of the arm after each transition that ends a goal. Any other leads to UNKNOWN."""
