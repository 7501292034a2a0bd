# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A small stand-in for `launch` and `launch_ros` where they are not installed: it starts nothing.

It has what our launch files use, by the same names and keywords, and does what launch does with
arguments, includes, groups and conditions; what it has not is an error. What would be started is
kept in `Context.started`.
"""

import runpy
import sys
import types
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import yaml


class LaunchError(RuntimeError):
    """What launch would refuse, or what a launch file must not do."""


class Context:
    """launch's LaunchContext, and a record of what would run."""

    def __init__(self, arguments: Mapping[str, str]) -> None:
        self.launch_configurations = dict(arguments)
        self.started: list[Any] = []
        self.declared: list[Any] = []
        self.logged: list[str] = []
        self.included: list[tuple[str, dict[str, str]]] = []


class LaunchConfiguration:
    def __init__(self, variable_name: str) -> None:
        self.name = variable_name

    def perform(self, context: Context) -> str:
        if self.name not in context.launch_configurations:
            raise LaunchError(f'launch configuration {self.name} does not exist')
        return context.launch_configurations[self.name]


class ExecutableInPackage:
    def __init__(self, executable: str, package: str) -> None:
        self.executable, self.package = executable, package

    def perform(self, context: Context) -> str:
        return f'{self.package}/{self.executable}'


class IfCondition:
    def __init__(self, predicate_expression: Any) -> None:
        self._expression = predicate_expression

    def evaluate(self, context: Context) -> bool:
        text = performed(self._expression, context).lower()
        if text not in ('true', 'false', '1', '0'):
            raise LaunchError(f'{text} is neither true nor false')
        return text in ('true', '1')


class ParameterValue:
    def __init__(self, value: str, *, value_type: type) -> None:
        assert value_type is str
        assert isinstance(value, str)
        self.value = value


class LaunchDescription:
    def __init__(self, initial_entities: Iterable[Any]) -> None:
        self.entities = list(initial_entities)


class PythonLaunchDescriptionSource:
    def __init__(self, launch_file_path: str) -> None:
        self.path = Path(launch_file_path)


class Action(ABC):
    """What all actions have: a condition."""

    def __init__(self, condition: IfCondition | None = None) -> None:
        self.condition = condition

    def execute(self, context: Context) -> None:
        if self.condition is None or self.condition.evaluate(context):
            self.run(context)

    @abstractmethod
    def run(self, context: Context) -> None:
        """Do what the action is for."""


class DeclareLaunchArgument(Action):
    def __init__(
        self,
        name: str,
        *,
        default_value: str | None = None,
        description: str | None = None,
        choices: Sequence[str] | None = None,
    ) -> None:
        super().__init__()
        self.name, self.default_value = name, default_value
        self.description, self.choices = description, choices
        if choices is not None and default_value not in choices:
            raise LaunchError(f'default {default_value} of {name} is not among {choices}')

    def run(self, context: Context) -> None:
        values = context.launch_configurations
        if self.default_value is None and self.name not in values:
            raise LaunchError(f'required launch argument {self.name} was not provided')
        values.setdefault(self.name, self.default_value or '')
        if self.choices is not None and values[self.name] not in self.choices:
            raise LaunchError(f'{self.name} = {values[self.name]}: not among {self.choices}')
        context.declared.append(self)


class OpaqueFunction(Action):
    def __init__(self, *, function: Callable[[Context], Sequence[Action] | None]) -> None:
        super().__init__()
        self._function = function

    def run(self, context: Context) -> None:
        for action in self._function(context) or ():
            action.execute(context)


class GroupAction(Action):
    """Scoped, as launch's own is unless told otherwise."""

    def __init__(self, actions: Iterable[Action]) -> None:
        super().__init__()
        self._actions = list(actions)

    def run(self, context: Context) -> None:
        outside = dict(context.launch_configurations)
        for action in self._actions:
            action.execute(context)
        context.launch_configurations.clear()
        context.launch_configurations.update(outside)


class IncludeLaunchDescription(Action):
    """Arguments of an include stay set after it, as in launch."""

    def __init__(
        self,
        launch_description_source: PythonLaunchDescriptionSource,
        *,
        launch_arguments: Iterable[tuple[str, Any]] = (),
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition)
        self._source = launch_description_source
        self.path = launch_description_source.path
        self._arguments = list(launch_arguments)

    def run(self, context: Context) -> None:
        given = {name: performed(value, context) for name, value in self._arguments}
        if not self._source.path.is_file():
            raise LaunchError(f'{self._source.path} does not exist')
        included = description(self._source.path)
        unknown = sorted(set(given) - declared_names(included))
        if unknown:
            raise LaunchError(f'{self._source.path.name} does not declare {unknown}')
        context.included.append((self._source.path.name, given))
        context.launch_configurations |= given
        for entity in included.entities:
            entity.execute(context)


class LogInfo(Action):
    def __init__(self, *, msg: str) -> None:
        super().__init__()
        self._msg = msg

    def run(self, context: Context) -> None:
        context.logged.append(self._msg)


class Shutdown(Action):
    """What ends a launch; here it is only handed to `on_exit`."""

    def __init__(self, *, reason: str) -> None:
        super().__init__()
        self.reason = reason

    def run(self, context: Context) -> None:
        raise LaunchError(f'shut down: {self.reason}')


class ExecuteProcess(Action):
    def __init__(
        self, *, cmd: Sequence[Any], output: str = 'log', on_exit: Action | None = None
    ) -> None:
        super().__init__()
        self.on_exit = on_exit
        self._cmd = cmd
        self.output = output
        self.command: list[str] = []

    def run(self, context: Context) -> None:
        executable = self._cmd[0]
        if executable == 'ros2':  # on PATH
            executable = ExecutableInPackage('ros2', 'ros2cli')
        self.package, self.executable = executable.package, executable.executable
        self.command = [performed(word, context) for word in self._cmd[1:]]
        context.started.append(self)


class Exit(NamedTuple):
    """launch's ProcessExited."""

    returncode: int


class OnProcessExit:
    def __init__(
        self, *, target_action: Action, on_exit: Callable[[Exit, Context], Sequence[Action]]
    ) -> None:
        self.target_action, self.on_exit = target_action, on_exit


class RegisterEventHandler(Action):
    """What it starts when its process has done well counts as started."""

    def __init__(self, event_handler: OnProcessExit) -> None:
        super().__init__()
        self._handler = event_handler

    def run(self, context: Context) -> None:
        assert not self._handler.on_exit(Exit(1), context)
        for action in self._handler.on_exit(Exit(0), context):
            action.execute(context)


class Node(Action):
    """A ROS node: its parameters are kept as ROS would get them."""

    def __init__(
        self,
        *,
        package: str,
        executable: str,
        name: str | None = None,
        namespace: Any = '',
        parameters: Sequence[Any] = (),
        arguments: Sequence[Any] = (),
        output: str = 'log',
        respawn: bool = False,
        respawn_delay: float | None = None,
        on_exit: Action | None = None,
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition)
        self.on_exit = on_exit
        self.respawn, self.respawn_delay = respawn, respawn_delay
        self.package, self.executable, self.name = package, executable, name
        self._given = namespace, list(parameters), list(arguments)
        self.output = output
        self.namespace = ''
        self.parameters: dict[str, Any] = {}
        self.files: list[Path] = []
        self.command: list[str] = []

    def run(self, context: Context) -> None:
        namespace, parameters, arguments = self._given
        self.namespace = performed(namespace, context)
        self.command = [performed(word, context) for word in arguments]
        for each in parameters:
            if isinstance(each, Mapping):
                self.parameters |= dict(flat(each))
            else:
                self.files.append(Path(each))
                if not self.files[-1].is_file():
                    raise LaunchError(f'parameter file {each} does not exist')
        context.started.append(self)


def flat(values: Mapping[str, Any], above: str = '') -> Iterator[tuple[str, Any]]:
    """Yield name and value of parameters, nested ones with dots, as launch_ros makes them."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f'{above}{name}.')
        else:
            yield above + name, evaluated(above + name, value)


def evaluated(name: str, value: Any) -> Any:
    """Return a parameter's value; launch_ros reads plain strings as YAML once more."""
    if isinstance(value, ParameterValue):
        return value.value
    if isinstance(value, list):
        if not value or len({type(item) for item in value}) != 1:
            raise LaunchError(f'parameter {name} = {value}: empty, or of several types')
        return [evaluated(name, item) for item in value]
    if isinstance(value, str) and yaml.safe_load(value) != value:
        raise LaunchError(f'parameter {name} = {value!r} would become {yaml.safe_load(value)!r}')
    if not isinstance(value, bool | int | float | str):
        raise LaunchError(f'parameter {name} = {value!r}: ROS has no such type')
    return value


def performed(value: Any, context: Context) -> str:
    """Return what launch makes of a text or a substitution."""
    if isinstance(value, str):
        return value
    text: str = value.perform(context)
    return text


MODULES: dict[str, tuple[type, ...]] = {
    'launch': (LaunchDescription,),
    'launch.actions': (
        DeclareLaunchArgument,
        ExecuteProcess,
        GroupAction,
        IncludeLaunchDescription,
        LogInfo,
        OpaqueFunction,
        RegisterEventHandler,
        Shutdown,
    ),
    'launch.conditions': (IfCondition,),
    'launch.event_handlers': (OnProcessExit,),
    'launch.launch_description_sources': (PythonLaunchDescriptionSource,),
    'launch.substitutions': (LaunchConfiguration,),
    'launch_ros': (),
    'launch_ros.actions': (Node,),
    'launch_ros.parameter_descriptions': (ParameterValue,),
    'launch_ros.substitutions': (ExecutableInPackage,),
}


@contextmanager
def installed() -> Iterator[None]:
    """Let `import launch` find the stand-in, whatever else there is."""
    hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if of_launch(name)}
    for name, contents in MODULES.items():
        module = types.ModuleType(name)
        vars(module).update({each.__name__: each for each in contents})
        sys.modules[name] = module
    sys.modules['launch'].LaunchContext = Context  # type: ignore[attr-defined]
    try:
        yield
    finally:
        for name in MODULES:
            del sys.modules[name]
        sys.modules.update(hidden)


def of_launch(name: str) -> bool:
    return name.split('.')[0] in ('launch', 'launch_ros')


def description(path: Path) -> LaunchDescription:
    """Return what a launch file describes."""
    with installed():
        result = runpy.run_path(str(path))['generate_launch_description']()
    assert isinstance(result, LaunchDescription)
    return result


def declared_names(described: LaunchDescription) -> set[str]:
    """Return the arguments that a file declares itself."""
    return {each.name for each in described.entities if isinstance(each, DeclareLaunchArgument)}


def launched(path: Path, **arguments: str) -> Context:
    """Return what `ros2 launch FILE name:=value …` would start. Raises LaunchError."""
    described = description(path)
    unknown = sorted(set(arguments) - declared_names(described))
    if unknown:
        raise LaunchError(f'{path.name} does not declare {unknown}')
    context = Context(arguments)
    for entity in described.entities:
        entity.execute(context)
    return context
