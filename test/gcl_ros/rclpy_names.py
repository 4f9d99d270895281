"""What a version of rclpy offers, read from its source: `python rclpy_names.py FOLDER` as JSON.

`humble.json` is this of rclpy 3.3.15, from `rclpy/rclpy` of github.com/ros2/rclpy at that tag.
"""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path

Names = dict[str, list[str] | None]  # what a class holds, or a function takes; None: not known


def modules(folder: Path) -> dict[str, Names]:
    """Dotted module to the names at its top level."""
    found = {}
    for path in sorted(folder.rglob('*.py')):
        parts = ['rclpy', *path.relative_to(folder).with_suffix('').parts]
        if any(part.startswith('_') and part != '__init__' for part in parts):
            continue
        found['.'.join(parts).removesuffix('.__init__')] = _top(ast.parse(path.read_text()))
    return found


def _top(tree: ast.Module) -> Names:
    """Public names of a module; what is bound under `if` and `try` too."""
    names: Names = {}
    bodies = [tree.body]
    while bodies:
        for node in bodies.pop():
            if isinstance(node, ast.If | ast.Try):
                bodies += [node.body, node.orelse]
            elif isinstance(node, ast.ClassDef):
                names[node.name] = sorted(_members(node))
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                names[node.name] = parameters(node)
            elif isinstance(node, ast.Import | ast.ImportFrom):
                for alias in node.names:
                    names[alias.asname or alias.name.split('.')[0]] = None
            else:
                names |= dict.fromkeys(_bound(node))
    return {name: held for name, held in sorted(names.items()) if not name.startswith('_')}


def _bound(node: ast.AST) -> set[str]:
    """Names that a statement assigns."""
    return {
        n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }


def _members(kind: ast.ClassDef) -> set[str]:
    """Methods as `name(parameters)`, attributes of the class and of its objects."""
    found = set()
    for node in kind.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(f'{node.name}({", ".join(parameters(node))})')
            found |= {
                n.attr
                for n in ast.walk(node)
                if isinstance(n, ast.Attribute)
                and isinstance(n.ctx, ast.Store)
                and isinstance(n.value, ast.Name)
                and n.value.id == 'self'
            }
        else:
            found |= _bound(node)
    return found


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names of the parameters; `**` where any keyword is taken."""
    a = function.args
    every = [*a.posonlyargs, *a.args, *a.kwonlyargs]
    return [p.arg for p in every if p.arg not in ('self', 'cls')] + ['**'] * (a.kwarg is not None)


if __name__ == '__main__':
    lines = ',\n'.join(
        f'{json.dumps(k)}: {json.dumps(v)}' for k, v in modules(Path(sys.argv[1])).items()
    )
    print(f'{{\n{lines}\n}}')
