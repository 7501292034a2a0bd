# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where figures come from: machine, command and date, kept beside them and shown with them."""

import os
import platform
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any


def provenance(command: str) -> dict[str, Any]:
    """Return what is to be known of the run that ends now; `command` repeats it."""
    return {
        'command': command,
        'date': datetime.now(UTC).strftime('%Y-%m-%d'),
        'machine': f'{_processor()}, {os.cpu_count()} cores',
        'python': platform.python_version(),
        'system': platform.system(),
    }


def sentence(data: dict[str, Any]) -> str:
    """Return it in words."""
    return (
        f'`{data["command"]}`, {data["date"]}, {data["machine"]}, {data["system"]}, '
        f'Python {data["python"]}'
    )


def command_of(module: str) -> str:
    """Return the command of this run as a person would type it."""
    return ' '.join(['python -m', module, *sys.argv[1:]])


def _processor() -> str:
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        return platform.machine()
    names = [line.partition(':')[2].strip() for line in text.splitlines() if 'model name' in line]
    return names[0] if names else platform.machine()
