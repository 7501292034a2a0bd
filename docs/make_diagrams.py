# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Diagrams of the state machines, from their tables in the code."""

from collections.abc import Mapping
from dataclasses import replace
from enum import Enum

from epson_driver.driver.goal import goal_states
from epson_driver.link import states as link
from epson_driver.sim_controller.condition import states as controller
from epson_driver.sim_controller.condition.tasks import PROGRAM

Table = Mapping[tuple[Enum, Enum], Enum]

MACHINES: tuple[tuple[str, str, Table, Enum], ...] = (
    ('A link', 'link/states.py', link.TRANSITIONS, link.LinkState.DISCONNECTED),
    (
        'A goal',
        'driver/goal/goal_states.py',
        goal_states.TRANSITIONS,
        goal_states.GoalState.PREPARING,
    ),
)

REGIONS = {
    'motors': 'Motors',
    'estop': 'E-stop',
    'door': 'Safeguard door',
    'tasks': 'Normal tasks',
    'fault': 'Errors of the controller',
    'mode': 'Key switch',
    'power': 'Power',
}


BRIEF = {'estop': 'E-stop', 'fault': 'errors', 'mode': 'key switch'}
"""Names of regions with an unreadable key in the table of refusals."""


def machines() -> str:
    """Return a diagram per state table of the driver, without events that change nothing."""
    return '\n'.join(
        f'### {title}\n\n`epson_driver/{file}`\n\n{_diagram(transitions, start)}'
        for title, file, transitions, start in MACHINES
    )


def condition() -> str:
    """Return the diagrams and tables of the simulated controller's condition."""
    start = controller.Condition()
    parts = [
        f'### {REGIONS[name]}\n\n{_diagram(table, getattr(start, name))}'
        for name, table in controller.REGIONS.items()
    ]
    rows = '\n'.join(
        f'| {event.value} | {_region(state)}: {state.value} | {sentence} |'
        for (event, state), sentence in controller.REJECTIONS.items()
    )
    parts.append(f'### What is refused\n\n| event | in | the answer |\n|---|---|---|\n{rows}\n')
    heads = ' | '.join(f'{task.name} ({_words(task.type)})' for task in PROGRAM)
    lines = [f'| Normal tasks | {heads} |', '|---' * (1 + len(PROGRAM)) + '|']
    for state in controller.Tasks:
        cells = ' | '.join(_words(task.state(replace(start, tasks=state))) for task in PROGRAM)
        lines.append(f'| {state.value} | {cells} |')
    parts.append('### Tasks\n\n' + '\n'.join(lines) + '\n')
    return '\n'.join(parts)


def _region(state: Enum) -> str:
    name = {type(getattr(controller.Condition(), r)): r for r in REGIONS}[type(state)]
    return BRIEF.get(name, name)


def _words(value: Enum) -> str:
    return value.name.lower().replace('_', ' ')


def _diagram(transitions: Table, start: Enum) -> str:
    """Return a Mermaid diagram. Up to eight events with equal states share an arrow."""
    states = {state for row in transitions.items() for state in _states(row)}
    names = {state.name: state.value for state in states}
    lines = ['```mermaid', 'stateDiagram-v2']
    lines += [f'    state "{value}" as {name}' for name, value in sorted(names.items())]
    lines.append(f'    [*] --> {start.name}')
    ways: dict[tuple[str, str], list[str]] = {}
    for (state, event), target in transitions.items():
        if state is not target:
            ways.setdefault((state.name, target.name), []).append(str(event.value))
    for (a, b), events in sorted(ways.items()):
        events.sort()
        parts = [events[first : first + 8] for first in range(0, len(events), 8)]
        lines += [f'    {a} --> {b}: {", ".join(part)}' for part in parts]
    sources = {state for state, _ in transitions}
    targets = set(transitions.values())
    lines += [f'    {name} --> [*]' for name in sorted(t.name for t in targets - sources)]
    return '\n'.join([*lines, '```\n'])


def _states(row: tuple[tuple[Enum, Enum], Enum]) -> tuple[Enum, Enum]:
    (state, _), target = row
    return state, target
