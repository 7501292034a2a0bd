# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Forwards Python's logging to ROS, with each record under the name of its node.

The driver does not depend on ROS and uses `logging`. Several drivers may share a process and an
event loop, so the context of their tasks and callbacks identifies the node.
"""

import logging
from contextvars import Context, ContextVar, copy_context

from rclpy.impl.rcutils_logger import RcutilsLogger

from epson_driver.log_lines import PrintableFormatter

_LOGGER: ContextVar[RcutilsLogger] = ContextVar('ros_logger')


def context_of(logger: RcutilsLogger) -> Context:
    """Return a context in which records are sent to this rclpy logger."""
    context = copy_context()
    context.run(_LOGGER.set, logger)
    return context


class RosLogHandler(logging.Handler):
    """Sends records to the logger of the context, or to `logger` if the context has none."""

    def __init__(self, logger: RcutilsLogger) -> None:
        super().__init__()
        self.setFormatter(PrintableFormatter())
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record. If this fails, write the reason to stderr."""
        try:
            self._write(_LOGGER.get(self._logger), self.format(record), record)
        except Exception:  # noqa: BLE001 - like every handler of `logging`
            self.handleError(record)

    @staticmethod
    def _write(logger: RcutilsLogger, text: str, record: logging.LogRecord) -> None:
        """Write one record. rclpy allows one severity per line of code, so each has a line."""
        if record.levelno >= logging.ERROR:
            logger.error(text)
        elif record.levelno >= logging.WARNING:
            logger.warning(text)
        elif record.levelno >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)
