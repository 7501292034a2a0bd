# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The number of examples, order and markers of tests, coroutine tests, and the fault matrix."""

import gc
import inspect
from collections.abc import Iterator
from typing import Any

import pytest
from support import event_loop, patient
from support.examples import load_profile, profile_for

from epson_driver.processes import processes


def pytest_configure(config: Any) -> None:
    """Set the number of examples before the collection, which reads the settings.

    Each process starts with other files, so that all compile a fresh checkout together. The items
    are sorted afterwards.
    """
    load_profile(profile_for(config.option.markexpr))
    worker = getattr(config, 'workerinput', None)
    if worker and config.args == config.getini('testpaths'):
        files = [str(path) for path in sorted(config.rootpath.glob('test/**/test_*.py'))]
        first = len(files) * int(worker['workerid'][2:]) // worker['workercount']
        config.args = [*files[first:], *files[:first]]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Exclude imported and collected objects from garbage collection, and run it rarely."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000)
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an `async def` test in virtual time (support/event_loop.py).

    A module with REAL_TIME = True runs in real time, because of other threads or processes.
    """
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    arguments = inspect.signature(pyfuncitem.obj).parameters
    given = {name: pyfuncitem.funcargs[name] for name in arguments}
    real_time = getattr(pyfuncitem.module, 'REAL_TIME', False)  # type: ignore[attr-defined]
    event_loop.run(pyfuncitem.obj(**given), real_time=real_time)
    return True


WHOLE_PROCESSES = {
    'system',
    'test_panel_process.py',
    'test_sim_controller.py',
    'test_sim_crowds.py',
}
"""Folders and files whose tests start nodes and controllers as processes."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start with the longest file, then with tests of whole processes, which mostly wait.

    The latter are slow tests, unless marked `quick`.
    """

    def whole(item: pytest.Item) -> bool:
        return not WHOLE_PROCESSES.isdisjoint(item.path.parts)

    items.sort(key=lambda item: (item.path.name != 'test_worlds.py', not whole(item), item.path))
    for item in items:
        if whole(item) and item.get_closest_marker('quick') is None:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope='session', autouse=True)
def _timeout() -> None:
    """Allow processes a long time to end, because machines may be busy."""
    processes.END_TIMEOUT_S = 300.0


@pytest.fixture
def patient_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Extend the time-outs of a driver in this process, like those in `support.cell`."""
    patient.be_patient(monkeypatch.setattr)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print a matrix of the results of all faults with all controller profiles."""
    cells = {
        cell: report.outcome
        for reports in terminalreporter.stats.values()
        for report in reports
        for name, cell in getattr(report, 'user_properties', ())
        if name == 'fault and profile' and report.when == 'call'
    }
    if not cells:
        return
    profiles = list(dict.fromkeys(profile for _, profile in cells))
    terminalreporter.section('a fault in the middle of a motion, on every controller')
    widths = [max(len(profile), len('passed')) for profile in profiles]
    rows = [
        [fault, *(cells.get((fault, profile), '-') for profile in profiles)]
        for fault in dict.fromkeys(fault for fault, _ in cells)
    ]
    for first, *others in [['', *profiles], *rows]:
        words = (word.ljust(width) for word, width in zip(others, widths, strict=True))
        terminalreporter.write_line(' '.join([first.ljust(16), *words]))
