# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The SPEL+ tasks of the built-in program, and their state in each condition.

A pause or an open door pauses a Normal task, and an E-stop or an error aborts it. None of these
affects a NoEmgAbort task. (SPEL+ language reference, Xqt and TaskState.)
"""

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

from epson_driver.sim_controller.condition.states import Condition, Tasks


class TaskType(Enum):
    """SPEL+ task types. The values are those of TaskInfo(task, 2)."""

    NORMAL = 0
    NO_PAUSE = 1
    NO_EMG_ABORT = 2


class TaskState(Enum):
    """States of a task. The values are those of SPEL+'s TaskState function."""

    NOT_RUNNING = 0
    RUNNING = 1
    WAITING = 2
    HALTED = 3
    QUICK_PAUSE = 4
    ABORTED = 5


TASK_STATES: dict[TaskType, dict[Tasks, TaskState]] = {
    TaskType.NORMAL: {
        Tasks.RUNNING: TaskState.RUNNING,
        Tasks.PAUSED: TaskState.HALTED,
        Tasks.INTERRUPTED: TaskState.HALTED,
        Tasks.WAIT_RECOVER: TaskState.HALTED,
        Tasks.RECOVERING: TaskState.HALTED,
        Tasks.STOPPED: TaskState.NOT_RUNNING,
        Tasks.ABORTED: TaskState.ABORTED,
    },
    TaskType.NO_PAUSE: {
        Tasks.RUNNING: TaskState.RUNNING,
        Tasks.PAUSED: TaskState.RUNNING,
        Tasks.INTERRUPTED: TaskState.RUNNING,
        Tasks.WAIT_RECOVER: TaskState.RUNNING,
        Tasks.RECOVERING: TaskState.RUNNING,
        Tasks.STOPPED: TaskState.NOT_RUNNING,
        Tasks.ABORTED: TaskState.ABORTED,
    },
    TaskType.NO_EMG_ABORT: dict.fromkeys(Tasks, TaskState.RUNNING),
}


class Task(NamedTuple):
    """One task of the built-in program: SPEL+ task number, name and type."""

    number: int
    name: str
    type: TaskType

    def state(self, condition: Condition) -> TaskState:
        """Return the task's state in a condition of the controller (for example paused)."""
        return TASK_STATES[self.type][condition.tasks]


PROGRAM = (
    Task(1, 'motion server', TaskType.NORMAL),
    Task(2, 'state server', TaskType.NO_EMG_ABORT),
    Task(3, 'I/O server', TaskType.NORMAL),
)
MOTION_SERVER, STATE_SERVER, IO_SERVER = PROGRAM

TASK_TYPES = {
    TaskType.NORMAL: 'Normal',
    TaskType.NO_PAUSE: 'NoPause',
    TaskType.NO_EMG_ABORT: 'NoEmgAbort',
}
TASK_WORDS = {
    TaskState.NOT_RUNNING: 'does not run',
    TaskState.RUNNING: 'runs',
    TaskState.WAITING: 'waits',
    TaskState.HALTED: 'paused',
    TaskState.QUICK_PAUSE: 'paused',
    TaskState.ABORTED: 'aborted (2261)',
}
"""State of a task → its text for display."""


class TaskRow(NamedTuple):
    """A task as shown to users: number, name, type and state."""

    number: int
    name: str
    type: str
    state: str


def rows(condition: Condition) -> Iterator[TaskRow]:
    """Yield the tasks of the built-in program."""
    for task in PROGRAM:
        state = TASK_WORDS[task.state(condition)]
        yield TaskRow(task.number, task.name, TASK_TYPES[task.type], state)
