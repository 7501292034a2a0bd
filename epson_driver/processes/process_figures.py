# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What processes take of the machine, as /proc has it (Linux only)."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

TICK_S = 1.0 / os.sysconf('SC_CLK_TCK')

_PSS = re.compile(r'(?m)^Pss:\s+(\d+) kB$')


@dataclass(frozen=True)
class Use:
    """CPU time so far, s, and memory, bytes, shared memory in equal parts."""

    cpu_s: float
    memory_bytes: int

    def __add__(self, other: 'Use') -> 'Use':
        return Use(self.cpu_s + other.cpu_s, self.memory_bytes + other.memory_bytes)


NOTHING = Use(0.0, 0)


def available() -> bool:
    """Return whether this system has such figures."""
    return Path('/proc/self/smaps_rollup').is_file()


def use(process_id: int, *, children: bool = True) -> Use:
    """Return what a process, with its child processes, uses, or nothing if it has ended."""
    total = NOTHING
    for each in _family(process_id) if children else (process_id,):
        try:
            total += Use(cpu_time(each), _memory(each))
        except (FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
            continue
    return total


def cpu_time(process_id: int) -> float:
    """Return the CPU time that a process has used, all threads, user and system, s."""
    text = Path(f'/proc/{process_id}/stat').read_text(encoding='ascii')
    fields = text.rpartition(')')[2].split()  # the name before may have spaces
    return (int(fields[11]) + int(fields[12])) * TICK_S


def _memory(process_id: int) -> int:
    text = Path(f'/proc/{process_id}/smaps_rollup').read_text(encoding='ascii')
    found = _PSS.search(text)
    return int(found[1]) * 1024 if found else 0


def _family(process_id: int) -> Iterator[int]:
    yield process_id
    for path in Path(f'/proc/{process_id}/task').glob('*/children'):
        try:
            children = path.read_text(encoding='ascii').split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        for child in children:
            yield from _family(int(child))
