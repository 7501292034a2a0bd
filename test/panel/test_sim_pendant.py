# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's pendant for a simulated controller. It must not act on a real one.

The controller is a scripted remote port. Time is virtual.
"""

import asyncio
import contextlib
import sys
import threading

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

BAD = f'!Sim,{RemoteErrorNumber.BAD_COMMAND.value}'
ESTOP, PAUSE = Action(('Sim,estop,press',)), Action(('Pause',))


class Simulated(RemotePeer):
    """A remote port announced as simulated, with usual and special answers."""

    def __init__(self, special):
        usual = {
            'Sim,joints': '#Sim,0',
            'Logout': '#Logout,0',
            'Sim,condition': '#Sim,estop=not active;door=closed',
            'Sim,fault,list': '#Sim,cut;;late',
            'Sim,estop,press': '#Sim,0',
            'Pause': '#Pause,0',
        }
        super().__init__(**usual | special)

    async def __aenter__(self):
        await super().__aenter__()
        self.announcement = announce('127.0.0.1', self.port)
        return self

    async def __aexit__(self, *_):
        await accepted()
        self.announcement.close()
        await super().__aexit__()

    def count(self, command):
        """Return how many times a command was received."""
        return self.lines.count(f'${command}')

    async def still_polled(self):
        """Assert that polling continues on the same connection."""
        polls = self.count('Sim,condition')
        await until(lambda: self.count('Sim,condition') > polls + 1)
        assert self.count('Sim,joints') == 1


class Presses(list):
    """The results of presses: a text, and whether it was carried out."""

    def __call__(self, why, done):
        self.append((why, done))


@contextlib.asynccontextmanager
async def played(special=()):
    """Run a pendant at a controller with special answers."""
    async with Simulated(dict(special)) as controller:
        pendant = SimPendant(asyncio.get_running_loop(), '127.0.0.1', controller.port, now)
        await asyncio.sleep(0)
        task = pendant._task
        yield pendant, controller
        pendant.end()
        await asyncio.wait([task])


async def pressed(pendant, action):
    """Press a button and return the result."""
    results = Presses()
    await until(lambda: pendant.latest)
    pendant.press(action, results)
    await until(lambda: results)
    return results[0]


async def test_pendant_polls_the_condition_and_performs_a_button_press():
    async with played() as (pendant, controller):
        assert await pressed(pendant, ESTOP) == ('', True)
        await controller.still_polled()
        simulation, at = pendant.latest
        assert simulation.condition == {'estop': 'not active', 'door': 'closed'}
        assert simulation.faults == ('cut', 'late')
        assert now() - at < 1.0


@pytest.mark.invariant(1)
async def test_real_controller_is_queried_only_once():
    """It serves one remote client, which should be the driver."""
    async with played({'Sim,condition': BAD}) as (pendant, controller):
        await until(lambda: pendant.real)
        await asyncio.sleep(30.0)
        assert controller.lines == ['$Sim,joints', '$Sim,condition']
        with pytest.raises(NotSimulatedError, match='no reply from a simulated controller'):
            pendant.press(Action(('SetMotorsOn,1',)), print)


@pytest.mark.invariant(1)
async def test_port_that_is_not_announced_gets_no_connection():
    """It may lead to a real controller, whose only client is the driver."""
    async with played() as (pendant, controller):
        await until(lambda: pendant.latest)
        controller.announcement.close()
        await asyncio.sleep(1.0)
        known = SimPendant(asyncio.get_running_loop(), '127.0.0.1', controller.port, now)
        await asyncio.sleep(10.0)
        assert controller.count('Sim,joints') == 1
        assert (known.latest, known.real) == (None, False)
        known.end()


async def test_press_that_needs_a_login_gets_its_own_connection():
    async with played() as (pendant, controller):
        assert await pressed(pendant, PAUSE) == ('', True)
        start = controller.lines.index('$Login,')
        assert controller.lines[start : start + 3] == ['$Login,', '$Pause', '$Logout']
        await controller.still_polled()


async def test_press_that_needs_a_login_is_refused_by_a_controller_with_one_client():
    async with played({'Login': ConnectionError}) as (pendant, controller):
        assert await pressed(pendant, PAUSE) == (ONE_CLIENT, False)
        assert controller.count('Login,') == 1
        await controller.still_polled()


@pytest.mark.invariant(1)
@pytest.mark.parametrize('answer', ['!Sim,99', '#Sim,what?', ConnectionError, None])
async def test_controller_without_condition_is_not_simulated_and_polled_again(answer):
    async with played({'Sim,condition': answer}) as (pendant, controller):
        await until(lambda: controller.count('Sim,condition') > 2)
        assert (pendant.latest, pendant.real) == (None, False)
        with pytest.raises(NotSimulatedError):
            pendant.press(ESTOP, print)


@pytest.mark.parametrize(
    ('why', 'message'),
    [('#Sim,the key is at MANUAL', 'the key is at MANUAL'), (BAD, 'Sim,estop,press: ')],
)
async def test_refused_press_returns_the_reason(why, message):
    async with played({'Sim,estop,press': '!Sim,20', 'Sim,why': why}) as (pendant, controller):
        text, done = await pressed(pendant, ESTOP)
        assert not done
        assert text.startswith(message)
        await controller.still_polled()


@pytest.mark.parametrize('answer', [ConnectionError, None], ids=['disconnects', 'silent'])
async def test_unanswered_press_and_pending_presses_fail(answer):
    async with played({'Sim,estop,press': answer}) as (pendant, controller):
        await until(lambda: pendant.latest)
        results, start = Presses(), now()
        pendant.press(ESTOP, results)
        pendant.press(Action(('Reset',)), results)
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
async def test_press_during_a_disconnect_is_not_repeated_after_it():
    """A queued command of the old session would switch the motors on seconds after the click."""
    once = [ConnectionError, *['#Sim,'] * 99]
    async with played({'Sim,fault,list': once}) as (pendant, controller):
        await until(lambda: controller.count('Sim,fault,list') == 1)
        await asyncio.sleep(0.1)
        results = Presses()
        pendant._commands.put_nowait((Action(('SetMotorsOn,1',)), results))  # of another thread
        await until(lambda: controller.count('Sim,joints') == 2 and pendant.latest)
        assert results == [('SetMotorsOn,1: no reply from a simulated controller', False)]
        assert controller.count('SetMotorsOn,1') == 0


@pytest.mark.invariant(7)
async def test_text_of_two_commands_is_not_sent_and_the_session_continues():
    async with played() as (pendant, controller):
        text, _ = await pressed(pendant, Action(('Sim,fault,a\r\n$SetMotorsOn,1',)))
        assert 'must be one command' in text
        await controller.still_polled()


@pytest.mark.invariant(9)
async def test_failed_pendant_is_reported_immediately():
    """asyncio reports a failed task only when it is deleted."""
    reported = []
    async with played() as (pendant, _):
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: reported.append(context['exception']))
        await until(lambda: pendant.latest)
        pendant.press(ESTOP, lambda _why, _done: 1 // 0)
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
def test_failure_in_the_pendant_thread_is_reported(fails, what):
    reported = []
    seen = threading.Event()

    def on_error(text, error):
        reported.append((text, error))
        seen.set()

    thread = PendantThread(lambda: 0.0, on_error)
    thread._loop.call_soon_threadsafe(fails)
    assert seen.wait(PATIENCE)
    assert [text for text, _ in reported] == [what]
    thread.end()
