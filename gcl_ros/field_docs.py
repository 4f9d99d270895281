"""What the docstrings of config dataclasses say about each field, for parameter descriptions."""

from __future__ import annotations

import dataclasses
import inspect
import re
import typing
from typing import Any


def descriptions(kind: type, prefix: str = '') -> dict[str, str]:
    """Dotted field name to the text under `Attributes:`, of a dataclass and those within it."""
    hints = typing.get_type_hints(kind)
    own = _attributes(inspect.getdoc(kind) or '')
    found: dict[str, str] = {}
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        if dataclasses.is_dataclass(hint):
            found.update(descriptions(typing.cast(type, hint), f'{prefix}{field.name}.'))
        else:
            found[prefix + field.name] = own.get(field.name, '')
    return found


def choices(kind: type, prefix: str = '') -> dict[str, tuple[Any, ...]]:
    """Dotted name to the values allowed, of the fields that are a `Literal`."""
    found: dict[str, tuple[Any, ...]] = {}
    for name, hint in typing.get_type_hints(kind).items():
        if dataclasses.is_dataclass(hint):
            found.update(choices(typing.cast(type, hint), f'{prefix}{name}.'))
        elif typing.get_origin(hint) is typing.Literal:
            found[prefix + name] = typing.get_args(hint)
    return found


def _attributes(docstring: str) -> dict[str, str]:
    """Field name to its text, the lines of which are joined."""
    _, _, section = docstring.partition('Attributes:\n')
    found: dict[str, str] = {}
    name = ''
    for line in section.splitlines():
        if line.strip() and not line.startswith(' '):
            break
        if match := re.match(r'    (\w+): (.*)', line):
            name, text = match.groups()
            found[name] = text
        elif name and line.strip():
            found[name] += ' ' + line.strip()
    return found
