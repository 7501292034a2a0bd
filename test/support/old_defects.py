# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Defects that were there once, to be put back one by one: seeds must find each.

Each is a patch of today's code that is as small as the defect was. old_defects.csv says which seed
has found it, and after how much of the processor's time: `PYTHONPATH=. python
test/support/old_defects.py --minutes 10` looks for them all again, by seeds from 1 on, and writes
it anew.
"""

import argparse
import asyncio
import contextlib
import csv
import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.delivery.streaming import MotomanDelivery
from epson_driver.driver.delivery.trajectory_points import STOP
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import Arrival
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.goal.planning_scope import PlanningScopes
from epson_driver.driver.inhibit import Cause, status_inhibit
from epson_driver.driver.io.io_driver import IoDriver, IoUnavailableError
from epson_driver.driver.io.polled_io import PolledIo
from epson_driver.driver.servo import restart_interlock, setpoint
from epson_driver.driver.servo.restart_interlock import RestartInterlock
from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.servo.stream import VelocityCheck
from epson_driver.driver.state.plausibility import JointBounds
from epson_driver.driver.state.standstill import Standstill
from epson_driver.driver.stopping.arm_gate import ArmGate, Enabling
from epson_driver.driver.stopping.heartbeat import Heartbeat
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.link.remote_link import RemoteLink
from epson_driver.link.replies import PendingReplies, Statement
from epson_driver.panel.arming import Arming
from epson_driver.panel.robot_control import RobotControl
from epson_driver.panel.window import Window
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.programs.motion_program import MotionProgram
from epson_driver.sim_controller.programs.motion_session import ClientWatchdog
from epson_driver.simple_message import IoResult
from simulation.events import events_of
from simulation.oracles import BrokenError
from simulation.world import World, quiet

TABLE = Path(__file__).with_suffix('.csv')

Patch = Callable[[Any, str, Any], object]
"""patch(owner, name, value) until the defect is taken out again."""


async def _never(*_: Any) -> Any:
    await asyncio.Event().wait()


# --- streams ---------------------------------------------------------------------------------


def a_held_stream_is_followed_at_once(put: Patch) -> None:
    put(restart_interlock, 'RELEASE_S', 0.0)


def a_zero_releases_a_stopped_stream(put: Patch) -> None:
    hear = RestartInterlock.hear

    def released(self: Any, source: str, setpoint: Any, came: float, *, missed: bool) -> bool:
        asks = hear(self, source, setpoint, came, missed=missed)
        if not asks:
            self._topics[source].released = True
        return asks

    put(RestartInterlock, 'hear', released)


def positions_that_go_on_are_followed_after_enable(put: Patch) -> None:
    trip = RestartInterlock.trip

    def velocities_only(self: Any, now: float) -> None:
        free = [topic for topic in self._topics.values() if topic.held is not None]
        before = [topic.released for topic in free]
        trip(self, now)
        self._tripped = -math.inf if free else now
        for topic, released in zip(free, before, strict=True):
            topic.released = released

    put(RestartInterlock, 'trip', velocities_only)
    put(RestartInterlock, 'block', lambda self, source: None)


def a_stop_blocks_no_stream(put: Patch) -> None:
    put(RestartInterlock, 'trip', lambda self, now: None)
    put(RestartInterlock, 'block', lambda self, source: None)
    put(RestartInterlock, 'permits', lambda self, source: True)


def a_silent_stream_goes_on(put: Patch) -> None:
    init = Servo.__init__

    def patient(self: Any, *arguments: Any) -> None:
        init(self, *arguments)
        self.settings = ServoSettings(timeout=math.inf)

    put(Servo, '__init__', patient)


def a_setpoint_that_waited_begins_a_stream(put: Patch) -> None:
    take = Servo.take

    def unstamped(self: Any, setpoint: Any, came: float = 0.0, *, missed: bool = False) -> Any:
        return take(self, setpoint, None, missed=missed)

    put(Servo, 'take', unstamped)


def a_stream_is_followed_with_a_closed_gate(put: Patch) -> None:
    put(Servo, '_why_not_on', lambda self, session: None)
    put(Servo, 'stop', lambda self, why: False)


def a_stream_begins_beside_a_goal(put: Patch) -> None:
    def taken(self: Any, waited: float) -> tuple[str, str] | None:
        return None if self._stopper.over else ('stop', 'the arm is being stopped')

    put(Servo, '_why_not_yet', taken)
    put(Servo, 'occupation', lambda self: None)


def impossible_velocities_are_followed(put: Patch) -> None:
    def trusting(self: Any, *_: Any) -> None:
        self.trusted = True

    put(setpoint, '_too_fast', lambda velocities, limits, what: None)
    put(VelocityCheck, 'add', trusting)


# --- goals -----------------------------------------------------------------------------------


def a_goal_ends_twice(put: Patch) -> None:
    end = GoalQueue._end_unstarted

    def twice(self: Any, handle: Any, why: str, *rest: Any) -> None:
        end(self, handle, why, *rest)
        handle.on_end(handle.outcome)

    put(GoalQueue, '_end_unstarted', twice)


def a_replaced_goal_never_ends(put: Patch) -> None:
    end = GoalQueue._end_unstarted

    def lost(self: Any, handle: Any, why: str, *rest: Any) -> None:
        if not why.startswith('replaced'):
            end(self, handle, why, *rest)

    put(GoalQueue, '_end_unstarted', lost)


def a_goal_goes_on_after_an_estop(put: Patch) -> None:
    put(GoalQueue, 'fault', lambda self, why: None)
    put(ArmGate, 'close', lambda self, reason, **_: False)


def a_goal_succeeds_before_it_began(put: Patch) -> None:
    put(GoalExecution, '_plan_time', property(lambda self: math.inf))
    put(GoalExecution, '_check_patience', lambda self, now: None)


def a_goal_succeeds_elsewhere(put: Patch) -> None:
    put(Arrival, 'reached', lambda self, *, said: True)


def a_slow_goal_is_given_up(put: Patch) -> None:
    check = GoalExecution._check_patience

    def impatient(self: Any, now: float) -> None:
        self._due = -math.inf
        check(self, now)

    put(GoalExecution, '_check_patience', impatient)


def a_goal_that_waits_is_not_canceled(put: Patch) -> None:
    cancel = GoalQueue.cancel

    def running_only(self: Any, handle: Any) -> None:
        if handle is self._running:
            cancel(self, handle)

    put(GoalQueue, 'cancel', running_only)


def a_goal_that_waits_outlives_a_stop(put: Patch) -> None:
    put(GoalQueue, 'stopping', lambda self, why: contextlib.nullcontext())


def a_planned_motion_begins_after_a_stop(put: Patch) -> None:
    put(PlanningScopes, 'end', lambda self, why: None)


def late_replies_count_for_the_next_point(put: Patch) -> None:
    def reply(self: Any, index: int, packet: Any, now: float) -> None:
        on_reply(self, self.point, packet, now)

    on_reply = GoalExecution.on_reply
    put(GoalExecution, 'on_reply', reply)
    put(Driver, '_on_broken_off', lambda self, outcome, unanswered: self.disable(outcome.text))


def a_second_reply_answers_the_next_point(put: Patch) -> None:
    def oldest(self: Any, reply: Any) -> Any:
        return next((each for each in self._waiting if each.may_be_answered_by(reply)), None)

    put(PendingReplies, '_find', oldest)


# --- stops and the gate ----------------------------------------------------------------------


def stop_is_not_sent(put: Patch) -> None:
    put(Stopper, 'stop', lambda self: None)


def a_stop_is_not_answered(put: Patch) -> None:
    put(ArmCommands, 'stop', _never)


def a_stop_that_did_not_work_is_a_success(put: Patch) -> None:
    stop = ArmCommands._stop

    async def hopeful(self: Any) -> str:
        try:
            return await stop(self)
        except CommandError:
            return 'stopped'

    put(ArmCommands, '_stop', hopeful)


def a_stop_is_a_success_before_the_arm_stands(put: Patch) -> None:
    async def at_once(self: Any, timeout: float) -> bool:
        return True

    put(Stopper, 'wait', at_once)
    put(Stopper, 'doubt', None)


def an_acknowledged_stop_is_over(put: Patch) -> None:
    reached = Standstill.reached
    put(Standstill, 'reached', lambda self, now: self._after is not None or reached(self, now))


def disable_does_not_end_enabling(put: Patch) -> None:
    put(Enabling, 'cancel', lambda self, why: None)


def a_reset_enables(put: Patch) -> None:
    reset = ArmCommands.reset_error

    async def generous(self: Any) -> str:
        said = await reset(self)
        self._driver.gate._reason = None
        return said

    put(ArmCommands, 'reset_error', generous)


def motors_that_went_off_leave_the_gate_open(put: Patch) -> None:
    find = Driver.condition_inhibit

    def found(self: Any, status: Any) -> Any:
        inhibit = find(self, status)
        return None if inhibit is not None and inhibit.cause is Cause.MOTORS_OFF else inhibit

    put(Driver, 'condition_inhibit', found)


def a_lost_link_leaves_the_gate_open(put: Patch) -> None:
    fault = Driver.fault

    def only_else(self: Any, why: str, **more: Any) -> None:
        if 'link was lost' not in why:
            fault(self, why, **more)

    put(Driver, 'fault', only_else)


def old_points_begin_with_a_new_link(put: Patch) -> None:
    put(Stopper, 'goes_on', False)


def a_link_is_opened_before_stop_can_leave(put: Patch) -> None:
    put(Driver, '_connects_later', False)


def points_follow_a_stop(put: Patch) -> None:
    post = MotomanDelivery.post

    def forgetful(self: Any, message: Any, on_reply: Any) -> None:
        before = self._trajectory
        post(self, message, on_reply)
        if self._trajectory > before and message == STOP:
            self._trajectory = before

    put(MotomanDelivery, 'post', forgetful)


def no_heartbeat_is_sent(put: Patch) -> None:
    put(Heartbeat, 'run', _never)


# --- state -----------------------------------------------------------------------------------


def old_joints_are_published(put: Patch) -> None:
    take = Driver._on_state_packet

    def late(self: Any, packet: Any) -> None:
        kept = vars(self).setdefault('kept', [])
        kept.append(packet)
        take(self, kept[0] if len(kept) > 200 else packet)

    put(Driver, '_on_state_packet', late)


def impossible_joints_are_published(put: Patch) -> None:
    put(JointBounds, 'why_not_there', lambda self, positions: None)
    put(JointBounds, 'why_not_from', lambda self, before, positions, longest: None)


# --- inputs and outputs ----------------------------------------------------------------------


def a_lost_write_is_repeated_later(put: Patch) -> None:
    for kind in (IoDriver, PolledIo):
        write = kind.write

        async def again(self: Any, settings: Any, write: Any = write) -> Any:
            try:
                return await write(self, settings)
            except IoUnavailableError:
                loop = asyncio.get_running_loop()
                loop.call_later(8.0, lambda: loop.create_task(_tried(write(self, settings))))
                raise

        put(kind, 'write', again)


async def _tried(work: Any) -> None:
    with contextlib.suppress(IoUnavailableError):
        await work


def a_write_without_an_answer_is_done(put: Patch) -> None:
    ask = IoDriver.write

    async def hopeful(self: Any, settings: Any) -> Any:
        try:
            return await ask(self, settings)
        except IoUnavailableError:
            return [
                self._answer(each.io_type, each.index, each.value, IoResult.SUCCESS, None)
                for each in settings
            ]

    put(IoDriver, 'write', hopeful)


# --- Remote Ethernet alone -------------------------------------------------------------------


def a_door_leaves_the_gate_open(put: Patch) -> None:
    put(
        Driver,
        'condition_inhibit',
        lambda self, status: status_inhibit(status, self.robot.errors),
    )


def a_statement_is_repeated_after_a_lost_answer(put: Patch) -> None:
    look, post = RemoteLink._look, RemoteLink.post

    def remembered(self: Any, message: Any, on_reply: Any) -> Any:
        posted = post(self, message, on_reply)
        if isinstance(message, Statement):
            self._last = self._motion
        return posted

    async def repeated(self: Any) -> None:
        await look(self)
        last, self._last = getattr(self, '_last', None), None
        if last is not None and self._motion is not last:
            self._execute(last)

    put(RemoteLink, 'post', remembered)
    put(RemoteLink, '_look', repeated)


# --- the panel -------------------------------------------------------------------------------


def a_goal_outlives_its_page(put: Patch) -> None:
    put(Arming, 'watch', lambda self: None)


def a_page_that_is_gone_stays_armed(put: Patch) -> None:
    put(Arming, 'disconnect', lambda self, browser: self._connected.discard(browser))
    put(Arming, '_is_alive', lambda self, browser: True)


def what_a_line_has_held_up_is_done(put: Patch) -> None:
    put(Window, 'late', lambda self, at, now: False)


def a_goal_outlives_its_arming(put: Patch) -> None:
    put(RobotControl, '_on_disarmed', lambda self, why: self.jog_end())


# --- the simulated controller ----------------------------------------------------------------


def an_arm_outlives_its_client(put: Patch) -> None:
    put(Controller, 'client_lost', lambda self: None)


def a_client_that_hangs_is_not_seen(put: Patch) -> None:
    put(ClientWatchdog, '_look', lambda self: None)


def points_outlive_an_estop(put: Patch) -> None:
    abort = MotionProgram.abort
    put(MotionProgram, 'abort', lambda self: None if self._blocked() else abort(self))


DEFECTS: dict[str, Callable[[Patch], None]] = {
    name: value
    for name, value in dict(globals()).items()
    if callable(value) and getattr(value, '__annotations__', {}).get('put') is Patch
}
"""All of them by name."""


WHERE: dict[str, Callable[[World], bool]] = {
    'old_points_begin_with_a_new_link': lambda world: world.profile_name == 'motoman',
    'a_link_is_opened_before_stop_can_leave': lambda world: world.profile_name == 'motoman',
    'points_follow_a_stop': lambda world: world.profile_name == 'motoman',
    'a_second_reply_answers_the_next_point': lambda world: world.profile_name == 'fanuc',
    'a_door_leaves_the_gate_open': lambda world: world.statements,
    'a_statement_is_repeated_after_a_lost_answer': lambda world: world.statements,
    'a_client_that_hangs_is_not_seen': lambda world: world.profile.server.client_timeout > 0.0,
}
"""In which worlds a defect of one kind of controller is looked for; others: in all."""


NEEDS: dict[str, tuple[str, ...]] = {
    'positions_that_go_on_are_followed_after_enable': ('stream', 'stop|disable', 'enable|mend'),
    'a_setpoint_that_waited_begins_a_stream': ('driver_hangs', 'stream|one_setpoint'),
    'a_goal_that_waits_is_not_canceled': ('goal', 'cancel'),
    'a_goal_that_waits_outlives_a_stop': ('goal', 'stop|disable'),
    'a_reset_enables': ('reset_error',),
    'impossible_velocities_are_followed': ('wrong_setpoint',),
    'a_planned_motion_begins_after_a_stop': ('move_tool', 'stop|disable|cancel'),
    'impossible_joints_are_published': ('network_flip|fault',),
    'an_arm_outlives_its_client': ('goal', 'driver_dies|network_reset|fault'),
    'points_outlive_an_estop': ('goal', 'pendant|fault'),
    'old_points_begin_with_a_new_link': ('goal', 'driver_dies|driver_leaves'),
    'a_client_that_hangs_is_not_seen': ('goal', 'driver_hangs'),
    'a_lost_write_is_repeated_later': ('write_output',),
    'a_write_without_an_answer_is_done': ('write_output',),
    'a_goal_outlives_its_page': ('panel_step', 'panel_page_freezes|panel_page_closes'),
    'a_page_that_is_gone_stays_armed': ('panel_step', 'panel_page_closes'),
    'what_a_line_has_held_up_is_done': ('panel_step', 'panel_line_stalls'),
    'a_goal_outlives_its_arming': ('panel_step', 'panel_disarm'),
}
"""What must happen in this order for a defect to matter: other worlds are but counted."""

SOON = 5
"""Within so many events."""

MEAN_WORLD_S = 0.4
"""What a world takes that is counted, CPU s: 120 took 0.35 each."""


def matters(name: str, seed: str) -> bool:
    """Return whether what a defect needs happens in a seed's world, one soon after the other."""
    kinds = [event.kind for event in events_of(seed)]
    ends = set(range(len(kinds)))
    for need in NEEDS.get(name, ()):
        ends = {
            at + more
            for at in ends
            for more in range(SOON)
            if at + more < len(kinds) and kinds[at + more] in need.split('|')
        }
    return bool(ends)


@dataclass(frozen=True)
class Found:
    """With which seed a defect was found, what broke then, and how long that took, CPU s."""

    seed: str
    broken: str
    seconds: float


@contextlib.contextmanager
def put_back(name: str) -> Iterator[None]:
    """Have a defect during the block."""
    with contextlib.ExitStack() as stack:

        def put(owner: Any, attribute: str, value: Any) -> None:
            stack.enter_context(patch.object(owner, attribute, value))

        DEFECTS[name](put)
        yield


def found(name: str, seeds: Iterable[str], budget: float = math.inf) -> Found | None:
    """Return how seeds find a defect within so much of the processor's time, s, or None.

    Raises RuntimeError for a seed that breaks something without the defect, too.
    """
    taken = 0.0
    for seed in seeds:
        world, began = World(seed), time.process_time()
        if name in WHERE and not WHERE[name](world):
            continue
        if matters(name, seed):
            with put_back(name):
                broken = _broken(world, seed)
            taken += time.process_time() - began
            if broken is not None:
                if (without := _broken(World(seed), seed)) is not None:
                    raise RuntimeError(f'seed {seed} breaks this without a defect: {without}')
                return Found(seed, broken, taken)
        else:
            taken += MEAN_WORLD_S
        if taken > budget:
            break
    return None


def _broken(world: World, seed: str) -> str | None:
    """Return what a seed breaks in a world, if anything."""
    with quiet():
        try:
            world.play(events_of(seed))
        except BrokenError as error:
            return str(error)
    return None


def noted() -> dict[str, Found]:
    """Return what was found last."""
    with TABLE.open(newline='', encoding='utf-8') as file:
        return {
            row['defect']: Found(row['seed'], row['broken'], float(row['cpu_s']))
            for row in csv.DictReader(file)
        }


def note(results: dict[str, Found]) -> None:
    """Write what was found."""
    with TABLE.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(['defect', 'seed', 'cpu_s', 'broken'])
        for name in DEFECTS:
            if name in results:
                each = results[name]
                writer.writerow([name, each.seed, f'{each.seconds:.0f}', each.broken])


def main() -> None:
    """Look for defects by seeds from 1 on, and note what was found."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('defects', nargs='*', help='by name; without: all')
    parser.add_argument('--minutes', type=float, default=10.0, help="of the processor's time each")
    arguments = parser.parse_args()
    for name in arguments.defects or DEFECTS:
        result = found(name, map(str, itertools.count(1)), 60.0 * arguments.minutes)
        print(name, result, flush=True)
        results = noted() if TABLE.exists() else {}
        results.pop(name, None)
        note(results if result is None else results | {name: result})


if __name__ == '__main__':
    main()
