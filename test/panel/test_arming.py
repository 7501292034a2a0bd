# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Who may move the robot from the panel, and until when."""

import threading

import pytest

from epson_driver.panel.arming import Arming, NotArmedError


class Rules:
    def __init__(self) -> None:
        self.why: str | None = None
        self.ended: list[str] = []
        self.arming = Arming(lambda: self.why, self.ended.append)
        self.arming.connect(1)
        self.arming.connect(2)

    def may(self, browser: int) -> bool:
        try:
            with self.arming.held(browser):
                return True
        except NotArmedError:
            return False


@pytest.mark.invariant(1)
def test_nobody_is_armed_until_somebody_asks_for_it() -> None:
    rules = Rules()
    assert not rules.may(1)
    rules.arming.arm(1)
    assert rules.may(1)
    assert not rules.may(2)


@pytest.mark.invariant(1)
def test_a_second_window_is_not_armed_beside_the_first_but_may_disarm_it() -> None:
    rules = Rules()
    rules.arming.arm(1)
    with pytest.raises(NotArmedError, match='another window'):
        rules.arming.arm(2)
    assert rules.may(1)
    assert not rules.arming.disarm('not its own', 2)
    assert rules.arming.disarm('stop')
    rules.arming.arm(2)
    assert rules.may(2)
    assert not rules.may(1)


@pytest.mark.invariant(4)
def test_a_window_that_is_gone_is_disarmed_and_its_late_clicks_do_nothing() -> None:
    rules = Rules()
    rules.arming.arm(1)
    rules.arming.disconnect(1)
    assert rules.ended == ['the armed window of the panel is gone']
    assert not rules.may(1)
    with pytest.raises(NotArmedError, match='not connected'):
        rules.arming.arm(1)
    rules.arming.disconnect(2)
    assert len(rules.ended) == 1


@pytest.mark.invariant(4)
def test_what_is_not_seen_any_more_disarms_and_does_not_arm_again_by_itself() -> None:
    rules = Rules()
    rules.arming.arm(1)
    rules.why = 'no joint states'
    assert not rules.may(1)
    assert rules.ended == ['no joint states']
    with pytest.raises(NotArmedError, match='no joint states'):
        rules.arming.arm(1)
    rules.why = None
    assert not rules.may(1)


def test_watching_disarms_without_a_click() -> None:
    rules = Rules()
    rules.arming.arm(1)
    rules.arming.watch()
    assert rules.arming.holder == 1
    rules.why = 'no joint states'
    rules.arming.watch()
    assert rules.arming.holder is None


@pytest.mark.invariant(3)
def test_a_click_that_has_begun_is_over_before_the_arming_ends() -> None:
    """Otherwise a goal could be sent after everything that was sent had been canceled."""
    rules = Rules()
    rules.arming.arm(1)
    order: list[str] = []
    begun, disconnected = threading.Event(), threading.Event()

    def disconnect() -> None:
        begun.wait()
        rules.arming.disconnect(1)
        order.append('ended')
        disconnected.set()

    thread = threading.Thread(target=disconnect)
    thread.start()
    with rules.arming.held(1):
        begun.set()
        assert not disconnected.wait(0.05)
        order.append('goal sent')
    thread.join()
    assert order == ['goal sent', 'ended']
    assert not rules.may(1)
