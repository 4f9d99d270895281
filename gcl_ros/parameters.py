"""ROS parameters from the config dataclasses: the keys and the checks of the YAML files."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from gcl_core.config import from_mapping
from gcl_core.errors import GclError

T = TypeVar('T')
BUILT_IN = ('use_sim_time', 'start_type_description_service', 'qos_overrides')


def flatten(config: Any, prefix: str = '') -> dict[str, Any]:
    """Dotted names and default values of a dataclass and those within it."""
    values: dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            values.update(flatten(value, f'{prefix}{field.name}.'))
        else:
            values[prefix + field.name] = list(value) if isinstance(value, tuple) else value
    return values


def declare(node: Node, kind: type[T]) -> T:
    """Declare every field of `kind` on the node and read the values back.

    Raises:
        GclError: a parameter was given that does not exist, or a value does not fit.
    """
    defaults = flatten(kind())
    given = list(node._parameter_overrides)  # no public way to see overrides before declaring
    unknown = [n for n in given if n not in defaults and not n.startswith(BUILT_IN)]
    if unknown:
        known = ', '.join(defaults)
        raise GclError(f'unknown parameter {", ".join(sorted(unknown))}; known are {known}')
    nested: dict[str, Any] = {}
    descriptor = ParameterDescriptor(read_only=True, dynamic_typing=True)
    for name, default in defaults.items():
        value = node.declare_parameter(name, default, descriptor).value
        target = nested
        *path, leaf = name.split('.')
        for part in path:
            target = target.setdefault(part, {})
        target[leaf] = value
    return from_mapping(kind, nested, f'parameters of {node.get_name()}')
