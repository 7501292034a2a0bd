# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's pendant for a simulated controller. It must not act on a real one.

The controller is a scripted remote port. Time is virtual.
"""

import asyncio
import contextlib
import sys
import threading
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest
from support.event_loop import accepted, now, until
from support.remote_peer import RemotePeer
from support.ros_peer import PATIENCE

from epson_driver.panel.sim_pendant import (
    ANSWER_TIMEOUT_S,
    ONE_CLIENT,
    NotSimulatedError,
    PendantThread,
    SimPendant,
)
from epson_driver.remote_ethernet.client import RemoteErrorNumber
from epson_driver.remote_ethernet.hand import Action
from epson_driver.sim_controller.network.announcement import announce

Take = Callable[[str], str | None]

BAD = RemoteErrorNumber.BAD_COMMAND


class Controller(RemotePeer):
    """A remote port announced as simulated. `take(command)` returns the answer, None for none.

    It disconnects if `take` raises ConnectionError.
    """

    def __init__(self, take: Take) -> None:
        super().__init__()
        self._take = take

    async def __aenter__(self) -> 'Controller':
        await super().__aenter__()
        self.announcement = announce('127.0.0.1', self.port)
        return self

    async def __aexit__(self, *_: object) -> None:
        await accepted()
        self.announcement.close()
        await super().__aexit__()

    @property
    def commands(self) -> list[str]:
        return [line.removeprefix('$') for line in self.lines]

    async def answer(self, line: str) -> str | None:
        return self._take(line.removeprefix('$'))

    def count(self, command: str) -> int:
        """Return how many times a command was received."""
        return self.commands.count(command)


def simulated(special: dict[str, Any] | None = None) -> Take:
    """Answer like the simulated controller. `special`: other answers or exceptions."""
    usual = {
        'Sim,joints': '#Sim,0',
        'Login,': '#Login,0',
        'Logout': '#Logout,0',
        'Sim,condition': '#Sim,estop=not active;door=closed',
        'Sim,fault,list': '#Sim,cut;;late',
        'Sim,estop,press': '#Sim,0',
    }

    def take(command: str) -> str | None:
        result = (usual | (special or {}))[command]
        if callable(result):
            result = result()
        if isinstance(result, type):
            raise result
        return None if result is None else str(result)

    return take


class Results(list[tuple[str, bool]]):
    """The results of commands."""

    def __call__(self, why: str, done: bool) -> None:
        self.append((why, done))


@contextlib.asynccontextmanager
async def played(take: Take) -> AsyncIterator[tuple[SimPendant, Controller, Results]]:
    """Run a pendant at a controller."""
    async with Controller(take) as controller:
        pendant = SimPendant(asyncio.get_running_loop(), '127.0.0.1', controller.port, now)
        await asyncio.sleep(0)
        task = pendant._task
        assert task is not None
        yield pendant, controller, Results()
        pendant.end()
        await asyncio.wait([task])


async def test_pendant_polls_the_condition_and_performs_a_button_press() -> None:
    async with played(simulated()) as (pendant, controller, results):
        await until(lambda: controller.count('Sim,condition') > 3)
        assert pendant.latest is not None
        simulation, at = pendant.latest
        assert simulation.condition == {'estop': 'not active', 'door': 'closed'}
        assert simulation.faults == ('cut', 'late')
        assert now() - at < 1.0
        pendant.press(Action(('Sim,estop,press',)), results)
        await until(lambda: results)
        assert results == [('', True)]
        assert controller.count('Sim,joints') == 1


@pytest.mark.invariant(1)
async def test_real_controller_is_queried_only_once() -> None:
    """It serves one remote client, which should be the driver."""

    async with played(simulated({'Sim,condition': f'!Sim,{BAD.value}'})) as (
        pendant,
        controller,
        results,
    ):
        await until(lambda: pendant.real)
        await asyncio.sleep(30.0)
        assert controller.commands == ['Sim,joints', 'Sim,condition']
        with pytest.raises(NotSimulatedError, match='no reply from a simulated controller'):
            pendant.press(Action(('SetMotorsOn,1',)), results)


@pytest.mark.invariant(1)
async def test_port_that_is_not_announced_gets_no_connection() -> None:
    """It may lead to a real controller, whose only client is the driver."""

    async with played(simulated()) as (pendant, controller, _results):
        await until(lambda: pendant.latest)
        controller.announcement.close()
        await asyncio.sleep(1.0)
        known = SimPendant(asyncio.get_running_loop(), '127.0.0.1', controller.port, now)
        await asyncio.sleep(10.0)
        assert controller.count('Sim,joints') == 1
        assert (known.latest, known.real) == (None, False)
        known.end()


async def test_press_that_needs_a_login_gets_its_own_connection() -> None:
    async with played(simulated({'Pause': '#Pause,0'})) as (pendant, controller, results):
        await until(lambda: pendant.latest)
        pendant.press(Action(('Pause',)), results)
        await until(lambda: results)
        assert results == [('', True)]
        start = controller.commands.index('Login,')
        assert controller.commands[start : start + 3] == ['Login,', 'Pause', 'Logout']
        assert controller.count('Sim,joints') == 1


async def test_press_that_needs_a_login_is_refused_by_a_controller_with_one_client() -> None:
    def disconnect() -> None:
        raise ConnectionError

    async with played(simulated({'Login,': disconnect})) as (pendant, controller, results):
        await until(lambda: pendant.latest)
        pendant.press(Action(('Pause',)), results)
        await until(lambda: results)
        assert results == [(ONE_CLIENT, False)]
        assert controller.count('Login,') == 1
        polls = controller.count('Sim,condition')
        await until(lambda: controller.count('Sim,condition') > polls)
        assert controller.count('Sim,joints') == 1  # the session continues


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    'answer', ['!Sim,99', '#Sim,what?', ConnectionError, None],
    ids=['another error', 'no condition', 'disconnects', 'silent'],
)  # fmt: skip
async def test_controller_without_condition_is_not_simulated_and_polled_again(answer: Any) -> None:
    async with played(simulated({'Sim,condition': answer})) as (pendant, controller, results):
        await until(lambda: controller.count('Sim,condition') > 2)
        assert (pendant.latest, pendant.real) == (None, False)
        with pytest.raises(NotSimulatedError):
            pendant.press(Action(('Sim,estop,press',)), results)


@pytest.mark.parametrize(
    ('why', 'message'),
    [
        ('#Sim,the key is at MANUAL', 'the key is at MANUAL'),
        ('#Sim,', 'Sim,estop,press: '),
        (f'!Sim,{BAD.value}', 'Sim,estop,press: '),
    ],
)
async def test_refused_press_returns_the_reason(why: str, message: str) -> None:
    async with played(simulated({'Sim,estop,press': '!Sim,20', 'Sim,why': why})) as (
        pendant,
        controller,
        results,
    ):
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,estop,press',)), results)
        await until(lambda: results)
        ((text, done),) = results
        assert not done
        assert text.startswith(message)
        await until(lambda: controller.count('Sim,condition') > 3)
        assert controller.count('Sim,joints') == 1  # the session continues


@pytest.mark.parametrize('answer', [ConnectionError, None], ids=['disconnects', 'silent'])
async def test_unanswered_press_and_pending_presses_fail(answer: Any) -> None:
    async with played(simulated({'Sim,estop,press': answer})) as (pendant, controller, results):
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,estop,press',)), results)
        pendant.press(Action(('Reset',)), results)
        start = now()
        await until(lambda: len(results) == 2)
        assert now() - start < ANSWER_TIMEOUT_S + 1.0
        assert results == [
            ('Sim,estop,press: no reply from the controller', False),
            ('Reset: no reply from a simulated controller', False),
        ]
        assert pendant.latest is None
        await until(lambda: pendant.latest)  # reconnected
        assert controller.count('Reset') == 0


@pytest.mark.invariant(4)
async def test_press_during_a_disconnect_is_not_repeated_after_it() -> None:
    """A queued command of the old session would switch the motors on seconds after the click."""
    disconnected = []

    def once() -> str:
        if not disconnected:
            disconnected.append(True)
            raise ConnectionError
        return '#Sim,'

    async with played(simulated({'Sim,fault,list': once})) as (pendant, controller, results):
        await until(lambda: disconnected)
        await asyncio.sleep(0.1)
        late = Action(('SetMotorsOn,1',))  # pending from another thread
        pendant._commands.put_nowait((late, results))
        await until(lambda: controller.count('Sim,joints') == 2 and pendant.latest)
        assert results == [('SetMotorsOn,1: no reply from a simulated controller', False)]
        assert controller.count('SetMotorsOn,1') == 0


@pytest.mark.invariant(7)
async def test_text_of_two_commands_is_not_sent_and_the_session_continues() -> None:
    async with played(simulated()) as (pendant, controller, results):
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,fault,a\r\n$SetMotorsOn,1',)), results)
        await until(lambda: results)
        assert 'must be one command' in results[0][0]
        await until(lambda: controller.count('Sim,condition') > 3)
        assert controller.count('Sim,joints') == 1


@pytest.mark.invariant(9)
async def test_failed_pendant_is_reported_immediately() -> None:
    """asyncio reports a failed task only when it is deleted."""
    reported: list[Any] = []

    def fails(_why: str, _done: bool) -> None:
        raise ZeroDivisionError('made for this test')

    async with played(simulated()) as (pendant, _controller, _results):
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: reported.append(context['exception']))
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,estop,press',)), fails)
        await until(lambda: reported)
        assert isinstance(reported[0], ZeroDivisionError)


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('fails', 'what'),
    [
        (lambda: 1 // 0, 'a pendant failed'),
        (sys.exit, 'the thread of the pendants ended'),
    ],
    ids=['a callback', 'the loop'],
)
def test_failure_in_the_pendant_thread_is_reported(fails: Callable[[], Any], what: str) -> None:
    reported: list[tuple[str, BaseException]] = []
    seen = threading.Event()

    def on_error(text: str, error: BaseException) -> None:
        reported.append((text, error))
        seen.set()

    thread = PendantThread(lambda: 0.0, on_error)
    thread._loop.call_soon_threadsafe(fails)
    assert seen.wait(PATIENCE)
    assert [text for text, _ in reported] == [what]
    thread.end()
