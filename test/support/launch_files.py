# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Interprets launch files without `launch`, and without starting processes.

Imports from `launch` are replaced by objects that store their keywords. Where `launch` is
installed, test_launch_files.py also loads the files with it.
"""

import re
import runpy
import sys
import types
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[2] / 'launch'
FILES = sorted(FOLDER.glob('*.launch.py'))


class Entity:
    """An action, a substitution or a source: its kind and its arguments."""

    name: Any = None
    condition: Any = None
    on_exit: Any = None
    parameters: Any = ()
    arguments: Any = ()
    namespace = ''

    def __init__(self, kind: str, *arguments: Any, **keywords: Any) -> None:
        self.kind = kind
        self.given = arguments
        vars(self).update(keywords)


class Launch(types.ModuleType):
    """A module of launch. Each of its names creates an entity of that kind."""

    def __getattr__(self, kind: str) -> Any:
        if kind.startswith('__'):
            raise AttributeError(kind)
        return lambda *arguments, **keywords: Entity(kind, *arguments, **keywords)


def described(path: Path) -> list[Any]:
    """Return the entities of a launch file."""
    modules = re.findall(r'(?m)^from (launch[\w.]*) import', path.read_text(encoding='utf-8'))
    hidden = {name: sys.modules.pop(name, None) for name in modules}
    sys.modules |= {name: Launch(name) for name in modules}
    try:
        made: Any = runpy.run_path(str(path))['generate_launch_description']()
    finally:
        for name, module in hidden.items():
            del sys.modules[name]
            if module is not None:
                sys.modules[name] = module
    return list(made.given[0])


def declared(path: Path) -> set[str]:
    """Return the arguments that a launch file declares."""
    return {item.name for item in described(path) if item.kind == 'DeclareLaunchArgument'}


def launched(path: Path | str, **arguments: str) -> list[Any]:
    """Return the processes and messages of a launch file, by its name or path."""
    if isinstance(path, str):
        path = FOLDER / f'{path}.launch.py'
    started: list[Any] = []
    _run(described(path), dict(arguments), started)
    return started


def _run(entities: Iterable[Any], values: dict[str, str], started: list[Any]) -> None:
    for entity in entities:
        if entity.condition and _performed(entity.condition.given[0], values) != 'true':
            continue
        match entity.kind:
            case 'DeclareLaunchArgument':
                values.setdefault(entity.name, entity.default_value)
                choices = getattr(entity, 'choices', None)
                assert choices is None or values[entity.name] in choices, entity.name
            case 'OpaqueFunction':
                context = types.SimpleNamespace(launch_configurations=values)
                _run(entity.function(context) or (), values, started)
            case 'GroupAction':
                _run(entity.given[0], dict(values), started)
            case 'IncludeLaunchDescription':
                path = Path(entity.given[0].given[0])
                given = {name: _performed(to, values) for name, to in entity.launch_arguments}
                assert given.keys() <= declared(path), path
                values |= given  # launch does not restore them either
                _run(described(path), values, started)
            case 'RegisterEventHandler':
                handler = entity.given[0]
                assert not handler.on_exit(types.SimpleNamespace(returncode=1), None)
                _run(handler.on_exit(types.SimpleNamespace(returncode=0), None), values, started)
            case 'Node' | 'ExecuteProcess' | 'LogInfo':
                started.append(_settled(entity, values))
            case _:
                raise AssertionError(f'unknown: {entity.kind}')


def _performed(value: Any, values: dict[str, str]) -> str:
    """Return a text, or the value of a LaunchConfiguration."""
    return values[value.given[0]] if isinstance(value, Entity) else value


def _settled(entity: Any, values: dict[str, str]) -> Any:
    """Fill in a process's command, parameters by name, and parameter files."""
    if entity.kind == 'ExecuteProcess':
        first, *entity.arguments = entity.cmd
        of_path = isinstance(first, str)
        entity.package = 'ros2cli' if of_path else first.package
        entity.executable = first if of_path else first.executable
    entity.namespace = _performed(entity.namespace, values)
    entity.files = [
        str(parameter) for parameter in entity.parameters if not isinstance(parameter, Mapping)
    ]
    entity.values = {}
    for item in entity.parameters:
        if isinstance(item, Mapping):
            entity.values |= _flat(item)
    return entity


def _flat(values: Mapping[str, Any], above: str = '') -> dict[str, Any]:
    """Return parameters by dotted names, with the texts that ROS would receive."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            result |= _flat(value, f'{above}{name}.')
        else:
            result[above + name] = value.given[0] if isinstance(value, Entity) else value
    return result
