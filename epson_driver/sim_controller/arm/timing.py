# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Counts of what came too late or went wrong in the controller's motion."""

from dataclasses import dataclass


@dataclass(slots=True)
class Timing:
    """Counts since the start.

    deadline_misses: motion cycles that came a whole period late. late_plans: plans of smooth
    motion that came after they should have begun; the plan before went on then.
    planner_failures: how often the planner died or found no way. violations: how often smooth
    motion was not what was planned, and was braked before it broke a limit.
    """

    deadline_misses: int = 0
    late_plans: int = 0
    planner_failures: int = 0
    violations: int = 0

    def since(self, before: 'Timing') -> str:
        """Return a sentence about what was counted since then, or nothing if there is nothing."""
        counts = (
            (self.deadline_misses - before.deadline_misses, 'motion cycle(s) came late'),
            (self.late_plans - before.late_plans, 'plan(s) came too late and were not used'),
            (self.planner_failures - before.planner_failures, 'failure(s) of the planner'),
            (self.violations - before.violations, 'limit violation(s) averted'),
        )
        return ', '.join(f'{count} {text}' for count, text in counts if count)
