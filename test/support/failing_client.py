# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client with functions that can be made to raise: `failing_client.py FILE ARGUMENT…`.

At SIGUSR1 it reads a name of HOOKS from FILE and deletes FILE. The next call of that function
raises.
"""

import asyncio
import functools
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from patient import be_patient  # type: ignore[import-not-found]  # beside this script
from rclpy.action import ActionServer
from rclpy.executors import SingleThreadedExecutor

from epson_driver.cli import client
from epson_driver.driver import arm_commands
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.io import io_client
from epson_driver.link import Link
from epson_driver.node import (
    messages,
    node,
)
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.trace.trace import Trace

armed = ''


class InjectedError(Exception):
    """An error unknown to the package."""


def taken(name: str) -> bool:
    """Return whether `name` fails now. It fails once unless it contains `always`."""
    global armed
    if armed != name:
        return False
    if 'always' not in name:
        armed = ''
    return True


def fail(kind: type[BaseException] = InjectedError) -> None:
    raise kind('injected')


def hook(
    name: str,
    owner: Any,
    method: str,
    action: Callable[[], None] = fail,
    where: Callable[..., bool] = lambda *_: True,
) -> None:
    """Make a method run `action` before its work when it is armed."""
    original = getattr(owner, method)

    @functools.wraps(original)
    def wrapper(*arguments: Any, **named: Any) -> Any:
        if where(*arguments) and taken(name):
            action()
        return original(*arguments, **named)

    setattr(owner, method, wrapper)


def of_link(name: str) -> Callable[..., bool]:
    return lambda link, *_: link.name == name


def in_loop(begin: Callable[[asyncio.AbstractEventLoop], object]) -> Callable[[], None]:
    return lambda: (begin(asyncio.get_running_loop()), None)[1]


async def failing() -> None:
    await asyncio.sleep(0.01)
    fail()


def cancel_this_task() -> None:
    task = asyncio.current_task()
    assert task is not None
    task.cancel()


def leave() -> None:
    fail(SystemExit)


def interrupt() -> None:
    fail(KeyboardInterrupt)


def fail_in_a_thread() -> None:
    threading.Thread(target=fail, name='injected').start()


async def watch_status(self: Driver) -> None:
    while not taken('watching the status'):  # noqa: ASYNC110
        await asyncio.sleep(0.01)
    fail()


HOOKS: tuple[tuple[Any, ...], ...] = (
    # tasks of the loop and their functions
    ('state link', Link, '_received', fail, of_link('state')),
    ('motion link', Link, '_handle_reply', fail, of_link('motion')),
    ('io link', Link, '_received', fail, of_link('io')),
    ('asking for the io', io_client.Io, '_values'),
    ('state packet', Driver, '_on_state_packet'),
    ('status', Driver, '_handle_status'),
    ('reply', GoalExecution, 'on_reply'),
    ('state of the goal', GoalExecution, 'on_state'),
    ('diagnostics', Diagnostics, 'build'),
    ('publish joints', messages.JointStateWriter, 'write', lambda: fail(AssertionError)),
    ('publish status', messages.RobotStatusWriter, 'write', lambda: fail(AssertionError)),
    ('publish feedback', messages, 'feedback'),
    ('cancelled task', node.ClientNode, 'on_joints', cancel_this_task),
    # other functions in the loop
    ('callback', node.ClientNode, 'on_joints', in_loop(lambda loop: loop.call_soon(fail))),
    ('timer', node.ClientNode, 'on_joints', in_loop(lambda loop: loop.call_later(0.01, fail))),
    ('task', node.ClientNode, 'on_joints', in_loop(lambda loop: loop.create_task(failing()))),
    ('exit', node.ClientNode, 'on_joints', leave),
    (
        'exit of a callback',
        node.ClientNode,
        'on_joints',
        in_loop(lambda loop: loop.call_soon(leave)),
    ),
    ('interrupt', node.ClientNode, 'on_joints', in_loop(lambda loop: loop.call_soon(interrupt))),
    ('submit', GoalQueue, 'submit'),
    ('cancel in the loop', GoalQueue, 'cancel'),
    # the executor's thread, and others
    ('executor', SingleThreadedExecutor, 'spin_once'),
    ('executor, always', SingleThreadedExecutor, 'spin_once'),
    ('exit of the executor', SingleThreadedExecutor, 'spin_once', leave),
    ('rclpy', ActionServer, '_execute_cancel_request'),
    ('thread', node.ClientNode, 'on_joints', fail_in_a_thread),
    # requests
    ('~/stop', arm_commands.ArmCommands, 'stop'),
    ('exit of ~/reset_error', arm_commands.ArmCommands, '_act', leave),
    ('~/read_io', io_client.Io, 'read'),
    ('~/set_speed_scaling', node.SpeedScalingInterface, '_set'),
    # functions that may fail without stopping the arm
    ('trace', Trace, '_record'),
)


def main() -> int:
    file = Path(sys.argv.pop(1))

    def arm(_number: int, _frame: object) -> None:
        global armed
        armed = file.read_text(encoding='utf-8')
        file.unlink()

    be_patient()
    signal.signal(signal.SIGUSR1, arm)
    for arguments in HOOKS:
        hook(*arguments)
    Driver._watch_status = watch_status  # type: ignore[method-assign]  # noqa: SLF001 - that is the failure
    return client.main()


if __name__ == '__main__':
    sys.exit(main())
