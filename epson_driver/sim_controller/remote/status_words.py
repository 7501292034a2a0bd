# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The bits of a SPEL+ controller's status: GetStatus, CtrlInfo, RobotInfo and Stat.

Each status word is a table from bit to predicate. (SPEL+ language reference; RC+ user's guide,
Remote Ethernet; the eleven flags of the RC700 generation.)

Two things differ from a real controller. First, the tasks of the built-in programs run
permanently, so a real controller would never be Ready. With these programs, Running therefore
means that the arm moves or has a target, and Ready means that it does not. With a SPEL+ program,
the controller is Ready when no task except background tasks runs, like a real controller. Second,
warnings do not exist.
"""

from collections.abc import Callable, Mapping

from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.states import Door, Fault, Mode, Power, Tasks
from epson_driver.sim_controller.condition.tasks import PROGRAM
from epson_driver.sim_controller.core import Controller
from epson_driver.spel import TaskState

CONTROL_DEVICE = 26
Predicate = Callable[[Controller], bool]


def running(controller: Controller) -> bool:
    """Return whether the controller is Running and not paused.

    It is Running while the arm moves, has points or returns after an open door, and while a SPEL+
    task other than a background task runs.
    """
    condition = controller.condition
    moves = controller.moving or condition.tasks is Tasks.RECOVERING
    return (moves or controller.program.runs) and not condition.paused


def ready(controller: Controller) -> bool:
    return not running(controller) and not controller.condition.paused


def error(controller: Controller) -> bool:
    """Return whether the controller has an error or shows an error number.

    TASK_ABORTED of stopped tasks is no error here, because the tasks can be started again.
    """
    number = controller.error_number
    if controller.condition.tasks is Tasks.STOPPED and number == ErrorNumber.TASK_ABORTED:
        return controller.condition.estopped
    return controller.condition.fault is not Fault.NONE or number != ErrorNumber.NONE


def never(_controller: Controller) -> bool:
    """Return False, for flags that the simulation never sets."""
    return False


def _critical(controller: Controller) -> bool:
    return controller.condition.fault is Fault.CRITICAL


def door_open(controller: Controller) -> bool:
    return controller.condition.door is Door.OPEN


def _estop(controller: Controller) -> bool:
    return controller.condition.estopped


def _paused(controller: Controller) -> bool:
    return controller.condition.paused


def _manual(controller: Controller) -> bool:
    return controller.condition.mode is Mode.MANUAL


def _moving(controller: Controller) -> bool:
    return controller.moving


def motors_on(controller: Controller) -> bool:
    return controller.condition.powered


def power_high(controller: Controller) -> bool:
    return controller.condition.power is Power.HIGH


def _in(*tasks: Tasks) -> Predicate:
    return lambda controller: controller.condition.tasks in tasks


def _not(predicate: Predicate) -> Predicate:
    return lambda controller: not predicate(controller)


def _task_runs(number: int) -> Predicate:
    task = next((task for task in PROGRAM if task.number == number), None)
    if task is None:
        return never
    return lambda controller: (
        task.state(controller.condition) in (TaskState.RUNNING, TaskState.HALTED)
    )


FLAGS: dict[str, Predicate] = {
    'Test': never,
    'Teach': _manual,
    'Auto': _not(_manual),
    'Warning': never,
    'SError': _critical,
    'Safeguard': door_open,
    'EStop': _estop,
    'Error': error,
    'Paused': _paused,
    'Running': running,
    'Ready': ready,
}
"""The flags in the answer to GetStatus, from left to right."""

CTRL_INFO_1: dict[int, Predicate] = {
    0x1: ready,
    0x2: running,
    0x4: _paused,
    0x100: _estop,
    0x200: door_open,
    0x400: error,
    0x800: _critical,
    0x1000: never,
    0x2000: _in(Tasks.WAIT_RECOVER),
    0x4000: _in(Tasks.RECOVERING),
}
"""Bits of CtrlInfo(1), the controller's state. 0x1000 is a warning."""

CTRL_INFO_7: dict[int, Predicate] = {0x1: _not(_manual)}
"""Bits of CtrlInfo(7), the operation mode: 1 in AUTO, 0 in program mode (MANUAL)."""

ROBOT_INFO_0: dict[int, Predicate] = {
    0x2: lambda controller: error(controller) and not _critical(controller),
    0x4: _critical,
    0x8: motors_on,
    0x10: power_high,
    0x100: _not(_moving),
    0x200: _moving,
    0x400: lambda controller: controller.condition.paused and not controller.in_motion,
    0x4000: never,
}
"""Bits of RobotInfo(0), the robot's state.

0x100: at rest. 0x200: in motion, or paused during a motion. 0x400: stopped by a pause or the door.
0x4000: stopped by Till.
"""

STAT_0: dict[int, Predicate] = {
    **{1 << (number - 1): _task_runs(number) for number in range(1, 17)},
    0x10000: running,
    0x20000: _paused,
    0x40000: error,
    0x80000: _manual,
    0x100000: _estop,
    0x200000: _not(power_high),
    0x400000: _not(door_open),
    0x800000: never,
}
"""Bits of Stat(0): tasks 1 to 16, then the controller's state. 0x800000 is the enable switch."""

STAT_1: dict[int, Predicate] = {0x10: motors_on}
"""Bits of Stat(1), the robot's state. The bits for reached positions are not simulated."""


def word(table: Mapping[int, Predicate], controller: Controller) -> int:
    return sum(bit for bit, predicate in table.items() if predicate(controller))


def flags(controller: Controller) -> str:
    return ''.join(str(int(predicate(controller))) for predicate in FLAGS.values())
