# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of traces, applied to the trace of a driver.

Any peer in the ROS domain may set `trace_file` and `trace_size`; `trace_folder` only who starts
the driver.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any

from epson_driver.trace import Trace, TraceError, open_trace
from epson_driver.trace.trace import MEGABYTE

_log = logging.getLogger(__name__)


class Tracing:
    """Begins and ends traces. Make it in the driver's event loop."""

    def __init__(self, trace: Trace, values: Mapping[str, Any]) -> None:
        """Begin the trace that the parameters ask for, if it can begin."""
        self._trace = trace
        self._folder: str = values['trace_folder']
        self._loop = asyncio.get_running_loop()
        try:
            self.change(values)
        except TraceError as error:
            _log.error('%s', error)

    def change(self, values: Mapping[str, Any]) -> None:
        """Apply those of the parameters that are among the values. In any thread.

        Raises TraceError if the file cannot be made; then nothing changed.
        """
        name = values.get('trace_file')
        file = open_trace(self._folder, name) if name else None
        if 'trace_size' in values:
            self._call(setattr, self._trace, 'largest', values['trace_size'] * MEGABYTE)
        if file is not None:
            self._call(self._trace.begin, file)
        elif name is not None:
            self._call(self._trace.end, 'the parameter trace_file was cleared')

    def _call(self, function: Callable[..., object], *arguments: object) -> None:
        self._loop.call_soon_threadsafe(function, *arguments)
