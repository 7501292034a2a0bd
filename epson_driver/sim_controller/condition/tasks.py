# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The SPEL+ tasks of the built-in program, and their state in each condition.

A pause or an open door pauses a Normal task, and an E-stop or an error aborts it. None of these
affects a NoEmgAbort task. (SPEL+ language reference, Xqt and TaskState.)
"""

from collections.abc import Iterator
from typing import NamedTuple

from epson_driver.sim_controller.condition.states import Condition, Tasks
from epson_driver.spel import TaskState, TaskType


class Task(NamedTuple):
    number: int
    name: str
    type: TaskType

    def state(self, condition: Condition) -> TaskState:
        if self.type is TaskType.NO_EMG_ABORT or condition.tasks is Tasks.RUNNING:
            return TaskState.RUNNING
        if condition.tasks is Tasks.STOPPED:
            return TaskState.NOT_RUNNING
        return TaskState.ABORTED if condition.tasks is Tasks.ABORTED else TaskState.HALTED


PROGRAM = (
    Task(1, 'motion server', TaskType.NORMAL),
    Task(2, 'state server', TaskType.NO_EMG_ABORT),
    Task(3, 'I/O server', TaskType.NORMAL),
)
MOTION_SERVER, STATE_SERVER, IO_SERVER = PROGRAM

TYPE_WORDS = {
    TaskType.NORMAL: 'Normal',
    TaskType.NO_PAUSE: 'NoPause',
    TaskType.NO_EMG_ABORT: 'NoEmgAbort',
    TaskType.TRAP: 'Trap',
    TaskType.BACKGROUND: 'background',
}
STATE_WORDS = {
    TaskState.NOT_RUNNING: 'does not run',
    TaskState.RUNNING: 'runs',
    TaskState.WAITING: 'waits',
    TaskState.HALTED: 'paused',
    TaskState.QUICK_PAUSED: 'paused',
    TaskState.ABORTED: 'aborted',
}


class TaskRow(NamedTuple):
    """One SPEL+ task, as shown to users."""

    number: int
    name: str
    type: str
    state: str


def rows(condition: Condition) -> Iterator[TaskRow]:
    for task in PROGRAM:
        state = task.state(condition)
        text = STATE_WORDS[state] + (' (2261)' if state is TaskState.ABORTED else '')
        yield TaskRow(task.number, task.name, TYPE_WORDS[task.type], text)
