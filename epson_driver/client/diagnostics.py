# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics` (REP-107): one status for each link and one for the arm."""

from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from epson_driver.client.driver import Driver
from epson_driver.link import Link


class Diagnostics:
    """Builds the array once a second; rates are since the build before."""

    def __init__(self, driver: Driver, node_name: str) -> None:
        self._driver = driver
        self._node_name = node_name
        self._before: dict[str, tuple[float, int]] = {}

    def build(self, stamp: Any, now: float) -> DiagnosticArray:
        """Return the message. `now` is the loop's time, s."""
        message = DiagnosticArray()
        message.header.stamp = stamp
        message.status = [
            self._link(self._driver.state_link, now),
            self._link(self._driver.motion_link, now),
            self._arm(now),
        ]
        return message

    def _link(self, link: Link, now: float) -> DiagnosticStatus:
        counted = link.statistics
        before, frames = self._before.get(link.name, (now, counted.frames_received))
        self._before[link.name] = (now, counted.frames_received)
        values: dict[str, object] = {
            'state': link.state.value,
            'connections': counted.connections,
            'frames received': counted.frames_received,
            'frames sent': counted.frames_sent,
            'bytes received': counted.bytes_received,
            'bytes sent': counted.bytes_sent,
            'bad frames': sum(counted.bad_frames.values()),
            'replies nobody waited for': counted.unsolicited_replies,
        }
        if now > before:
            values['frame rate [Hz]'] = (
                f'{(counted.frames_received - frames) / (now - before):.1f}'
            )
        values |= {f'bad frames: {field}': n for field, n in counted.bad_frames.items()}
        if counted.reply_latencies:
            latencies = sorted(counted.reply_latencies)  # numpy's median imports for 14 ms
            values['reply latency median [ms]'] = _milliseconds(latencies, 0.5)
            values['reply latency p99 [ms]'] = _milliseconds(latencies, 0.99)
        level = DiagnosticStatus.OK if link.connected else DiagnosticStatus.ERROR
        return self._status(
            f'{link.name} link', level, link.state.value, values, f'{link.host}:{link.port}'
        )

    def _arm(self, now: float) -> DiagnosticStatus:
        driver = self._driver
        values = dict(self._arm_values(now))
        if driver.robot.sample is None:
            level, text = DiagnosticStatus.STALE, 'no joint state'
        elif driver.robot.status is not None and driver.robot.status.error_code:
            level, text = DiagnosticStatus.ERROR, f'error {driver.robot.status.error_code}'
        elif driver.gate.reason is not None:
            level, text = DiagnosticStatus.WARN, f'not enabled: {driver.gate.reason}'
        else:
            level, text = DiagnosticStatus.OK, 'enabled'
        host = driver.configuration.host
        return self._status('arm', level, text, values, host)

    def _arm_values(self, now: float) -> Iterator[tuple[str, object]]:
        driver = self._driver
        yield 'arm gate', 'open' if driver.gate.reason is None else 'closed'
        yield 'goal running', driver.busy
        if driver.robot.sample is not None:
            yield 'age of joint state [ms]', f'{(now - driver.robot.sample.time) * 1e3:.1f}'
        if driver.robot.status is not None:
            yield 'age of status [ms]', f'{(now - driver.robot.status_time) * 1e3:.1f}'
            yield 'error code', driver.robot.status.error_code

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


def _milliseconds(sorted_seconds: list[float], share: float) -> str:
    """Return the value below which `share` of the others lie, in ms."""
    return f'{sorted_seconds[int(share * (len(sorted_seconds) - 1))] * 1e3:.2f}'
