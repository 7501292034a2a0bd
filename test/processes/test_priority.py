# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The priority of the heartbeat thread: set, not inherited, or refused."""

import errno
import os
import subprocess
import sys
import threading
from contextlib import closing

import pytest

from epson_driver.api.threads import LoopThread
from epson_driver.processes import command

ASKED = 'import os; print(os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0))'


def own():
    """Return the scheduling policy of this thread and its nice value."""
    nice = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, nice


def in_thread(function):
    result = []
    thread = threading.Thread(target=lambda: result.append(function()))
    thread.start()
    thread.join()
    return result[0]


def raised():
    """Return the priorities of this thread, of a new thread and of a new process."""
    command.raise_priority()
    command.raise_priority()
    child = subprocess.run([sys.executable, '-c', ASKED], check=True, capture_output=True)
    return own(), in_thread(own), tuple(map(int, child.stdout.split()))


def refuses(*_arguments):
    raise PermissionError(errno.EPERM, 'Operation not permitted')


@pytest.fixture(autouse=True)
def _first(monkeypatch, caplog):
    monkeypatch.setattr(command, '_refused', threading.Event())
    caplog.set_level('INFO')


def test_priority_is_raised_for_one_thread_or_refusal_is_logged(caplog):
    usual = in_thread(own)
    here, thread, process = in_thread(raised)
    if caplog.messages:
        assert here == usual
    else:
        assert here == (os.SCHED_OTHER, command.NICE)
        assert thread[0] == process[0] == os.SCHED_OTHER
        assert min(thread[1], process[1]) >= min(0, usual[1])
    assert in_thread(own) == usual


@pytest.mark.parametrize('missing', [False, True])
def test_refusal_is_logged_once_with_the_remedy(monkeypatch, caplog, missing):
    if missing:
        monkeypatch.delattr(os, 'sched_getscheduler')
    monkeypatch.setattr(os, 'sched_setscheduler', refuses)
    for _ in range(2):
        in_thread(command.raise_priority)
    (text,) = caplog.messages
    assert 'keeps its normal priority' in text
    assert 'docs/troubleshooting.md has the remedy' in text


def test_event_loop_of_a_robot_has_the_priority():
    with closing(LoopThread('robot')) as thread:
        assert thread.call(own) == in_thread(lambda: (command.raise_priority(), own())[1])
