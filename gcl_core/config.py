"""Strict YAML into frozen dataclasses; an unknown key or a wrong type is named in the error."""

from __future__ import annotations

import dataclasses
import json
import reprlib
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml

from gcl_core.errors import GclError

T = TypeVar('T')


def load_config(kind: type[T], path: Path, settings: Sequence[str] = ()) -> T:
    """Read a YAML file into `kind`; keys left out keep their defaults.

    Args:
        kind: dataclass.
        path: YAML file.
        settings: `KEY.KEY=VALUE` each, taken instead of what the file says; the value is YAML.

    Raises:
        GclError: the file is missing or no YAML, a key is unknown, or a value has the wrong type.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise GclError(f'cannot read config {path}: {error.strerror}') from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise GclError(f'{path} is not valid YAML: {error}') from None
    content = content or {}
    for setting in settings:
        _set(content, setting)
    return from_mapping(kind, content, str(path))


def _set(content: Any, setting: str) -> None:
    """Put one `KEY.KEY=VALUE` into nested mappings."""
    keys, equals, value = setting.partition('=')
    *outer, last = keys.split('.')
    for key in outer:
        content = content.setdefault(key, {}) if isinstance(content, dict) else None
    if not equals or not isinstance(content, dict):
        raise GclError(f'{setting!r} sets nothing; expected KEY.KEY=VALUE')
    try:
        content[last] = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise GclError(f'{setting!r}: {value!r} is not valid YAML: {error}') from None


def read_json(path: Path, remedy: str, **options: Any) -> Any:
    """Read a JSON file.

    Args:
        path: file.
        remedy: what to do where it cannot be read.
        options: of `json.load`.

    Raises:
        GclError: missing, or no JSON.
    """
    try:
        with path.open(encoding='utf-8') as file:
            return json.load(file, **options)
    except OSError as error:
        raise GclError(f'no file {path} ({error.strerror}); {remedy}') from None
    except (ValueError, RecursionError) as error:
        raise GclError(f'{path} is not valid JSON: {error}; {remedy}') from None


def from_mapping(kind: type[T], values: Any, where: str) -> T:
    """Build a dataclass from nested mappings; `where` names the origin in errors."""
    if not isinstance(values, Mapping):
        raise GclError(f'{where}: expected a mapping of keys, got {type(values).__name__}')
    hints = typing.get_type_hints(kind)
    declared = dataclasses.fields(kind)  # type: ignore[arg-type]
    fields = {f.name for f in declared}
    for key in values:
        if key not in fields:
            raise GclError(
                f'{where}: unknown key {_short(key)}; known are {", ".join(sorted(fields))}'
            )
    for field in declared:
        optional = {field.default, field.default_factory} != {dataclasses.MISSING}
        if field.name not in values and not optional:
            raise GclError(f'{where}: key {field.name!r} is missing')
    return kind(**{k: _convert(hints[k], v, f'{where}: {k}') for k, v in values.items()})


def _convert(hint: Any, value: Any, where: str) -> Any:
    """Check a value against a type hint; integers serve as floats, lists as tuples."""
    if dataclasses.is_dataclass(hint):
        return from_mapping(typing.cast(type, hint), value, where)
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise GclError(f'{where}: expected a list, got {_short(value)}')
        inner = args[:1] * len(value) if args[-1] is Ellipsis else args
        if len(inner) != len(value):
            raise GclError(f'{where}: expected {len(inner)} values, got {len(value)}')
        return tuple(_convert(h, v, where) for h, v in zip(inner, value, strict=True))
    if origin is typing.Literal:
        if value not in args:
            raise GclError(f'{where}: {_short(value)} is none of {", ".join(map(str, args))}')
        return value
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in args:
            return None
        kinds = [a for a in args if a is not type(None)]
        return _convert(_chosen(kinds, value, where), value, where)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        if abs(value) > 1e300:
            raise GclError(f'{where}: {_short(value)} is too large')
        return float(value)
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise GclError(f'{where}: expected {hint.__name__}, got {_short(value)}')
    return value


def _short(value: Any) -> str:
    """A value in an error: YAML's references can make one that fills the memory if printed."""
    return reprlib.repr(value)


def _chosen(kinds: list[Any], value: Any, where: str) -> Any:
    """Of several dataclasses, the one whose `Literal` field has the value given; else the first.

    Such a field, `backbone` for instance, must be there in each of them.
    """
    if len(kinds) == 1 or not isinstance(value, Mapping):
        return kinds[0]
    hints = [typing.get_type_hints(kind) for kind in kinds]
    for key in value:
        if all(typing.get_origin(hint.get(key)) is typing.Literal for hint in hints):
            names = [typing.get_args(hint[key]) for hint in hints]
            for kind, own in zip(kinds, names, strict=True):
                if value[key] in own:
                    return kind
            known = ', '.join(str(name) for own in names for name in own)
            raise GclError(f'{where}: {key}: {_short(value[key])} is none of {known}')
    return kinds[0]
