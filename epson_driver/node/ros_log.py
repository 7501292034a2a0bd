# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Python's logging through ROS's: each record under the name of the node that it is about.

The driver below the node knows no ROS and logs with `logging`. Several of them may share a process
and an event loop, so who speaks is in the context that their tasks and callbacks run in.
"""

import logging
from contextvars import Context, ContextVar, copy_context

from rclpy.impl.rcutils_logger import RcutilsLogger

from epson_driver.log_lines import PrintableFormatter

_LOGGER: ContextVar[RcutilsLogger] = ContextVar('ros_logger')


def context_of(logger: RcutilsLogger) -> Context:
    """Return a context in which records go to this rclpy logger."""
    context = copy_context()
    context.run(_LOGGER.set, logger)
    return context


class RosLogHandler(logging.Handler):
    """Sends records to the logger of the context, and to `logger` where there is none."""

    def __init__(self, logger: RcutilsLogger) -> None:
        super().__init__()
        self.setFormatter(PrintableFormatter())
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record, or to stderr one that cannot be written, with the reason."""
        try:
            self._write(_LOGGER.get(self._logger), self.format(record), record)
        except Exception:  # noqa: BLE001 - as every handler of `logging` does it
            self.handleError(record)

    @staticmethod
    def _write(logger: RcutilsLogger, text: str, record: logging.LogRecord) -> None:
        """Write one record. One line per severity: rclpy allows each line of code just one."""
        if record.levelno >= logging.ERROR:
            logger.error(text)
        elif record.levelno >= logging.WARNING:
            logger.warning(text)
        elif record.levelno >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)
