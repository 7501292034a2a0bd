# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of a smooth motion, one per control cycle."""

import numpy as np
import pytest
from support.rtmc_cell import usage

from epson_driver.robots import load_robot_model
from epson_driver.rtmc.feeder import AHEAD_S, Feeder
from epson_driver.rtmc.messages import MOVED_DATA, TARGET_DATA, Request, RtmcMessage, decode
from epson_driver.rtmc.session import RtmcSession
from simulation.dds_bus import VirtualTransport

LIMITS = load_robot_model('c8_c901s').limits
CYCLE = 0.002
ROUNDING = 1.0 + 1e-6


MOVED = RtmcMessage(Request.MOVE, 0, 1, MOVED_DATA.pack(1, *[0.0] * 6, 0)).encode()


class Controller:
    """A controller that takes one target per call, and the ring of its client."""

    def __init__(self):
        self.sent = []
        self.transport = VirtualTransport(lambda data: self.sent.append(decode(data)) or 1)
        self.ring = RtmcSession(self.transport, LIMITS.units, None, None, None)
        self.ring.start(np.zeros(6))

    def next_target(self, *, read=True):
        self.transport.receive(MOVED)
        while read and self.transport.take() is not None:
            pass
        return np.array(self.sent[-1].values(TARGET_DATA)[:6])


@pytest.fixture
def controller():
    result = Controller()
    yield result
    result.transport.close()


def feeder(
    controller,
    points=((0.9, 0.4), (0.2, -0.4), (0.5, 0.3)),
    duration=0.4,
    rate=lambda: 1.0,
):
    result = Feeder(LIMITS, np.zeros(6), CYCLE, controller.ring, rate)
    for index, point in enumerate(points):
        result.append(np.array([*point, 0.0, 0.0, 0.0, 0.0]), duration, starts=index == 0)
    return result


def taken(source, controller, count):
    """Return `count` targets of a motion that the event loop keeps sampling."""
    result = [np.zeros(6)]
    for _ in range(count):
        source.fill()
        result.append(controller.next_target())
    return result


def until_rest(source, controller):
    result = []
    while not source.at_rest:
        result.append(controller.next_target())
    return [*result, *(controller.next_target() for _ in range(5))]


@pytest.mark.invariant(2)
def test_inv2_motion_ends_at_its_last_point_within_the_limits(controller):
    source = feeder(controller)
    targets = taken(source, controller, 3000)
    assert targets[-1][:2] == pytest.approx([0.5, 0.3])
    assert source.at_rest
    assert not source.failed
    assert max(usage(targets, LIMITS)) <= ROUNDING


@pytest.mark.invariant(3)
@pytest.mark.parametrize('count', [1, 5, 20, 60, 100, 150, 170, 200, 260, 330, 400, 500])
def test_inv3_stop_at_any_target_respects_the_limits(controller, count):
    source = feeder(controller)
    targets = taken(source, controller, count)
    source.stop()
    targets += until_rest(source, controller)
    assert max(usage(targets, LIMITS)) <= ROUNDING
    assert np.array_equal(targets[-1], targets[-2])
    assert not source.failed


@pytest.mark.invariant(3)
@pytest.mark.parametrize('count', [5, 60, 150, 260])
@pytest.mark.parametrize('meanwhile', [1, 3, 20, 80, 200])
def test_inv3_stop_is_exact_whatever_the_thread_takes_meanwhile(controller, count, meanwhile):
    source = feeder(controller)
    targets = taken(source, controller, count)
    replace, held_up = controller.ring.replace, [meanwhile]

    def late(*arguments):
        for _ in range(held_up.pop() if held_up else 0):
            targets.append(controller.next_target())
        return replace(*arguments)

    controller.ring.replace = late
    source.stop()
    assert not held_up
    source.stop()
    source.fill()
    targets += until_rest(source, controller)
    assert max(usage(targets, LIMITS)) <= ROUNDING
    assert np.array_equal(targets[-1], targets[-2])


@pytest.mark.invariant(2, 10)
@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('stopped', [False, True])
def test_inv2_rate_may_change_at_any_target_of_a_fast_motion(controller, seed, stopped):
    rng, rates = np.random.default_rng(seed), [1.0]
    points = np.clip(np.cumsum(rng.uniform(-0.4, 0.4, (40, 2)), axis=0), -1.0, 1.0)
    source = feeder(controller, points, duration=0.1, rate=lambda: rates[-1])
    replace = controller.ring.replace

    def late(*arguments):
        targets.extend(controller.next_target() for _ in range(rng.integers(4)))
        return replace(*arguments)

    controller.ring.replace = late
    targets, reached = [np.zeros(6)], 0
    while not source.at_rest and not (stopped and len(targets) > 1500):
        source.fill()
        if rng.random() < 0.1:
            rates.append(rng.choice([0.05, 0.3, 0.7, 1.0]))
        targets += [controller.next_target() for _ in range(5)]
        reached += rates[-1] < 1.0 and source.rate == rates[-1]
    source.stop()
    targets += until_rest(source, controller)
    assert max(usage(targets, LIMITS)) <= ROUNDING
    assert reached > 20
    assert not source.failed
    assert stopped or targets[-1][:2] == pytest.approx(points[-1])


@pytest.mark.invariant(9)
@pytest.mark.parametrize('count', [5, 60, 150, 260, 400])
def test_inv9_event_loop_that_hangs_stops_the_arm_within_the_limits(controller, count):
    source = feeder(controller)
    targets = taken(source, controller, count)
    targets += until_rest_without_filling(controller)
    source.fill()
    assert 'delayed' in source.failed
    assert source.at_rest
    assert not source.has_room
    targets += until_rest(source, controller)
    assert max(usage(targets, LIMITS)) <= ROUNDING


def until_rest_without_filling(controller):
    targets = [controller.next_target() for _ in range(2)]
    while not np.array_equal(*targets[-2:]):
        targets.append(controller.next_target())
    assert len(targets) * CYCLE < AHEAD_S + 0.5
    return targets


@pytest.mark.invariant(9)
@pytest.mark.parametrize('late', [50, 60, 70, 80, 90, 120])
def test_inv9_late_filling_continues_or_brakes_within_the_limits(controller, late):
    source = feeder(controller)
    targets = taken(source, controller, 100)
    ahead = source._planned - controller.ring.taken
    targets += [controller.next_target() for _ in range(late)]
    targets += taken(source, controller, 3000)[1:]
    assert bool(source.failed) == (late > ahead)
    assert max(usage(targets, LIMITS)) <= ROUNDING
    assert np.array_equal(targets[-1], targets[-2])


@pytest.mark.invariant(9)
def test_inv9_replies_that_are_not_read_in_time_stop_the_arm_within_the_limits(controller):
    source = feeder(controller, points=((0.0, 0.4), (2.0, 0.0)), duration=4.0)
    targets = [np.zeros(6)]
    while not source.at_rest:
        source.fill()
        targets.append(controller.next_target(read=False))
    assert 'delayed' in source.failed
    assert 1024 < len(targets) < 1800
    assert np.linalg.norm(np.diff(targets[1000:1002], axis=0)) > 1e-4
    targets += until_rest(source, controller)
    assert max(usage(targets, LIMITS)) <= ROUNDING


def test_arm_at_rest_repeats_its_position(controller):
    source = feeder(controller, points=())
    source.fill()
    assert source.at_rest
    assert not controller.next_target().any()
    source.stop()
    assert not controller.next_target().any()
    assert not source.failed
