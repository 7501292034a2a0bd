# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The steps of the first run in their order, with their explanations and results.

A step explains its actions before it asks for confirmation. Its result is stored in the record:
`facts` by the keys of a profile, `times` in s, `answers`, `habits`.
"""

import asyncio
import dataclasses
import math
import statistics
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from epson_driver.doctor.controller_checks import Question, check_controller
from epson_driver.doctor.findings import Findings
from epson_driver.doctor.listening import Conversation, opened
from epson_driver.doctor.pose_checks import Ask
from epson_driver.doctor.state_facts import Facts, latest_joints, latest_status
from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.delivery.statements import StatementDelivery
from epson_driver.driver.inhibit import seen_inhibit
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.error_texts import ErrorTexts, load_error_texts
from epson_driver.first_run.trial_move import (
    MOVED,
    STOP,
    NotMovedError,
    TrialMove,
    ahead,
    move_and_record,
    move_by_statements,
    rests,
)
from epson_driver.link import Link
from epson_driver.link.remote_link import RemoteLink
from epson_driver.motion import Array
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.robots.chain import PRISMATIC
from epson_driver.simple_message import ReplyCode, Status, TriState

DEGREES = 5.0
SLIDE_MM = 10.0
"""Travel of a prismatic joint, mm. Other joints move by 5 degrees."""

MOVE_S = 2.0
BACK_AND_FORTH = 10
"""Duration of one motion, s, and number of motions in a step that the operator interrupts."""

STREAM_POINTS = 40
STREAM_PERIODS_S = (0.1, 0.05)

REPLY_TRIES = 5
READY_TRIES = 3
PENDANT_TOLERANCE = 0.05
"""Tolerance between the pendant's values and the joint states, degrees or mm."""

LATE_S = 0.02
"""Time by which a late STOP reply is slower than the TCP handshake, s."""


@dataclass
class StepResult:
    facts: dict[str, Any] = field(default_factory=dict)
    times: dict[str, float] = field(default_factory=dict)
    answers: dict[str, str] = field(default_factory=dict)
    habits: list[str] = field(default_factory=list)


class Connections:
    def __init__(self) -> None:
        self._open: dict[int, Conversation] = {}

    async def to(self, host: str, port: int, **options: Any) -> Conversation:
        """Return the connection to a port.

        If the previous connection has ended, return a new one (see `opened`).
        """
        made = self._open.get(port)
        if made is None or made.traffic.ended:
            if made is not None:
                await made.close()
            made = self._open[port] = await opened(host, port, **options)
        return made

    def restart(self) -> None:
        """Clear the traffic of all connections, and record new traffic in the current trace."""
        for made in self._open.values():
            made.restart()

    async def close(self) -> None:
        while self._open:
            await self._open.popitem()[1].close()


@dataclass(frozen=True)
class FirstRun:
    """The robot to examine, the dialogue with the user, and the findings so far."""

    question: Question
    ask: Ask
    findings: Findings
    delay: float = 0.0  # delay of replies measured so far, s
    connections: Connections = field(default_factory=Connections)

    @property
    def errors(self) -> ErrorTexts:
        return load_error_texts(self.question.profile.error_texts)

    @property
    def joints(self) -> int:
        return len(self.question.model.joint_names)

    @property
    def remote(self) -> bool:
        """Whether statements of Remote Ethernet move the arm.

        The controller then needs no program.
        """
        return self.question.profile.program.interface == 'statements'

    async def state(self) -> Conversation:
        """Return the connection to the state port.

        Raises NoConnectionError if it cannot be opened.
        """
        question = self.question
        if not self.remote:
            return await self.connections.to(question.host, question.state_port, sends=True)

        def make(host: str, port: int, **callbacks: Any) -> Link:
            units, password = question.model.limits.units, question.password
            return RemoteLink(host, port, units, password=password, **callbacks)

        return await self.connections.to(question.host, question.remote_port, make=make)

    async def links(self) -> tuple[Conversation, Conversation]:
        """Return the connections to the state port and to the motion port.

        Raises NoConnectionError if one of them cannot be opened.
        """
        state = await self.state()
        if self.remote:
            return state, state
        return state, await self.connections.to(self.question.host, self.question.motion_port)


Do = Callable[[FirstRun], Awaitable[StepResult]]


@dataclass(frozen=True)
class Step:
    """One step of the first run.

    `says` is its explanation, and `do` executes it. `moves`: whether the step moves the arm.
    """

    name: str
    says: str
    do: Do
    moves: bool = False


async def _check(run: FirstRun, *, may_ask: bool = False, may_use_io: bool = False) -> Facts:
    question = dataclasses.replace(run.question, may_ask=may_ask, may_use_io=may_use_io)
    await run.connections.close()  # a port may serve one client only
    return await check_controller(question, run.findings)


async def _listen(run: FirstRun) -> StepResult:
    facts = await _check(run)
    result = StepResult(facts)
    if 'state.period' in facts:
        result.times['state period'] = float(facts['state.period'])  # type: ignore[arg-type]
    state = await run.state()
    await state.ended_within(1.0)
    joints = latest_joints(state.traffic)
    if joints is not None and (step := _rounding(joints[: run.joints])):
        result.facts['servo.encoder'] = False
        result.habits.append(f'joint states are rounded to {step:g} degrees')
    return result


def _rounding(joints: Sequence[float]) -> float:
    """Return the unit to which joint states are rounded, degrees: 0.1, 0.01 or 0.001.

    Return 0 if the joint states are not rounded.
    """
    values = np.degrees(np.asarray(joints))
    if np.abs(values).max() < 0.1:
        return 0.0  # an arm at 0 shows no rounding
    for step in (0.1, 0.01, 0.001):
        if np.abs(values / step - np.round(values / step)).max() < 0.02:
            return step
    return 0.0


async def _pendant(run: FirstRun) -> StepResult:
    message = await run.ask('J1 J2 … on the pendant, in degrees (prismatic joints: mm): ')
    result = StepResult(answers={'pendant': message.strip()[:200]})
    try:
        shown = np.array([float(word) for word in message.replace(',', ' ').split()])
    except ValueError:
        shown = np.empty(0)
    if len(shown) != run.joints:
        raise NotMovedError(f'not compared with the pendant: {run.joints} numbers are needed')
    own = _shown(await _where(run, await run.state()), run)
    for index, (ours, theirs) in enumerate(zip(own, shown, strict=True)):
        if abs(ours - theirs) <= PENDANT_TOLERANCE:
            continue
        name = run.question.model.joint_names[index]
        if abs(ours + theirs) <= PENDANT_TOLERANCE:
            result.habits.append(f'{name} has the opposite sign: joint_signs -1')
        else:
            result.habits.append(
                f'{name} = {ours:.3f}, but {theirs:.3f} on the pendant: joint_offsets'
            )
    return result


def _shown(joints: Array, run: FirstRun) -> Array:
    slides = np.array([kind == PRISMATIC for kind in run.question.model.joint_types])
    return np.where(slides, joints * 1000.0, np.degrees(joints))


async def _ask_still(run: FirstRun) -> StepResult:
    facts = await _check(run, may_ask=True)
    result = StepResult(facts)
    if 'program.kind' not in facts:
        raise NotMovedError('the motion port was not queried: see above')
    state, motion = await run.links()
    if not await state.wait_for_traffic(lambda traffic: traffic.packets, 5.0):
        raise NotMovedError('no state received')
    motion.link.dialect = state.traffic.packets[0][1].dialect
    took, missing = [], 0
    for _ in range(REPLY_TRIES):
        began = asyncio.get_running_loop().time()
        if await motion.ask(STOP, run.question.seconds) is None:
            missing += 1
            continue
        took.append(asyncio.get_running_loop().time() - began)
    handshake = motion.traffic.handshake
    if missing:
        result.habits.append(f'{missing} of {REPLY_TRIES} requests had no reply')
    if took:
        result.times['reply to STOP'] = reply = statistics.median(took)
        if reply > LATE_S + handshake:
            result.facts['reply delay'] = reply - handshake
            result.habits.append(f'replies are {(reply - handshake) * 1e3:.0f} ms late')
    return result


async def _io(run: FirstRun) -> StepResult:
    facts = await _check(run, may_use_io=True)
    return StepResult({key: facts[key] for key in ('io', 'ports.io') if key in facts})


async def make_ready(run: FirstRun) -> None:
    """Ask the operator to make the arm ready, if it is not ready. Nothing is sent."""
    state = await run.state()
    await state.wait_for_traffic(latest_status, 5.0)
    status = latest_status(state.traffic)
    if status is None or seen_inhibit(status, run.errors) is not None:
        await _ready(run, state, SWITCHED_ON if run.remote else f'Set the power LOW, {MAIN_AGAIN}')


class EndedError(Exception):
    """The user ended the session, with q or because the power is not low."""


async def agreed(ask: Ask, sentence: str, no: str = 's') -> bool:
    """Ask until the user agrees (Enter or y) or declines (an answer that starts with `no`).

    Raises EndedError if the answer starts with q.
    """
    while (answer := (await ask(sentence)).strip().lower()) not in ('', 'y', 'yes'):
        if answer.startswith('q'):
            raise EndedError('ended here')
        if answer.startswith(no):
            return False
    return True


async def _power(run: FirstRun) -> StepResult:
    await make_ready(run)
    if run.remote:
        return StepResult(answers={'power': 'low, set by each motion'})
    if not await agreed(run.ask, 'Is the power low? (Enter or y: yes, n: no): ', 'n'):
        raise EndedError(
            'steps that move the arm need low power: set the power LOW, then start again'
        )
    return StepResult(answers={'power': 'low'})


async def _ready(run: FirstRun, state: Conversation, what: str) -> None:
    """Ask the user to do `what`, until STATUS permits motion. Raises NotMovedError otherwise."""
    why = ''
    for _ in range(READY_TRIES):
        done = await agreed(run.ask, f'{what}, then press Enter (s: skip this step): ')
        if done and run.remote:
            await _switch_on(run, state)
        await state.ended_within(0.5)
        if not done or state.traffic.ended:
            raise NotMovedError('the arm was not made ready')
        state.traffic.packets.clear()
        await state.wait_for_traffic(latest_status, 5.0)
        status = latest_status(state.traffic)
        result = None if status is None else seen_inhibit(status, run.errors)
        if status is not None and result is None:
            return
        why = 'no STATUS received' if result is None else result.text
        run.findings.note('not ready', why)
    raise NotMovedError(f'the arm was not made ready in {READY_TRIES} tries: {why}')


async def _switch_on(run: FirstRun, state: Conversation) -> None:
    assert isinstance(state.link, RemoteLink)  # noqa: S101 - for the type checker
    for command in ('Reset', 'SetMotorsOn,1'):
        try:
            await state.link.ask(command)
        except (RemoteError, ConnectionError) as error:
            run.findings.note('controller', str(error))


def _target(here: Array, index: int, run: FirstRun) -> Array:
    """Return joint positions, shape (n,), with joint `index` moved by a small step from `here`.

    The step is positive, or negative if the joint is near the upper end of its range.
    """
    step = SLIDE_MM / 1000.0
    if run.question.model.joint_types[index] != PRISMATIC:
        step = math.radians(DEGREES)
    limits = run.question.model.limits
    target = here.copy()
    target[index] += step if here[index] + 2.0 * step < limits.position_max[index] else -step
    return target


async def _joint(index: int, run: FirstRun) -> StepResult:
    name = run.question.model.joint_names[index]
    state, motion, here, target = await _prepared(run, index)
    made = await _move_and_record(run, state, motion, [target], [MOVE_S])
    result = _move_times(f'joint {index + 1}', made)
    if index == 0:
        result.facts['lateness'] = made.lateness
    off = np.abs(made.positions[-1] - target).max()
    if off > 2.0 * MOVED:
        result.habits.append(f'{name} stopped {off:.4f} rad or m from its target')
    back = _move_times(
        f'joint {index + 1}', await _move_and_record(run, state, motion, [here], [MOVE_S])
    )
    # motion starts in a cycle of the controller, so the mean of two is more accurate
    result.times = {
        key: statistics.mean((value, back.times.get(key, value)))
        for key, value in result.times.items()
    }
    sense = '+' if target[index] > here[index] else '-'
    asked = f'Did J{index + 1} move in its {sense} direction, and back? (Enter or y: yes, n: no): '
    agrees = await agreed(run.ask, asked, 'n')
    result.answers[name] = f'{sense}: {"yes" if agrees else "no"}'
    if not agrees:
        result.habits.append(f'{name} has the opposite sign: joint_signs -1')
    return result


async def _prepared(
    run: FirstRun, index: int = 0
) -> tuple[Conversation, Conversation, Array, Array]:
    """Return both connections, the joint positions, and the target of a move of joint `index`."""
    state, motion = await run.links()
    here = await _where(run, state)
    return state, motion, here, _target(here, index, run)


async def _where(run: FirstRun, state: Conversation) -> Array:
    await state.wait_for_traffic(latest_joints, 5.0)
    joints = latest_joints(state.traffic)
    if joints is None:
        raise NotMovedError('no joint states were received')
    return np.array(joints[: run.joints])


async def _move_and_record(
    run: FirstRun,
    state: Conversation,
    motion: Conversation,
    targets: Sequence[Array],
    durations: Sequence[float],
    stop_after: float | None = None,
) -> TrialMove:
    model, profile = run.question.model, run.question.profile
    if isinstance(state.link, RemoteLink):
        rules = delivery_rules(profile, 'statements', profile.program.point_message)
        same = joint_mapping(run.joints, [1], [0.0], 0)
        moves = StatementDelivery(state.link, model.limits, same, rules)
        return await move_by_statements(
            state, moves, model, run.errors, targets, durations, stop_after
        )
    return await move_and_record(state, motion, model, run.errors, targets, durations, stop_after)


def _move_times(name: str, made: TrialMove) -> StepResult:
    result = StepResult()
    missing = sum(answer is None for answer in made.answers)
    if missing:
        result.habits.append(f'{missing} of {len(made.sent)} points had no reply')
    if any(answer is not None and answer[1] is ReplyCode.FAILURE for answer in made.answers):
        result.habits.append(f'{name}: a point was refused')
    if made.start is None:
        result.habits.append(f'{name}: the arm did not move')
    elif not made.measured:
        result.times[f'{name}: statement'] = made.end - made.sent[-1]
    else:
        result.times[f'{name}: point sent to motion seen'] = made.start - made.sent[1]
        result.times[f'{name}: motion'] = made.end - made.start
    return result


async def _points(run: FirstRun) -> StepResult:
    result = StepResult()
    counts: list[float] = []
    periods: list[float] = []
    state, motion, here, target = await _prepared(run)
    for usual in STREAM_PERIODS_S:
        period = usual + 2.0 * run.delay  # a point waits for the reply before it
        targets = [here + (target - here) * k / STREAM_POINTS for k in range(1, STREAM_POINTS + 1)]
        name = f'{STREAM_POINTS} points of {usual:g} s{" and two replies" * bool(run.delay)}'
        made = await _move_and_record(run, state, motion, targets, [period] * STREAM_POINTS)
        one = _move_times(name, made)
        result.times |= one.times
        result.habits += one.habits
        counts.append(ahead(made, 0, run.delay))
        periods.append(period)
        stops = rests(made)
        await _move_and_record(run, state, motion, [here], [MOVE_S])
    buffer = _buffer(counts, periods)
    if not run.question.profile.spel.project:  # a project has a look-ahead of its own
        result.facts |= buffer
    # a point acknowledged at the arm's arrival leaves the arm without a next point
    waits = buffer.get('program.acknowledge') == 'default'
    result.facts['rests at points'] = waits or stops > STREAM_POINTS // 4
    if result.facts['rests at points']:
        text = f'{stops} stops at {STREAM_POINTS} points'
        why = ', replies come after the arrival at each point' if waits else ''
        result.habits.append(f'the arm stops at points: {text}{why}')
    return result


def _buffer(counts: Sequence[float], periods: Sequence[float]) -> dict[str, Any]:
    """Return the size of the controller's point buffer, in points or as a time, s.

    `counts`: the maximum number of points that were acknowledged before the arm reached them, for
    each of `periods`, the times between points, s.
    """
    if min(counts) < 0.5:
        return {'program.acknowledge': 'default'}  # point to point, which rests at each
    whole = [math.floor(count + 0.5) for count in counts]
    if min(whole) >= STREAM_POINTS - 1:
        return {'program.acknowledge': 'taken'}  # all were accepted immediately
    if whole[0] == whole[1]:
        return {'program.acknowledge': 'taken', 'motion.look_ahead_points': whole[0]}
    spans = [(item - 1.0) * period for item, period in zip(counts, periods, strict=True)]
    seconds = round(statistics.fmean(spans), 2)
    return {'program.acknowledge': 'taken', 'motion.look_ahead': max(seconds, 0.01)}


async def _stop(run: FirstRun) -> StepResult:
    state, motion, here, target = await _prepared(run)
    made = await _move_and_record(
        run, state, motion, [target], [2.0 * MOVE_S], stop_after=MOVE_S / 2
    )
    result = StepResult()
    if made.start is None or made.stopped is None:
        raise NotMovedError('the arm did not move')
    stopped = bool(np.abs(made.moved).max() < 0.9 * np.abs(target - here).max())
    if not stopped:
        result.habits.append('a STOP does not stop the arm')
    else:
        result.times['STOP to rest'] = max(made.end - made.stopped, 0.0)
    await _move_and_record(run, state, motion, [here], [MOVE_S])
    return result


@asynccontextmanager
async def _asked(run: FirstRun, sentence: str) -> AsyncIterator[asyncio.Future[str]]:
    """Ask a question while the block runs. Cancel the question if the block fails."""
    answer = asyncio.ensure_future(run.ask(sentence))
    try:
        yield answer
    except BaseException:
        answer.cancel()
        raise


async def _interrupted(
    name: str, what: str, seen: Callable[[Status], bool], undo: str, run: FirstRun
) -> StepResult:
    """Move joint 1 back and forth until the operator stops it.

    Afterwards, check that the arm stays at rest.
    """
    result = StepResult()
    state, motion, here, target = await _prepared(run)
    targets = [target, here] * (BACK_AND_FORTH // 2)
    async with _asked(
        run, f'The arm moves back and forth: {what} NOW, then press Enter: '
    ) as answer:
        made = await _move_and_record(run, state, motion, targets, [MOVE_S] * len(targets))
    result.answers[name] = (await answer).strip()[:200] or 'done'
    stopped_at = made.since(seen)
    if stopped_at is None:
        asked = f'No {name} was reported. Did you {what} during the motion? (Enter or y, n): '
        if not await agreed(run.ask, asked, 'n'):
            raise NotMovedError(f'there was no {name} during the motion')
        result.habits.append(f'the controller did not report the {name}')
        return result
    result.times[f'{name}: STATUS to rest'] = max(made.end - stopped_at, 0.0)
    _error_number(name, made, run, result)
    if run.remote:
        undo = f'{undo.partition(",")[0]} (Enter resets the error and switches the motors on)'
    try:
        await _ready(run, state, undo)
    except NotMovedError as error:
        result.habits.append(f'{name}: not checked whether the arm resumes its motion: {error}')
        return result
    before = await _where(run, state)
    await state.ended_within(2.0)
    if np.abs(await _where(run, state) - before).max() > MOVED:
        result.habits.append(f'{name}: the arm resumed its motion without a command')
    return result


def _error_number(name: str, made: TrialMove, run: FirstRun, result: StepResult) -> None:
    number = next((item.error_code for _, item in reversed(made.statuses) if item.error_code), 0)
    result.answers[f'{name}: error'] = run.errors.phrase(number)
    if number and number not in run.errors:
        table = run.question.profile.error_texts
        result.habits.append(f'{name}: error number {number} is not in the table {table}')


async def _cable(run: FirstRun) -> StepResult:
    result = StepResult()
    state, motion, _, target = await _prepared(run)
    sentence = 'The arm moves: pull the network cable NOW, plug it in again, then Enter: '
    async with _asked(run, sentence) as answer:
        try:
            await _move_and_record(run, state, motion, [target], [2.0 * MOVE_S])
            lost = bool(state.traffic.ended or motion.traffic.ended)
        except (NotMovedError, ConnectionError) as error:
            lost = True
            result.answers['cable: what was seen'] = str(error)
    result.answers['cable'] = (await answer).strip()[:200] or 'done'
    if not lost:
        result.habits.append('cable: the connection was not lost, the effect of a loss is unknown')
        return result
    state = await run.state()
    after = await _where(run, state)
    finished = bool(np.abs(after - target).max() < 2.0 * MOVED)
    result.facts['server.lost_client'] = 'finish' if finished else 'brake'
    if finished:
        result.habits.append('the arm continues to its point after the connection is lost')
    return result


QUESTIONS: Mapping[str, str] = {
    'background_ready.prg': 'does the output Ready stay on with a background task?',
    'till_and_cp.prg': 'does Till keep the blend of CP?',
    'till_holds_already.prg': 'does a Go whose Till condition holds already move at all?',
    'statement_times.prg': 'how long does a statement take, how long Wait 0.001, and how long '
    'Speed with Accel?',
    'server_ports.prg': 'what does the host of SetNet mean, what does a second client get, and '
    'what does ChkNet show of FIN and of a reset?',
    'reported_joints.prg': 'do Agl and RealPls lag?',
    'till_braking.prg': 'how often is Till evaluated, and how does it brake?',
    'wait_pos.prg': 'does WaitPos in main wait when the motors go off, and can StartMain start '
    'main immediately after the door?',
    'loop_without_wait.prg': 'does error 2556 occur in a loop that only polls a port?',
    'pulses_in_background.prg': 'does PPls(AglToPls(…)) work in a background task, before '
    'anything has moved?',
}
"""Program → open question of docs/controller_program.md that it answers."""


async def _questions(run: FirstRun) -> StepResult:
    result = StepResult()
    for program, question in QUESTIONS.items():
        message = await run.ask(f'docs/examples/spel/{program}: {question} (Enter: not tried): ')
        if message.strip():
            result.answers[program] = message.strip()[:1000]
    result.answers['versions'] = (await run.ask('Versions of controller and RC+: ')).strip()[:200]
    return result


NEED_PROGRAM = ('questions', 'I/O', 'points', 'cable', 'open questions')
"""Names of the steps that are omitted for a controller that only has Remote Ethernet."""

LISTEN = 'Listen to the state port. Nothing is sent.'
LISTEN_REMOTE = 'Ask Remote Ethernet for the status and the joint positions.'
READY = 'Set the power LOW and switch the motors on.'
READY_REMOTE = 'Switch the motors on, in low power. Nothing moves.'
SWITCHED_ON = 'Make the cell safe (Enter switches the motors on, in low power)'
MAIN_AGAIN = 'stop main, reset, switch the motors on, start main'


def _estopped(status: Status) -> bool:
    return status.e_stopped == TriState.TRUE


def _motion_inhibited(status: Status) -> bool:
    return status.motion_possible == TriState.FALSE or status.drives_powered == TriState.FALSE


def steps(joints: int, *, remote: bool = False) -> list[Step]:
    """Return the steps. `remote`: whether the controller only has Remote Ethernet."""
    distance = f'{DEGREES:g} degrees ({SLIDE_MM:g} mm)'
    pace = 'at low power' if remote else f'in {MOVE_S:g} s'
    slowly = f'joint 1 moves {distance} back and forth, slowly, {BACK_AND_FORTH // 2} times'
    every = [
        Step('listen', LISTEN_REMOTE if remote else LISTEN, _listen),
        Step('pendant', 'Compare the joint positions with the pendant.', _pendant),
        Step(
            'questions', 'Send a STOP and a point at the current position, motors OFF.', _ask_still
        ),
        Step('I/O', 'Query the available I/O, motors OFF. Outputs may change at the end.', _io),
        Step('ready', READY_REMOTE if remote else READY, _power),
        *(
            Step(
                f'joint {index + 1}',
                f'THE ARM MOVES: joint {index + 1} moves {distance} {pace}, and back.',
                partial(_joint, index),
                moves=True,
            )
            for index in range(joints)
        ),
        Step(
            'STOP',
            f'THE ARM MOVES: joint 1 moves {distance}, a STOP interrupts it, and it moves back.',
            _stop,
            moves=True,
        ),
        Step(
            'points',
            f'THE ARM MOVES: joint 1 moves {distance} in {STREAM_POINTS} points, and back, twice.',
            _points,
            moves=True,
        ),
        Step(
            'E-stop',
            f'THE ARM MOVES: {slowly}. Press the E-stop during the motion.',
            partial(
                _interrupted,
                'E-stop',
                'press the E-stop',
                _estopped,
                f'Release it, {MAIN_AGAIN}',
            ),
            moves=True,
        ),
        Step(
            'door',
            f'THE ARM MOVES: {slowly}. Open the safeguard during the motion.',
            partial(
                _interrupted,
                'door',
                'open the safeguard',
                _motion_inhibited,
                f'Close it, {MAIN_AGAIN}',
            ),
            moves=True,
        ),
        Step(
            'cable',
            f'THE ARM MOVES: joint 1 moves {distance}. Pull the network cable during the motion.',
            _cable,
            moves=True,
        ),
        Step(
            'open questions',
            'Enter the results of the programs in docs/examples/spel.',
            _questions,
        ),
    ]
    return [step for step in every if not (remote and step.name in NEED_PROGRAM)]
