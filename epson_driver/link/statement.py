# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What goes to the remote port where points go to others: SPEL+ statements, and their answers."""

from dataclasses import dataclass

from epson_driver.simple_message import Message


@dataclass(frozen=True, slots=True)
class Statement(Message):
    """SPEL+ statements that move the arm, as `$Execute` takes them.

    They are answered when they are over, however long that takes: `duration`, s, is no bound.
    """

    text: str
    duration: float = float('inf')


@dataclass(frozen=True, slots=True)
class StatementReply(Message):
    """The answer to a Statement or to `$Abort`. `why` they failed, as a clause, or ''."""

    why: str = ''
