# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What SPEL+ keeps beside the arm: what statements have set, and the home position."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class SpelMemory:
    """The part of a controller that only SPEL+ statements and remote commands use.

    `settings` holds what statements have set, by statement; `home` is in pulses, one per joint.
    """

    settings: dict[str, tuple[float, ...]] = field(default_factory=dict)
    home: tuple[int, ...] | None = None
