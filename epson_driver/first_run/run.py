# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs the steps of a first run: explains, confirms and executes each, and saves the result."""

import dataclasses
import io
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from epson_driver.doctor.listening import TRACE
from epson_driver.first_run.record import DONE, FAILED, SKIPPED, Entry, FirstRunRecord, packed
from epson_driver.first_run.steps import EndedError, FirstRun, Step, agreed, make_ready, steps
from epson_driver.first_run.trial_move import NotMovedError
from epson_driver.trace.pcap import PcapWriter

CHOICES = 'Enter or y: do it, s: skip it, q: end (continue another time): '


async def go_through(
    run: FirstRun, record: FirstRunRecord, path: Path, say: Callable[[str], None]
) -> bool:
    """Execute every step not done yet. Return False if the user ended the session.

    The record is written after every step, so an interruption loses only the current step.
    """
    try:
        return await _go_through(run, record, path, say)
    finally:
        await run.connections.close()


async def _go_through(
    run: FirstRun, record: FirstRunRecord, path: Path, say: Callable[[str], None]
) -> bool:
    for step in steps(run.joints, remote=run.remote):
        before = record.entries.get(step.name)
        if before is not None and before.state == DONE:
            say(f'{step.name}: done {before.at}')
            continue
        say(f'{step.name}: {step.says}')
        now = dataclasses.replace(run, delay=float(record.facts.get('reply delay', 0.0)))
        try:
            do = await agreed(run.ask, CHOICES)
            record.entries[step.name] = await _done(step, now) if do else Entry(SKIPPED, _now())
        except EndedError as ended:
            say(f'{step.name}: {ended}')
            return False
        entry = record.entries[step.name]
        for habit in entry.found.habits:
            run.findings.note(step.name, habit)
        if entry.state == FAILED:
            run.findings.wrong(
                step.name, entry.why, 'run first_run again: completed steps are saved'
            )
        record.save(path)
    return True


async def _done(step: Step, run: FirstRun) -> Entry:
    file = io.BytesIO()
    token = TRACE.set(PcapWriter(file))
    run.connections.restart()
    try:
        if step.moves:
            await make_ready(run)
        entry = Entry(DONE, _now(), await step.do(run))
    except (NotMovedError, ConnectionError) as error:
        entry = Entry(FAILED, _now(), why=str(error))
    finally:
        TRACE.reset(token)
        run.connections.restart()
    entry.trace = packed(file.getvalue())
    return entry


def _now() -> str:
    return f'{datetime.now(UTC):%Y-%m-%d %H:%M} UTC'
