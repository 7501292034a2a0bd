# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The pendant of a simulated controller: each press has its answer, and a real one is left alone.

The controller is a scripted remote port; time is virtual.
"""

import asyncio
import contextlib
import sys
import threading
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from support.event_loop import accepted, now, run, until
from support.ros_peer import PATIENCE

from epson_driver.panel.sim_pendant import (
    ANSWER_TIMEOUT_S,
    NotSimulatedError,
    PendantThread,
    SimPendant,
)
from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.remote_ethernet.hand import Action

Take = Callable[[str], str | None]

BAD = RemoteErrorNumber.BAD_COMMAND


class Controller:
    """A remote port. `take(command)` gives the answer, without `#`; None: it never answers.

    Raises ConnectionError: it hangs up.
    """

    def __init__(self, take: Take) -> None:
        self._take = take
        self.commands: list[str] = []
        self._tasks: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> 'Controller':
        self._server = await asyncio.start_server(self._accept, '127.0.0.1', 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        await accepted()
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._tasks.add(asyncio.create_task(self._serve(reader, writer)))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError):
            while line := (await reader.readline()).decode().strip():
                command = line.removeprefix('$')
                self.commands.append(command)
                answer = self._take(command)
                if answer is not None:
                    writer.write(f'{answer}\r\n'.encode())
        writer.close()

    def count(self, command: str) -> int:
        """Return how often a command came."""
        return self.commands.count(command)


def simulated(special: dict[str, Any] | None = None) -> Take:
    """Answer as the simulated controller does; `special`: other answers, or what is raised."""
    usual = {
        'Login,': '#Login,0',
        'Logout': '#Logout,0',
        'Sim,condition': '#Sim,estop=not active;door=closed',
        'Sim,fault,list': '#Sim,cut;;late',
        'Sim,estop,press': '#Sim,0',
    }

    def take(command: str) -> str | None:
        found = (usual | (special or {}))[command]
        if callable(found):
            found = found()
        if isinstance(found, type):
            raise found
        return None if found is None else str(found)

    return take


class Said:
    """What became of commands."""

    def __init__(self) -> None:
        self.all: list[tuple[str, bool]] = []

    def __call__(self, why: str, done: bool) -> None:
        self.all.append((why, done))


def played(
    take: Take, scene: Callable[[SimPendant, Controller, Said], Coroutine[Any, Any, None]]
) -> None:
    """Play a scene with a pendant at a controller."""

    async def scenario() -> None:
        async with Controller(take) as controller:
            loop = asyncio.get_running_loop()
            pendant = SimPendant(loop, '127.0.0.1', controller.port, now)
            await asyncio.sleep(0)
            task = pendant._task
            assert task is not None
            await scene(pendant, controller, Said())
            pendant.end()
            await asyncio.wait([task])

    run(scenario())


def test_it_says_what_the_controller_says_again_and_again() -> None:
    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: controller.count('Sim,condition') > 3)
        assert pendant.latest is not None
        simulation, at = pendant.latest
        assert simulation.condition == {'estop': 'not active', 'door': 'closed'}
        assert simulation.faults == ('cut', 'late')
        assert now() - at < 1.0
        pendant.press(Action(('Sim,estop,press',)), said)
        await until(lambda: said.all)
        assert said.all == [('', True)]
        assert controller.count('Login,') == 1

    played(simulated(), scene)


@pytest.mark.invariant(1)
def test_a_controller_that_is_real_is_asked_once_and_never_again() -> None:
    """Its one place for a remote client should be the driver's."""

    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: pendant.real)
        await asyncio.sleep(30.0)
        assert controller.commands == ['Login,', 'Sim,condition']
        with pytest.raises(NotSimulatedError, match='no simulated controller answers'):
            pendant.press(Action(('SetMotorsOn,1',)), said)

    played(simulated({'Sim,condition': f'!Sim,{BAD.value}'}), scene)


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    'answer', ['!Sim,99', '#Sim,what?', ConnectionError, None],
    ids=['another error', 'no condition', 'hangs up', 'silent'],
)  # fmt: skip
def test_who_does_not_say_that_it_is_simulated_is_not_and_is_asked_again(answer: Any) -> None:
    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: controller.count('Sim,condition') > 2)
        assert (pendant.latest, pendant.real) == (None, False)
        with pytest.raises(NotSimulatedError):
            pendant.press(Action(('Sim,estop,press',)), said)

    played(simulated({'Sim,condition': answer}), scene)


@pytest.mark.parametrize(
    ('why', 'said_why'),
    [
        ('#Sim,the key is at MANUAL', 'the key is at MANUAL'),
        ('#Sim,', 'Sim,estop,press: '),
        (f'!Sim,{BAD.value}', 'Sim,estop,press: '),
    ],
)
def test_a_press_that_is_refused_says_why(why: str, said_why: str) -> None:
    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,estop,press',)), said)
        await until(lambda: said.all)
        ((text, done),) = said.all
        assert not done
        assert text.startswith(said_why)
        await until(lambda: controller.count('Sim,condition') > 3)
        assert controller.count('Login,') == 1  # it goes on

    played(simulated({'Sim,estop,press': '!Sim,20', 'Sim,why': why}), scene)


@pytest.mark.parametrize('answer', [ConnectionError, None], ids=['hangs up', 'silent'])
def test_a_press_that_is_not_answered_is_said_and_so_are_those_that_wait(answer: Any) -> None:
    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,estop,press',)), said)
        pendant.press(Action(('Reset',)), said)
        began = now()
        await until(lambda: len(said.all) == 2)
        assert now() - began < ANSWER_TIMEOUT_S + 1.0
        assert said.all == [
            ('Sim,estop,press: the controller did not answer', False),
            ('Reset: no simulated controller answers', False),
        ]
        assert pendant.latest is None
        await until(lambda: pendant.latest)  # it comes back
        assert controller.count('Reset') == 0

    played(simulated({'Sim,estop,press': answer}), scene)


@pytest.mark.invariant(4)
def test_what_was_pressed_as_the_controller_went_is_not_pressed_when_it_comes_back() -> None:
    """It lay in the queue until the next login, and motors went on seconds after the click."""
    hung_up = []

    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: hung_up)
        await asyncio.sleep(0.1)
        late = Action(('SetMotorsOn,1',))  # on its way from another thread
        pendant._commands.put_nowait((late, said))
        await until(lambda: controller.count('Login,') == 2 and pendant.latest)
        assert said.all == [('SetMotorsOn,1: no simulated controller answers', False)]
        assert controller.count('SetMotorsOn,1') == 0

    def once() -> str:
        if not hung_up:
            hung_up.append(True)
            raise ConnectionError
        return '#Sim,'

    played(simulated({'Sim,fault,list': once}), scene)


@pytest.mark.invariant(7)
def test_a_text_that_is_no_command_is_refused_and_the_session_goes_on() -> None:
    """A fault is typed by a person. The session ended, and with it what armed the browser."""

    async def scene(pendant: SimPendant, controller: Controller, said: Said) -> None:
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,fault,\x07',)), said)
        await until(lambda: said.all)
        ((text, done),) = said.all
        assert not done
        assert 'is not one command' in text
        await until(lambda: controller.count('Sim,condition') > 3)
        assert controller.count('Login,') == 1

    played(simulated(), scene)


@pytest.mark.invariant(9)
def test_a_pendant_that_fails_is_reported_at_once() -> None:
    """It was only said when the task was thrown away, and the page went on without a pendant."""
    told: list[Any] = []

    def fails(_why: str, _done: bool) -> None:
        raise ZeroDivisionError('made for this test')

    async def scene(pendant: SimPendant, _controller: Controller, _said: Said) -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: told.append(context['exception']))
        await until(lambda: pendant.latest)
        pendant.press(Action(('Sim,estop,press',)), fails)
        await until(lambda: told)
        assert isinstance(told[0], ZeroDivisionError)

    played(simulated(), scene)


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('fails', 'what'),
    [
        (lambda: 1 // 0, 'a pendant failed'),
        (sys.exit, 'the thread of the pendants ended'),
    ],
    ids=['a callback', 'the loop'],
)
def test_what_fails_in_the_thread_of_the_pendants_is_reported(
    fails: Callable[[], Any], what: str
) -> None:
    told: list[tuple[str, BaseException]] = []
    seen = threading.Event()

    def on_error(text: str, error: BaseException) -> None:
        told.append((text, error))
        seen.set()

    thread = PendantThread(lambda: 0.0, on_error)
    thread._loop.call_soon_threadsafe(fails)
    assert seen.wait(PATIENCE)
    assert [text for text, _ in told] == [what]
    thread.end()
