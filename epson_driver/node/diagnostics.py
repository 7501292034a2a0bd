# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics` (REP-107): a status for each link in use, and a status for the arm.

All values are computed here from existing counters, so diagnostics add no cost per message.
"""

import asyncio
import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from epson_driver.driver.driver import Driver
from epson_driver.driver.inhibit import Cause, Purpose
from epson_driver.error_texts import NO_ERROR
from epson_driver.link import Link

LEVELS = {
    Cause.NO_STATE_LINK: DiagnosticStatus.STALE,
    Cause.NO_JOINTS: DiagnosticStatus.STALE,
    Cause.NO_STATUS: DiagnosticStatus.STALE,
    Cause.NO_MOTION_LINK: DiagnosticStatus.ERROR,
    Cause.STOP_FAILED: DiagnosticStatus.ERROR,
    Cause.SECOND_DRIVER: DiagnosticStatus.ERROR,
    Cause.ESTOP: DiagnosticStatus.ERROR,
    Cause.ERROR: DiagnosticStatus.ERROR,
}
"""Diagnostic level for each cause that inhibits motion. Unlisted causes have the level WARN."""

PERIOD_S = 1.0
CHECKS_PER_PERIOD = 10
"""Number of checks per PERIOD_S for a changed cause of inhibited motion."""


class Diagnostics:
    """Builds the `/diagnostics` message. Its rates are averages since the previous message."""

    def __init__(self, driver: Driver, node_name: str, publishers: Callable[[str], int]) -> None:
        self._driver = driver
        self._publishers = publishers
        self._node_name = node_name
        self._before: dict[str, tuple[float, int]] = {}
        self._built: float | None = None

    async def run(
        self, stamp: Callable[[], Time], publish: Callable[[DiagnosticArray], None]
    ) -> None:
        while True:
            cause = self._cause()
            publish(self.build(stamp(), _now()))
            for _ in range(CHECKS_PER_PERIOD):
                await asyncio.sleep(PERIOD_S / CHECKS_PER_PERIOD)
                if self._cause() is not cause:
                    break

    def _cause(self) -> Cause | None:
        result = self._driver.why_not(Purpose.REPORT, _now())
        return None if result is None else result.cause

    def build(self, stamp: Time, now: float) -> DiagnosticArray:
        message = DiagnosticArray()
        message.header.stamp = stamp
        message.status = [
            *(self._link(link, now) for link in self._driver.links),
            *self._io(now),
            self._arm(now),
        ]
        self._built = now
        return message

    def _link(self, link: Link, now: float) -> DiagnosticStatus:
        values = dict(self._link_values(link, now))
        level = DiagnosticStatus.OK if link.connected else DiagnosticStatus.ERROR
        return self._status(
            f'{link.name} link', level, link.state.value, values, f'{link.host}:{link.port}'
        )

    def _io(self, now: float) -> Iterator[DiagnosticStatus]:
        """Yield the status of the I/O, if used.

        A failure has level WARN: the arm can still move.
        """
        io = self._driver.io
        if not io.used:
            return
        if io.link is None:  # a connection for each request: no link status is available
            status = self._status('io', DiagnosticStatus.OK, 'answers', {}, io.place)
        else:
            status = self._link(io.link, now)
        if io.reason:
            status.level, status.message = DiagnosticStatus.WARN, io.reason
        yield status

    def _link_values(self, link: Link, now: float) -> Iterator[tuple[str, object]]:
        statistics = link.statistics
        before, frames = self._before.get(link.name, (now, statistics.frames_received))
        self._before[link.name] = (now, statistics.frames_received)
        yield 'state', link.state.value
        if statistics.connected_since is not None:
            yield 'uptime [s]', f'{now - statistics.connected_since:.1f}'
        yield 'connections', statistics.connections
        yield 'reconnects', max(statistics.connections - 1, 0)
        yield 'frames received', statistics.frames_received
        yield 'frames sent', statistics.frames_sent
        yield 'bytes received', statistics.bytes_received
        yield 'bytes sent', statistics.bytes_sent
        if now > before:
            rate = (statistics.frames_received - frames) / (now - before)
            yield 'frame rate [Hz]', f'{rate:.1f}'
        yield 'bad frames', sum(statistics.bad_frames.values())
        for field, count in statistics.bad_frames.items():
            yield f'bad frames: {field}', count
        yield 'replies nobody waited for', statistics.unsolicited_replies
        if statistics.reply_latencies:
            latencies = sorted(statistics.reply_latencies)  # importing numpy's median takes 14 ms
            yield 'reply latency median [ms]', _milliseconds(latencies, 0.5)
            yield 'reply latency p99 [ms]', _milliseconds(latencies, 0.99)

    def _arm(self, now: float) -> DiagnosticStatus:
        result = self._driver.why_not(Purpose.REPORT, now)
        values: dict[str, object] = {'cause': 'NONE', 'remedy': 'NONE', 'advice': ''}
        level, text = DiagnosticStatus.OK, 'enabled'
        if result is not None:
            level, text = LEVELS.get(result.cause, DiagnosticStatus.WARN), result.text
            values = {
                'cause': result.cause.name,
                'remedy': result.remedy.name,
                'advice': result.advice,
            }
        robot = self._driver.robot
        number = NO_ERROR if robot.status is None else robot.status.error_code
        if number != NO_ERROR and level in (DiagnosticStatus.OK, DiagnosticStatus.WARN):
            level, text = DiagnosticStatus.ERROR, f'{text}, error {robot.errors.phrase(number)}'
        values |= dict(self._arm_values(now))
        return self._status('arm', level, text, values, self._driver.configuration.host)

    def _arm_values(self, now: float) -> Iterator[tuple[str, object]]:
        driver = self._driver
        robot = driver.robot
        yield 'arm gate', 'open' if driver.gate.reason is None else 'closed'
        if driver.gate.reason is not None:
            yield 'arm gate reason', driver.gate.reason
        if driver.stopper.alarm is not None:
            yield 'STOP did not work', driver.stopper.alarm
        yield 'goal running', driver.goal_queue.busy
        delivery = driver.stopper.delivery
        if delivery.no_plans:
            yield 'plans refused', delivery.no_plans
        if no_streams := delivery.no_streams or driver.goal_queue.why_no_stream:
            yield 'streams refused', no_streams
        servo = driver.servo
        yield 'stream followed', servo.mode or 'none'
        yield 'stream source', servo.source
        for topic, seconds in servo.blocked(now).items():
            yield (
                f'stream to release: {topic}',
                (
                    f'{seconds:.1f} s more without a setpoint that requests motion, '
                    f'publishers: {self._publishers(topic)}'
                ),
            )
        yield 'stream lag [ms]', f'{servo.lag * 1e3:.0f}'
        yield 'setpoints received', servo.counts.received
        yield 'setpoints late', servo.counts.late
        yield 'setpoints left behind', servo.counts.left_behind
        yield 'setpoints clipped', servo.counts.clipped
        yield 'setpoints refused', servo.counts.refused
        yield 'goals without a smooth motion', driver.goal_queue.unsmoothed
        yield 'goals at another speed than planned', driver.goal_queue.other_speed
        if (timing := driver.goal_queue.last_timing) is not None:
            yield 'last goal, planned [s]', f'{timing.planned:.3f}'
            yield 'last goal, executed [s]', f'{timing.executed:.3f}'
        if driver.configuration.client_timeout:
            yield 'heartbeat longest gap [ms]', f'{driver.heartbeat.longest_gap * 1e3:.0f}'
            yield 'heartbeat time-out [ms]', f'{driver.configuration.client_timeout * 1e3:.0f}'
        if robot.sample is not None:
            yield 'age of joint state [ms]', f'{(now - robot.sample.measured) * 1e3:.1f}'
            yield 'velocities beyond what a joint can do', robot.bounded
            yield from self._intervals(now)
        if robot.status is not None:
            yield 'age of status [ms]', f'{(now - robot.status_time) * 1e3:.1f}'
            number = robot.status.error_code
            yield 'error code', number
            text = robot.errors.get(number)
            if number != NO_ERROR and text is not None:
                yield 'error', text.meaning
                yield 'error text confirmed', text.confirmed

    def _intervals(self, now: float) -> Iterator[tuple[str, object]]:
        if self._built is None or now <= self._built:
            return
        arrivals = list(self._driver.robot.arrivals)
        first = bisect_right(arrivals, self._built)
        yield 'joint state rate [Hz]', f'{(len(arrivals) - first) / (now - self._built):.1f}'
        intervals = [later - sooner for sooner, later in pairwise(arrivals[max(first - 1, 0) :])]
        if len(intervals) > 1:
            mean = sum(intervals) / len(intervals)
            variance = sum((interval - mean) ** 2 for interval in intervals) / len(intervals)
            yield 'joint state jitter [ms]', f'{math.sqrt(variance) * 1e3:.2f}'
            yield 'joint state longest gap [ms]', f'{max(intervals) * 1e3:.2f}'

    def _status(
        self, part: str, level: bytes, text: str, values: dict[str, object], hardware: str
    ) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f'{self._node_name}: {part}',
            message=text,
            hardware_id=hardware,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _milliseconds(sorted_seconds: Sequence[float], fraction: float) -> str:
    return f'{sorted_seconds[int(fraction * (len(sorted_seconds) - 1))] * 1e3:.2f}'


def _now() -> float:
    return asyncio.get_running_loop().time()
