# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""first-run with simulated controllers that have one peculiarity each, in virtual time."""

import asyncio
import contextlib
import dataclasses
import math
import os
import pty
import sys
from pathlib import Path

import numpy as np
import pytest
from support.driver_harness import MODEL, simulated
from support.event_loop import run as run_loop
from support.examples import quickly

from epson_driver.cli.first_run import _Keyboard
from epson_driver.doctor.controller_checks import Question
from epson_driver.doctor.findings import Findings
from epson_driver.first_run.record import (
    DONE,
    FAILED,
    SKIPPED,
    Entry,
    FirstRunRecord,
    load,
    replica_settings,
)
from epson_driver.first_run.run import CHOICES, go_through
from epson_driver.first_run.steps import FirstRun, StepResult, steps
from epson_driver.inputs import InputError
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.simple_message import (
    BIG_ENDIAN,
    Framer,
    JointPosition,
    JointTrajPt,
    Ping,
    SpecialSequence,
    Status,
    decode,
    encode,
)

SIMULATED = load_controller_profile('simulated')
START = (0.1, 0.2, -0.3, 0.4, -0.5, 0.6)
STOP = SpecialSequence.STOP_TRAJECTORY


def changed(**sections):
    """Return the profile `simulated` with changed values."""
    parts = {
        name: dataclasses.replace(getattr(SIMULATED, name), **values)
        for name, values in sections.items()
    }
    return dataclasses.replace(SIMULATED, **parts)


class Proxy:
    """A proxy port that changes messages from the controller (`down`) and to it (`up`)."""

    def __init__(self, port, down=lambda message: message, up=lambda message: message):
        self._port, self._down, self._up = port, down, up
        self._tasks = set()

    async def __aenter__(self):
        def accept(reader, writer):
            self._tasks.add(asyncio.create_task(self._attend(reader, writer)))

        self._server = await asyncio.start_server(accept, '127.0.0.1', 0)
        return self._server.sockets[0].getsockname()[1]

    async def __aexit__(self, *_):
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _attend(self, reader, writer):
        theirs, ours = await asyncio.open_connection('127.0.0.1', self._port)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._pass_on(reader, ours, self._up))
                group.create_task(self._pass_on(theirs, writer, self._down))
        except* ConnectionError:
            pass
        finally:
            ours.close()
            writer.close()

    async def _pass_on(self, source, sink, change):
        framer = Framer()
        while data := await source.read(65536):
            framer.receive_data(data)
            while (frame := framer.next_frame()) is not None:
                packet = decode(frame)
                new = packet._replace(message=change(packet.message))
                sink.write(encode(new, packet.dialect))
        sink.close()


def joints_as(change):
    """Return a function that changes the joints of a message, shape (10,), rad."""

    def changed_message(message):
        if isinstance(message, JointPosition | JointTrajPt):
            new = change(np.array(message.joints))
            return dataclasses.replace(message, joints=tuple(map(float, new)))
        return message

    return changed_message


def third_turned(joints):
    return joints * np.where(np.arange(10) == 2, -1.0, 1.0)


def rounded(joints):
    return np.radians(np.round(np.degrees(joints), 2))


def other_number(message):
    if isinstance(message, Status) and message.error_code:
        return dataclasses.replace(message, error_code=7777)
    return message


def stop_lost(message):
    """Return a PING instead of a STOP."""
    return Ping() if getattr(message, 'sequence', None) == STOP else message


def stop_confirmed(message):
    """Return the reply to a STOP instead of the reply to a PING."""
    return JointPosition(STOP) if isinstance(message, Ping) else message


class User:
    """Acts at a simulated controller as requested, and answers according to its real motion."""

    def __init__(self, controller, skips=()):
        self.controller = controller
        self.skips = skips
        self.step = ''
        self.asked = []
        self.true = np.array(controller.joint_position().joints)

    def see(self, text):
        """Record the announced step."""
        self.step = text.partition(':')[0]

    async def ask(self, sentence):
        self.asked.append((self.step, sentence))
        controller = self.controller
        if sentence == CHOICES:
            self.true = np.array(controller.joint_position().joints)
            return 's' if self.step in self.skips else ''
        if sentence.startswith('J1 J2'):
            return ' '.join(f'{math.degrees(item):.3f}' for item in self.true[:6])
        if sentence.startswith('Set the power LOW'):
            self._recover()
        elif sentence.startswith('Release it'):
            controller.apply(Event.ESTOP_RELEASE)
            self._recover()
        elif sentence.startswith('Close it'):
            controller.apply(Event.DOOR_CLOSE)
            self._recover()
        elif 'press the E-stop NOW' in sentence:
            await asyncio.sleep(1.0)
            controller.press_estop()
        elif 'open the safeguard NOW' in sentence:
            await asyncio.sleep(1.0)
            controller.apply(Event.DOOR_OPEN)
        elif 'pull the network cable' in sentence:
            await asyncio.sleep(1.0)
            controller.faults.start(parse('cut:for=2'))
            await asyncio.sleep(6.0)
        return 'y'

    def _recover(self):
        for event in (Event.CONTINUE, Event.RESET, Event.MOTORS_ON, Event.START):
            with contextlib.suppress(Exception):
                self.controller.apply(event)


def first_day(
    tmp_path, profile=SIMULATED, *, smooth=True, faults=(), between=None, only=None, **options
):
    """Run first-run at a simulated controller. Return the record, the user and the findings."""
    path = Path(tmp_path, f'{profile.name}_{len(list(tmp_path.iterdir()))}.html')
    findings = Findings(lambda finding: None)
    made = {}

    async def scenario():
        arguments = {'profile': profile, 'smooth': smooth, 'start': np.array(START)} | options
        async with (
            simulated(**arguments) as (controller, ports),
            contextlib.AsyncExitStack() as stack,
        ):
            for fault in faults:
                controller.faults.start(parse(fault) if isinstance(fault, str) else fault)
            state, motion = ports.state, ports.motion
            if between is not None:
                state = await stack.enter_async_context(Proxy(state, *between))
                motion = await stack.enter_async_context(Proxy(motion, *between))
            question = Question(
                host='127.0.0.1',
                profile=SIMULATED,
                model=MODEL,
                state_port=state,
                motion_port=motion,
                io_port=ports.io,
                remote_port=0,
                password='',
                seconds=5.0,
                may_ask=False,
                may_use_io=False,
            )
            names = [step.name for step in steps(6)]
            skips = () if only is None else set(names) - set(only)
            user = User(controller, skips)
            about = {'address': '127.0.0.1', 'controller': 'simulated', 'robot': 'c3_a601s'}
            book = FirstRunRecord(about | {'when': 'in a test'})
            run = FirstRun(question, user.ask, findings)
            made['ended'] = await go_through(run, book, path, user.see)
            made.update(user=user, book=load(path), path=path)

    run_loop(scenario(), 3000.0)
    return made | {'findings': findings}


@pytest.mark.slow
def test_normal_controller_completes_every_step(tmp_path):
    made = first_day(tmp_path)
    book = made['book']
    assert made['ended']
    assert {name: item.why for name, item in book.entries.items() if item.state != DONE} == {}
    assert book.habits == []
    assert list(book.entries) == [step.name for step in steps(6)]


HABITS = [
    (['listen'], {'between': (joints_as(rounded),)}, 'joint states are rounded to 0.01 degrees'),
    (['listen'], {'dialect': BIG_ENDIAN}, 'byte_order is big'),
    (['listen'], {'profile': changed(state={'period': 0.02})}, '0.005 in the profile simulated'),
    (
        ['pendant'],
        {'between': (joints_as(third_turned), joints_as(third_turned))},
        'joint_3 has the opposite sign',
    ),
    (['questions'], {'faults': ['delay:seconds=0.1,port=motion']}, 'replies are 100 ms late'),
    (['questions'], {'faults': ['lost_reply:count=1,skip=5']}, '1 of 5 requests had no reply'),
    (['E-stop'], {'between': (other_number,)}, 'error number 7777 is not in the table'),
    (
        ['points'],
        {'profile': changed(motion={'look_ahead_points': 5})},
        'motion.look_ahead_points is 5',
    ),
    (['points'], {'smooth': False}, 'the arm stops at points'),
    (['STOP'], {'between': (stop_confirmed, stop_lost)}, 'a STOP does not stop the arm'),
    (
        ['cable'],
        {'profile': changed(server={'lost_client': 'finish'})},
        'the arm continues to its point',
    ),
]
"""Peculiarities: the step that detects each, the controller, and its text."""

LONG = (['points'], ['STOP'])
"""Slow steps."""


@pytest.mark.parametrize(
    ('only', 'options', 'habit'),
    quickly([item for item in HABITS if item[0] not in LONG][::3], HABITS),
    ids=[item[2] for item in HABITS],
)
def test_peculiarity_of_a_controller_is_detected(tmp_path, only, options, habit):
    book = first_day(tmp_path, only=only, **options)['book']
    entries = {name: (element.state, element.why) for name, element in book.entries.items()}
    assert [item for item in book.habits if habit in item], (book.habits, entries)


def simpler(**sections):
    """Return `changed` with a slower state stream and fewer clients, to save test time."""
    return changed(
        state={'period': 0.01}, server={'state_clients': 2, 'client_timeout': 0.0}, **sections
    )


TIMED = ['listen', 'questions', 'joint 1', 'STOP', 'points', 'E-stop', 'door']


@pytest.mark.slow
@pytest.mark.parametrize(
    'options',
    [
        {},
        pytest.param(
            {'profile': simpler(motion={'look_ahead_points': 5})}, marks=pytest.mark.soak
        ),
        pytest.param({'profile': simpler(motion={'look_ahead': 0.3})}, marks=pytest.mark.soak),
        pytest.param({'smooth': False}, marks=pytest.mark.soak),
        # not a multiple of the 4 ms cycle, so that the arrival within a cycle is deterministic
        pytest.param({'faults': ['delay:seconds=0.102,port=motion']}, marks=pytest.mark.soak),
        {'faults': ['delay:seconds=0.06,port=state']},
    ],
    ids=['usual', 'points ahead', 'time ahead', 'rests', 'late replies', 'late state'],
)
def test_simulation_from_the_record_has_the_same_times(tmp_path, options):
    """All measured times agree within 5 %."""
    book = first_day(tmp_path, only=TIMED, **{'profile': simpler()} | options)['book']
    alike = replica_settings(book)
    again = first_day(
        tmp_path,
        alike.profile,
        smooth=alike.motion == 'smooth',
        faults=alike.faults,
        only=TIMED,
    )['book']
    assert book.times.keys() == again.times.keys()
    assert again.times == pytest.approx(book.times, rel=0.05, abs=1e-4)


def test_interrupted_session_can_be_resumed(tmp_path):
    path = tmp_path / 'day.html'
    answers = iter(['s', 'q'])
    output = []

    async def user(_sentence):
        return next(answers)

    async def scenario(book):
        run = FirstRun(None, user, Findings(lambda finding: None))
        monkeyed = dataclasses.replace(run, question=NOBODY)
        return await go_through(monkeyed, book, path, output.append)

    book = FirstRunRecord(
        {'address': 'x', 'controller': 'simulated', 'robot': 'c3_a601s', 'when': 'now'}
    )
    ended = []

    async def once():
        ended.append(await scenario(book))

    run_loop(once(), 60.0)
    assert ended == [False]
    kept = load(path)
    assert [(name, item.state) for name, item in kept.entries.items()] == [('listen', SKIPPED)]
    kept.entries['listen'].state = DONE
    kept.save(path)
    output.clear()
    answers = iter(['q'])

    async def again():
        run = FirstRun(NOBODY, user, Findings(lambda finding: None))
        ended.append(await go_through(run, load(path), path, output.append))

    run_loop(again(), 60.0)
    assert output[0].startswith('listen: done')
    assert output[1].startswith('pendant: ')


NOBODY = Question(
    host='127.0.0.1',
    profile=SIMULATED,
    model=MODEL,
    state_port=1,
    motion_port=1,
    io_port=1,
    remote_port=0,
    password='',
    seconds=1.0,
    may_ask=False,
    may_use_io=False,
)


def test_step_without_a_controller_fails_with_the_reason(tmp_path):
    path = tmp_path / 'day.html'
    book = FirstRunRecord(
        {'address': 'x', 'controller': 'simulated', 'robot': 'c3_a601s', 'when': 'now'}
    )
    findings = Findings(lambda finding: None)

    async def user(sentence):
        return '' if sentence == CHOICES else 's'

    async def scenario():
        await go_through(FirstRun(NOBODY, user, findings), book, path, lambda text: None)

    run_loop(scenario(), 60.0)
    assert load(path).entries['joint 1'].state == FAILED
    assert 'refused' in load(path).entries['joint 1'].why


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'text', ['', 'x' * 1000, '<script type="application/json" id="first-run">[]</script>']
)
def test_file_of_another_program_is_refused(tmp_path, text):
    path = tmp_path / 'x.html'
    path.write_text(text)
    with pytest.raises(
        InputError, match=r'x\.html: must be a file written by `epson_driver first_run`: '
    ):
        load(path)


def test_texts_are_escaped_on_the_page(tmp_path):
    path = tmp_path / 'x.html'
    evil = '<script>alert(1)</script><img src=x onerror=alert(2)>'
    about = {'address': evil, 'controller': 'simulated', 'robot': evil, 'when': evil}
    book = FirstRunRecord(
        about, {evil: Entry(DONE, evil, StepResult({}, {evil: 1.0}, {evil: evil}, [evil]), evil)}
    )
    book.save(path)
    page = path.read_text()
    assert page.count('<script') == 1
    assert '<img' not in page
    assert load(path) == book
    book.entries[evil].trace = f'"{evil}'
    book.save(path)
    assert '<img' not in path.read_text()
    with pytest.raises(InputError, match='must be a file written by `epson_driver first_run`: '):
        load(path)


def test_estop_that_was_not_pressed_in_time_is_offered_again(tmp_path, monkeypatch):
    answer = User.ask

    async def answer_late(user, sentence):
        if 'press the E-stop' in sentence:
            user.asked.append((user.step, sentence))
            return 'n'
        return await answer(user, sentence)

    monkeypatch.setattr(User, 'ask', answer_late)
    monkeypatch.setattr('epson_driver.first_run.steps.BACK_AND_FORTH', 2)
    book = first_day(tmp_path, only=['E-stop'])['book']
    assert book.entries['E-stop'].why == 'there was no E-stop during the motion'
    assert book.habits == []


def test_measured_stop_is_kept_if_the_arm_is_not_made_ready_afterwards(tmp_path, monkeypatch):
    answer = User.ask

    async def skip_release(user, sentence):
        return 's' if sentence.startswith('Release it') else await answer(user, sentence)

    monkeypatch.setattr(User, 'ask', skip_release)
    book = first_day(tmp_path, only=['E-stop'])['book']
    assert book.entries['E-stop'].state == DONE
    assert 'E-stop: STATUS to rest' in book.times
    assert book.habits == [
        'E-stop: not checked whether the arm resumes its motion: the arm was not made ready'
    ]


@pytest.mark.invariant(1)
def test_inv1_only_enter_or_y_moves_the_arm(tmp_path, monkeypatch):
    answer = User.ask

    async def answer_other(user, sentence):
        asked = user.asked.count((user.step, sentence))
        if (sentence == CHOICES and user.step == 'joint 1') or sentence.startswith('Set the'):
            user.asked.append((user.step, sentence))
            if sentence != CHOICES:
                user._recover()
            return ['n', 'no', 'exit', 'wait', '12.5', 'yx', ' N ', 's'][asked]
        return await answer(user, sentence)

    monkeypatch.setattr(User, 'ask', answer_other)
    made = first_day(tmp_path, only=['joint 1', 'joint 2'])
    user, entries = made['user'], made['book'].entries
    assert user.asked.count(('joint 1', CHOICES)) == 8
    assert entries['joint 1'].state == SKIPPED
    assert sum(sentence.startswith('Set the') for _, sentence in user.asked) == 8
    assert entries['joint 2'].why == 'the arm was not made ready'
    np.testing.assert_allclose(user.controller.joint_position().joints[:6], START, atol=1e-5)


def test_step_fails_if_the_arm_is_not_made_ready(tmp_path, monkeypatch):
    answer = User.ask

    async def only_enter(user, sentence):
        if sentence.startswith('Set the'):
            user.asked.append((user.step, sentence))
            return ''
        return await answer(user, sentence)

    monkeypatch.setattr(User, 'ask', only_enter)
    made = first_day(tmp_path, only=['joint 1'])
    why = 'the arm was not made ready in 3 tries: the motors are off'
    assert made['book'].entries['joint 1'].why == why
    assert sum(sentence.startswith('Set the') for _, sentence in made['user'].asked) == 3


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('question', 'answers'), [('Is the power low', ['maybe', 'n']), (CHOICES, ['q'])]
)
def test_inv1_without_low_power_the_session_ends(tmp_path, monkeypatch, question, answers):
    answer = User.ask

    async def answer_once(user, sentence):
        if user.step == 'ready' and sentence.startswith(question):
            return answers.pop(0)
        return await answer(user, sentence)

    monkeypatch.setattr(User, 'ask', answer_once)
    made = first_day(tmp_path, only=['ready', 'joint 1'])
    assert not made['ended']
    assert answers == []
    assert not {'ready', 'joint 1'} & made['book'].entries.keys()


@pytest.mark.invariant(1)
def test_inv1_input_before_the_question_is_discarded(monkeypatch):
    terminal, end = pty.openpty()
    monkeypatch.setattr('builtins.print', lambda *_, **__: os.write(terminal, b's\n'))
    with os.fdopen(end) as keys:
        monkeypatch.setattr(sys, 'stdin', keys)
        os.write(terminal, b'y\n\n')
        assert asyncio.run(_Keyboard().ask('Move?')) == 's'
    os.close(terminal)


@pytest.mark.invariant(1)
def test_every_moving_step_warns_before_it_starts(tmp_path):
    moving = [step for step in steps(6) if step.moves]
    assert [item.name for item in moving] == [
        *(f'joint {number}' for number in range(1, 7)),
        'STOP',
        'points',
        'E-stop',
        'door',
        'cable',
    ]
    assert all('THE ARM MOVES' in item.says for item in moving)
    assert not [step for step in steps(6) if 'MOVES' in step.says and not step.moves]
