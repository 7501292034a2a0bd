# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings played to clients that do the same, something else, or the same at other times."""

import pytest
from support.link_harness import frame, joints

from epson_driver.link import WireEvent
from epson_driver.simple_message import LITTLE_ENDIAN, JointTrajPt, encode, request
from epson_driver.trace.player import Order, Player
from epson_driver.trace.recording import Step
from epson_driver.trace.script import Kind, ScriptError, make_script

HOST = '10.0.0.1'
MOTION, STATE = 0, 1
PORTS = {MOTION: 11000, STATE: 11002}
OPENED, SENT, RECEIVED = WireEvent.OPENED, WireEvent.SENT, WireEvent.RECEIVED


def point(sequence, angle=0.0):
    message = JointTrajPt(sequence, (angle, *[0.0] * 9))
    return encode(request(message), LITTLE_ENDIAN)


YES = frame(11, 3, 1)
NO = frame(11, 3, 2)


def recorded(*rows):
    """Return steps from (time, connection, event, data)."""
    return [
        Step(1e9 + time, number, (HOST, PORTS[number % 2]), event, *data)
        for time, number, event, *data in rows
    ]


def usual_run():
    """A state every 0.1 s from 0 to 2.9; points at 1.0 and 2.0 s with a reply 0.05 s later."""
    rows = [(0.0, STATE, OPENED), (0.0, MOTION, OPENED)]
    rows += [(0.02 + i / 10, STATE, RECEIVED, joints(float(i))) for i in range(30)]
    rows += [(1.0, MOTION, SENT, point(0)), (1.05, MOTION, RECEIVED, YES)]
    rows += [(2.0, MOTION, SENT, point(1)), (2.05, MOTION, RECEIVED, NO)]
    return recorded(*sorted(rows, key=lambda row: row[0]))


class Show:
    """A player with a clock that this test turns; both ports are connected at 0 s."""

    def __init__(self, steps, speed=1.0):
        self.told = []
        self.player = Player(make_script(steps), speed, self.told.append)
        self.now = 100.0
        self.orders = []
        self.numbers = {n: self.player.connect(PORTS[n], self.now) for n in (STATE, MOTION)}
        self.turn(0.0)

    def turn(self, seconds):
        """Let time pass as the program does; return what was ordered in it."""
        begin = len(self.orders)
        end = self.now + seconds
        for _ in range(10_000):
            self.orders += [(self.now, order) for order in self.player.advance(self.now)]
            pause = self.player.wait()
            if pause is None or self.now + pause > end or self.player.done:
                break
            self.now += max(pause, 1e-6)
        self.now = end
        return self.orders[begin:]

    def say(self, data, number=MOTION):
        self.player.receive(number, data)
        return self.turn(0.0)


def motion(orders):
    return [(time, order.data) for time, order in orders if order.connection == MOTION]


def states(orders):
    return [order.data for _, order in orders if order.connection == STATE]


def test_a_client_that_does_the_same_gets_the_same_at_the_same_time():
    show = Show(usual_run())
    assert states(show.turn(1.0)) == [joints(float(i)) for i in range(10)]
    show.say(point(0))
    assert motion(show.turn(1.0)) == [(pytest.approx(101.05), YES)]
    show.say(point(1))
    assert motion(show.turn(1.0)) == [(pytest.approx(102.05), NO)]
    assert states(show.orders) == [joints(float(i)) for i in range(30)]
    times = [time for time, order in show.orders if order.connection == STATE]
    assert times == pytest.approx([100.02 + i / 10 for i in range(30)], abs=1e-4)
    assert show.player.done
    score = show.player.finish()
    assert (score.same, score.alike, score.unknown, score.missing) == (2, 0, 0, 0)
    assert (score.sent, score.repeated, score.left_out) == (32, 0, 0)
    assert not show.told


def test_time_can_run_faster():
    show = Show(usual_run(), speed=2.0)
    assert len(states(show.turn(0.5))) == 10
    show.say(point(0))
    assert motion(show.turn(0.5)) == [(pytest.approx(100.525), YES)]


def test_a_late_client_is_waited_for_and_the_state_goes_on_standing():
    show = Show(usual_run())
    show.turn(1.0)
    waiting = show.turn(5.0)
    assert show.player.waits_for == 'a request on the motion port: JOINT_TRAJ_PT 0'
    assert set(states(waiting)) == {joints(9.0)}
    assert 48 <= len(waiting) <= 51  # at the recorded rate
    show.say(point(0))
    assert show.player.waits_for == ''
    after = show.turn(0.1)
    assert motion(after) == [(pytest.approx(106.05), YES)]
    assert states(after) == [joints(10.0)]
    assert show.player.score.repeated == len(waiting)


def test_an_early_client_is_not_kept_waiting():
    show = Show(usual_run())
    show.turn(0.3)
    assert states(show.say(point(0))) == [joints(9.0)]  # the newest before that moment
    assert motion(show.turn(0.06)) == [(pytest.approx(100.35), YES)]
    assert show.player.score.left_out == 6
    assert states(show.turn(0.1)) == [joints(11.0)]


def test_other_values_are_accepted_and_told():
    show = Show(usual_run())
    show.turn(1.0)
    show.say(point(0, angle=0.5))
    assert motion(show.turn(0.1))
    assert show.player.score.alike == 1
    assert show.told == ['JOINT_TRAJ_PT 0 was recorded with other values']


@pytest.mark.parametrize(
    ('data', 'name'),
    [
        (point(7), 'JOINT_TRAJ_PT 7'),
        (point(-4), 'JOINT_TRAJ_PT -4'),
        (frame(1, 2, body=bytes(40)), 'PING'),
        (frame(4711, 2), 'message type 4711'),
        (b'\xff' * 8, '8 bytes that are no message'),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_what_was_not_recorded_has_no_answer(data, name):
    show = Show(usual_run())
    show.turn(1.0)
    show.say(data)
    assert not motion(show.turn(3.0))
    assert show.told == [f'{name} was not recorded here (next is JOINT_TRAJ_PT 0): no answer']
    assert show.player.score.unknown == 1
    if name.startswith('JOINT'):
        show.say(point(0))
        assert motion(show.turn(0.1)), 'the recorded one is still awaited'


@pytest.mark.parametrize(('recorded_ones', 'sent'), [(3, 0), (0, 3), (2, 5)])
def test_heartbeats_are_the_clients_own_affair(recorded_ones, sent):
    heartbeat = frame(1, 1)
    steps = usual_run()
    beats = recorded(*((0.9, MOTION, SENT, heartbeat) for _ in range(recorded_ones)))
    show = Show(sorted([*steps, *beats], key=lambda step: step.time))
    show.turn(1.0)
    for _ in range(sent):
        show.say(heartbeat)
    show.say(point(0))
    assert motion(show.turn(1.0)) == [(pytest.approx(101.05), YES)]
    show.say(point(1))
    show.turn(1.0)
    score = show.player.finish()
    assert (score.same, score.unknown, score.missing) == (2, 0, 0)
    assert not show.told


def test_the_same_complaint_is_not_made_for_ever():
    show = Show(usual_run())
    for _ in range(50):
        show.say(point(7))
    assert len(show.told) == 3
    assert show.told[-1].endswith('(and so on)')
    assert show.player.score.unknown == 50


def test_a_client_that_leaves_misses_the_rest():
    show = Show(usual_run())
    show.turn(1.0)
    show.say(point(0))
    show.player.leave(MOTION)
    assert not motion(show.turn(1.5))
    assert len(states(show.orders)) == 25
    show.player.leave(STATE)
    assert show.player.done
    assert show.player.finish().missing == 1


def test_the_controllers_end_and_its_absence_are_played_too():
    rows = [(0.0, STATE, OPENED), (0.0, MOTION, OPENED), (0.1, STATE, RECEIVED, joints(1.0))]
    rows += [(0.2, STATE, RECEIVED, joints(2.0)[:30]), (0.3, STATE, WireEvent.ENDED)]
    rows += [(0.3, MOTION, WireEvent.RESET)]
    rows += [(5.0, 3, OPENED), (5.1, 3, RECEIVED, joints(3.0))]
    show = Show(recorded(*rows))
    orders = [order for _, order in show.turn(0.35)]
    assert orders == [
        Order(STATE, Kind.SEND, joints(1.0)),
        Order(STATE, Kind.SEND, joints(2.0)[:30]),  # as much as came of it
        Order(STATE, Kind.END),
        Order(MOTION, Kind.RESET),
    ]
    assert not show.player.plays(STATE)
    assert not show.player.done
    assert show.player.connect(PORTS[STATE], show.now) is None  # it is off
    show.turn(6.0)
    assert show.player.waits_for == 'a connection to the state port'
    assert show.player.connect(PORTS[MOTION], show.now) is None  # it did not come back
    assert show.player.connect(PORTS[STATE], show.now) == 3
    assert [order.data for _, order in show.turn(0.2)] == [joints(3.0)]
    assert show.player.done


def test_bytes_that_are_no_message_are_played_as_they_were():
    garbage = b'\xff' * 50
    rows = [(0.0, STATE, OPENED), (0.0, MOTION, OPENED), (0.1, STATE, RECEIVED, joints(1.0))]
    rows += [(0.2, STATE, RECEIVED, garbage), (0.3, STATE, RECEIVED, joints(2.0))]
    show = Show(recorded(*rows))
    assert states(show.turn(0.4)) == [joints(1.0), garbage, joints(2.0)]


def test_ports_are_known_by_what_they_carry():
    steps = usual_run()
    assert make_script(steps).ports == {'motion': 11000, 'state': 11002}
    odd = {11000: 50999, 11002: 50998}
    moved = [
        Step(step.time, step.number, (HOST, odd[step.server[1]]), step.event, step.data)
        for step in steps
    ]
    assert make_script(moved).ports == {'motion': 50999, 'state': 50998}
    quiet = [step for step in moved if step.number == STATE or step.event is OPENED]
    assert make_script(quiet).ports == {'motion': 50999, 'state': 50998}


def test_other_connections_are_left_out_and_one_controller_is_chosen():
    steps = usual_run()
    web = Step(steps[0].time, 7, ('10.0.0.9', 80), RECEIVED, b'HTTP/1.1 200 OK\r\n' * 5)
    assert make_script([*steps, web]).ports == {'motion': 11000, 'state': 11002}
    second = [Step(s.time, s.number + 8, ('10.0.0.2', 11002), s.event, s.data) for s in steps]
    with pytest.raises(ScriptError, match=r'10\.0\.0\.1, 10\.0\.0\.2 are in it'):
        make_script([*steps, *second])
    assert make_script([*steps, *second], HOST).ports == {'motion': 11000, 'state': 11002}
    with pytest.raises(ScriptError, match='no connection'):
        make_script([web])
    with pytest.raises(ScriptError, match='no connection'):
        make_script([])


def test_two_ports_that_carry_the_same_cannot_both_be_played():
    steps = usual_run()
    second = [
        Step(s.time, s.number + 8, (HOST, 50000), s.event, s.data)
        for s in steps
        if s.number == STATE
    ]
    with pytest.raises(ScriptError) as refused:
        make_script([*steps, *second])
    said = 'two ports of the same kind are in it: 11000 (motion), 11002 (state), 50000 (state)'
    assert str(refused.value) == said


def test_nothing_is_due_before_the_first_client_has_come():
    player = Player(make_script(usual_run()), 1.0, print)
    assert player.advance(100.0) == []
    assert player.connect(PORTS[STATE], 200.0) == STATE
    assert player.advance(200.0) == []
