# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""first-run with nothing loaded (Remote Ethernet alone), and with our SPEL+ program."""

import base64

import numpy as np
import pytest
from first_run.test_first_run import User
from support.driver_harness import simulated
from support.event_loop import run as run_loop

from epson_driver.doctor.controller_checks import Question
from epson_driver.doctor.findings import Findings
from epson_driver.first_run.record import DONE, FAILED, FirstRunRecord, load
from epson_driver.first_run.run import CHOICES, go_through
from epson_driver.first_run.steps import NEED_PROGRAM, FirstRun, steps
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model

START = np.array([0.1, 0.2, -0.03, 0.4])
MODEL = load_robot_model('t6_602s')


class RemoteUser(User):
    """A user who releases the E-stop and closes the door, but neither resets nor enables."""

    def _recover(self):
        """Do nothing: first-run resets the controller and switches the motors on."""


def first_day(tmp_path, profile, user_type=User, only=None, prepare=None):
    """Run first-run at a simulated T6. Return the user and the record."""
    path = tmp_path / 'day.html'
    expected = load_controller_profile(profile)
    result = {}

    async def scenario():
        async with simulated(profile=expected, model='t6_602s', start=START) as (sim, ports):
            question = Question(
                host='127.0.0.1',
                profile=expected,
                model=MODEL,
                state_port=ports.state,
                motion_port=ports.motion,
                io_port=ports.io,
                remote_port=ports.remote,
                password='',
                seconds=5.0,
                may_ask=False,
                may_use_io=False,
            )
            remote = profile == 'remote'
            names = {step.name for step in steps(4, remote=remote)}
            user = user_type(sim, set() if only is None else names - set(only))
            if prepare is not None:
                prepare(sim)
            about = {'address': 'x', 'controller': profile, 'robot': 't6_602s', 'when': 'now'}
            run = FirstRun(question, user.ask, Findings(lambda finding: None))
            result['ended'] = await go_through(run, FirstRunRecord(about), path, user.see)
            result.update(user=user, joints=sim.joint_position().joints)

    run_loop(scenario(), 3000.0)
    return result['user'], load(path), result['joints']


def typed(user):
    """Answer with the positions of a SCARA, whose joint 3 is in mm."""
    true = user.true[:4] * (180.0 / np.pi, 180.0 / np.pi, 1000.0, 180.0 / np.pi)
    return ' '.join(f'{value:.3f}' for value in true)


class ScaraUser(RemoteUser):
    async def ask(self, sentence):
        if sentence.startswith('J1 J2'):
            return typed(self)
        return await super().ask(sentence)


def test_robot_with_nothing_loaded_completes_its_steps(tmp_path):
    _, book, joints = first_day(tmp_path, 'remote', ScaraUser)
    assert {name: item.why for name, item in book.entries.items() if item.state != DONE} == {}
    assert list(book.entries) == [step.name for step in steps(4, remote=True)]
    assert not set(book.entries) & set(NEED_PROGRAM)
    assert book.habits == []
    assert book.times.keys() >= {
        *(f'joint {number}: statement' for number in range(1, 5)),
        'STOP to rest',
        'E-stop: STATUS to rest',
        'door: STATUS to rest',
    }
    np.testing.assert_allclose(joints[1:4], START[1:], atol=1e-4)
    assert abs(joints[0] - START[0]) < np.radians(5.1)  # interrupted by the door
    sent = base64.b64decode(book.entries['joint 1'].trace)
    assert sent.count(b'$Execute,"Power Low; Speed ') == 2
    assert b'Login' not in sent  # the connection is the one of earlier steps


@pytest.mark.slow
def test_spel_program_serves_all_steps_by_one_connection_each(tmp_path, monkeypatch):
    opened = []
    from epson_driver.first_run import steps as module

    first = module.opened

    async def seen(host, port, **options):
        opened.append(port)
        return await first(host, port, **options)

    monkeypatch.setattr(module, 'opened', seen)
    only = ['listen', 'pendant', 'questions', 'ready', 'joint 1', 'joint 2']
    _, book, _ = first_day(tmp_path, 'spel', SpelUser, only)
    done = {name: item.why for name, item in book.entries.items() if name in only}
    assert done == dict.fromkeys(only, ''), book.habits
    assert len(opened) == 3  # state before and after the questions, motion after them


class SpelUser(ScaraUser):
    def _recover(self):
        User._recover(self)


@pytest.mark.invariant(1)
def test_inv1_remote_arm_does_not_move_and_motors_stay_off_without_agreement(tmp_path):
    class Refuses(ScaraUser):
        async def ask(self, sentence):
            if sentence.startswith('Make the cell safe'):
                self.asked.append((self.step, sentence))
                return 's'
            return await super().ask(sentence)

    user, book, joints = first_day(tmp_path, 'remote', Refuses, ['ready', 'joint 1'])
    assert {book.entries[name].state for name in ('ready', 'joint 1')} == {FAILED}
    assert not user.controller.condition.powered
    np.testing.assert_allclose(joints[:4], START, atol=1e-5)
    assert ('joint 1', CHOICES) not in user.asked or book.entries['joint 1'].why
