"""ROS parameters from the config dataclasses: the keys and the checks of the YAML files."""

from __future__ import annotations

import array
import dataclasses
import difflib
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from gcl_core.config import from_mapping
from gcl_core.errors import GclError
from gcl_ros.field_docs import choices, descriptions
from gcl_ros.ranges import range_of

C = TypeVar('C')
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


class Parameters(Generic[C]):
    """The parameters of a node, one for each field of a config dataclass.

    What is given at start is kept as it is, right or wrong, until `read` says what is wrong: a
    node that starts with a wrong value lives, and the value can be set right.

    Args:
        node: to declare them on.
        kind: the dataclass; its docstring gives the descriptions.
    """

    def __init__(self, node: Node, kind: type[C]) -> None:
        self._node, self._kind = node, kind
        self.defaults = flatten(kind())
        given = node._parameter_overrides  # no public way to see them before declaring
        given.update({name: self.fitted(parameter) for name, parameter in given.items()})
        self._unknown = [
            name for name in given if name not in self.defaults and not name.startswith(BUILT_IN)
        ]
        self._refused: dict[str, str] = {}
        texts, allowed = descriptions(kind), choices(kind)
        for name, default in self.defaults.items():
            self._declare(name, default, _descriptor(name, default, texts[name], allowed))

    def _declare(self, name: str, default: Any, descriptor: ParameterDescriptor) -> None:
        try:
            self._node.declare_parameter(name, default, descriptor)
        except InvalidParameterValueException:
            given = self._node._parameter_overrides[name].value
            try:
                _check_range(name, given)
            except GclError as reason:
                self._refused[name] = str(reason)
            self._node.declare_parameter(name, default, descriptor, ignore_override=True)

    def fitted(self, parameter: Parameter) -> Parameter:
        """The parameter as a float, or floats, where it is that and was given without a point.

        Types are dynamic, so that ROS would turn it into an integer for good.
        """
        default, value = self.defaults.get(parameter.name), parameter.value
        if isinstance(default, float) and type(value) is int:
            return Parameter(parameter.name, value=float(value))
        if parameter.type_ == Parameter.Type.INTEGER_ARRAY and isinstance(default, list):
            return Parameter(parameter.name, value=[float(number) for number in value])
        return parameter

    def read(self, changes: Mapping[str, Any] | None = None) -> C:
        """Build the config from the values set, with changes to come.

        Raises:
            GclError: a parameter was given that does not exist, or a value does not fit.
        """
        if self._unknown:
            wrong = '; '.join(f'{name}{self._nearest(name)}' for name in sorted(self._unknown))
            raise GclError(f'unknown parameter {wrong}; start the node anew without it')
        changes = changes or {}
        if wrong := [reason for name, reason in self._refused.items() if name not in changes]:
            raise GclError('; '.join(wrong))
        values = {
            name: changes.get(name, self._node.get_parameter(name).value) for name in self.defaults
        }
        for name, value in values.items():
            if isinstance(value, array.array):  # a list, as it comes over a service
                values[name] = value.tolist()
        return from_mapping(self._kind, _nested(values), f'parameters of {self._node.get_name()}')

    def _nearest(self, name: str) -> str:
        """What may be meant by a name that does not exist."""
        within = [known for known in self.defaults if known.endswith(f'.{name}')]
        known = within or difflib.get_close_matches(name, self.defaults)
        return f' (did you mean {" or ".join(known)}?)' if known else ''

    def settled(self, names: Mapping[str, Any]) -> None:
        """Forget what was wrong with the start values of parameters that have been set since."""
        for name in names:
            self._refused.pop(name, None)


def _check_range(name: str, value: Any) -> None:
    """Refuse a number outside its range."""
    limits = range_of(name)
    if limits and isinstance(value, int | float) and not limits[0] <= value <= limits[1]:
        low, high = limits
        raise GclError(f'{name} is {value}; it must lie between {low:g} and {high:g}')


def _descriptor(
    name: str, default: Any, text: str, allowed: Mapping[str, tuple[Any, ...]]
) -> ParameterDescriptor:
    # Dynamic typing: a wrong type at start is kept until `read` refuses it with a reason.
    descriptor = ParameterDescriptor(description=text, dynamic_typing=True)
    if name in allowed:
        descriptor.additional_constraints = f'one of {", ".join(map(str, allowed[name]))}'
    if limits := range_of(name):
        low, high = limits
        if isinstance(default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        else:
            between = FloatingPointRange(from_value=float(low), to_value=float(high))
            descriptor.floating_point_range = [between]
    return descriptor


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for name, value in values.items():
        target = nested
        *path, leaf = name.split('.')
        for part in path:
            target = target.setdefault(part, {})
        target[leaf] = value
    return nested
