"""A stand-in for ROS 2's `launch` and `launch_ros`, which are on no package index.

It evaluates what the launch files of this package use, with the keyword arguments that the real
classes take, and records the nodes that would be started instead of starting them.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any


@dataclass
class Context:
    """What a launch knows while it runs.

    Attributes:
        share: folder that FindPackageShare gives, by package.
        configurations: launch arguments.
        environment: of the processes.
        started: nodes, in order.
        declared: descriptions of the arguments, by name.
        on_exit: what follows the exit of an action.
    """

    share: dict[str, Path]
    configurations: dict[str, str]
    environment: dict[str, str] = field(default_factory=dict)
    started: list[Started] = field(default_factory=list)
    declared: dict[str, str | None] = field(default_factory=dict)
    on_exit: list[tuple[Any, list[Any]]] = field(default_factory=list)


@dataclass
class Started:
    """A node as it would be started, all substitutions made."""

    action: Any
    package: str
    executable: str
    namespace: str
    parameters: list[str | dict[str, str]]
    remappings: list[tuple[str, str]]
    arguments: list[str]
    name: str
    respawn: str

    @property
    def ros_arguments(self) -> list[str]:
        """What the process gets after `--ros-args`."""
        parts = ['-r', f'__ns:=/{self.namespace.strip("/")}'] if self.namespace else []
        parts += ['-r', f'__node:={self.name}'] if self.name else []
        for given in self.parameters:
            if isinstance(given, str):
                parts += ['--params-file', given]
            else:
                parts += [part for k, v in given.items() for part in ('-p', f'{k}:={v}')]
        return parts + [part for a, b in self.remappings for part in ('-r', f'{a}:={b}')]


def perform(value: Any, context: Context) -> str:
    """Text of a substitution, a string, or a list of both."""
    if isinstance(value, str):
        return value
    if isinstance(value, list | tuple):
        return ''.join(perform(part, context) for part in value)
    return value.perform(context)


class LaunchConfiguration:
    def __init__(self, variable_name: str) -> None:
        self.name = variable_name

    def perform(self, context: Context) -> str:
        if self.name not in context.configurations:
            raise RuntimeError(f"launch configuration '{self.name}' does not exist")
        return context.configurations[self.name]


class EnvironmentVariable:
    def __init__(self, name: str, *, default_value: Any = None) -> None:
        self.name, self.default = name, default_value

    def perform(self, context: Context) -> str:
        if self.name in context.environment:
            return context.environment[self.name]
        if self.default is None:
            raise RuntimeError(f"environment variable '{self.name}' does not exist")
        return perform(self.default, context)


class PathJoinSubstitution:
    def __init__(self, substitutions: Iterable[Any]) -> None:
        self.parts = list(substitutions)

    def perform(self, context: Context) -> str:
        return os.path.join(*(perform(part, context) for part in self.parts))


class PythonExpression:
    def __init__(self, expression: Any) -> None:
        self.expression = expression

    def perform(self, context: Context) -> str:
        return str(eval(perform(self.expression, context), {}))


class FindPackageShare:
    def __init__(self, package: str) -> None:
        self.package = package

    def perform(self, context: Context) -> str:
        return str(context.share[self.package])


class IfCondition:
    def __init__(self, predicate_expression: Any) -> None:
        self.predicate = predicate_expression

    def evaluate(self, context: Context) -> bool:
        text = perform(self.predicate, context).lower()
        if text not in ('true', 'false', '1', '0'):
            raise RuntimeError(f'{text!r} is no condition')
        return text in ('true', '1')


class LaunchDescription:
    def __init__(self, initial_entities: list[Any]) -> None:
        self.entities = initial_entities

    def visit(self, context: Context) -> None:
        for entity in self.entities:
            entity.visit(context)


class Action:
    def __init__(self, *, condition: IfCondition | None = None) -> None:
        self.condition = condition

    def visit(self, context: Context) -> None:
        if self.condition is None or self.condition.evaluate(context):
            self.execute(context)

    def execute(self, context: Context) -> None:
        raise NotImplementedError


class DeclareLaunchArgument(Action):
    def __init__(
        self,
        name: str,
        *,
        default_value: Any = None,
        description: str | None = None,
        choices: list[str] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.name, self.default, self.choices = name, default_value, choices
        self.description = description

    def execute(self, context: Context) -> None:
        context.declared[self.name] = self.description
        if self.name not in context.configurations:
            if self.default is None:
                raise RuntimeError(f'Required launch argument "{self.name}" was not provided')
            context.configurations[self.name] = perform(self.default, context)
        if self.choices and context.configurations[self.name] not in self.choices:
            raise RuntimeError(f'{context.configurations[self.name]!r} is none of {self.choices}')


class SetEnvironmentVariable(Action):
    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.name, self.value = name, value

    def execute(self, context: Context) -> None:
        context.environment[perform(self.name, context)] = perform(self.value, context)


class GroupAction(Action):
    """Scoped, as it is by default: what is set within does not leave it."""

    def __init__(self, actions: Iterable[Action], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.actions = list(actions)

    def execute(self, context: Context) -> None:
        outside = dict(context.configurations), dict(context.environment)
        for action in self.actions:
            action.visit(context)
        context.configurations, context.environment = outside


class PythonLaunchDescriptionSource:
    def __init__(self, launch_file_path: Any) -> None:
        self.path = launch_file_path


class IncludeLaunchDescription(Action):
    """Not scoped, as it is not."""

    def __init__(
        self,
        launch_description_source: PythonLaunchDescriptionSource,
        *,
        launch_arguments: Iterable[tuple[Any, Any]] = (),
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.source, self.arguments = launch_description_source, list(launch_arguments)

    def execute(self, context: Context) -> None:
        for name, value in self.arguments:
            context.configurations[perform(name, context)] = perform(value, context)
        load(Path(perform(self.source.path, context))).visit(context)


class Shutdown(Action):
    def __init__(self, *, reason: str = '', **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.reason = reason


class OnProcessExit:
    def __init__(self, *, target_action: Any = None, on_exit: Any = None) -> None:
        self.target_action, self.on_exit = target_action, on_exit


class RegisterEventHandler(Action):
    def __init__(self, event_handler: OnProcessExit, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.handler = event_handler

    def execute(self, context: Context) -> None:
        context.on_exit.append((self.handler.target_action, self.handler.on_exit))


class Node(Action):
    def __init__(
        self,
        *,
        executable: Any,
        package: Any,
        name: Any = '',
        namespace: Any = '',
        parameters: list[Any] | None = None,
        remappings: list[tuple[Any, Any]] | None = None,
        arguments: Iterable[Any] = (),
        output: str = 'log',
        respawn: Any = 'false',
        respawn_delay: float | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        assert output in ('log', 'screen', 'both')
        assert respawn_delay is None or respawn_delay > 0
        self.name, self.respawn = name, respawn
        self.package, self.executable, self.namespace = package, executable, namespace
        self.parameters, self.remappings = parameters or [], remappings or []
        self.arguments = list(arguments)

    def execute(self, context: Context) -> None:
        def text(value: Any) -> str:
            return perform(value, context)

        parameters = [
            {key: text(value) for key, value in p.items()} if isinstance(p, dict) else text(p)
            for p in self.parameters
        ]
        started = Started(
            self,
            text(self.package),
            text(self.executable),
            text(self.namespace),
            parameters,
            [(text(a), text(b)) for a, b in self.remappings],
            [text(argument) for argument in self.arguments],
            text(self.name),
            text(self.respawn),
        )
        context.started.append(started)


MODULES = {
    'launch': [LaunchDescription],
    'launch.actions': [
        DeclareLaunchArgument,
        GroupAction,
        IncludeLaunchDescription,
        RegisterEventHandler,
        SetEnvironmentVariable,
        Shutdown,
    ],
    'launch.conditions': [IfCondition],
    'launch.event_handlers': [OnProcessExit],
    'launch.launch_description_sources': [PythonLaunchDescriptionSource],
    'launch.substitutions': [
        EnvironmentVariable,
        LaunchConfiguration,
        PathJoinSubstitution,
        PythonExpression,
    ],
    'launch_ros': [],
    'launch_ros.actions': [Node],
    'launch_ros.substitutions': [FindPackageShare],
}


@contextmanager
def stand_in() -> Iterator[None]:
    """Let `import launch` find this file's classes, and nothing else of that name."""
    saved = {name: sys.modules.get(name) for name in MODULES}
    for name, classes in MODULES.items():
        module = ModuleType(name)
        for kind in classes:
            setattr(module, kind.__name__, kind)
        sys.modules[name] = module
    try:
        yield
    finally:
        for name, module in saved.items():
            sys.modules.pop(name)
            if module is not None:
                sys.modules[name] = module


def load(path: Path) -> LaunchDescription:
    """Execute a launch file."""
    spec = importlib.util.spec_from_file_location(path.stem.replace('.', '_'), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.generate_launch_description()


def launched(path: Path, share: Path, **arguments: str) -> Context:
    """What `ros2 launch` would start with these arguments."""
    context = Context({'gcl_ros': share}, dict(arguments))
    with stand_in():
        load(path).visit(context)
    return context
