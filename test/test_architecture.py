"""House rules that a reader relies on: one-way imports, small files, no rclpy in the core."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CORE = sorted((ROOT / 'gcl_core').rglob('*.py'))
# A file may import from its own layer and those below it.
LAYERS = [
    {
        'errors',
        'types',
        'se3',
        'config',
        'files',
        'progress',
        'stopwatch',
        'to_json',
        'provenance',
    },
    {'ops'},
    {'models', 'matching', 'estimation', 'compact'},
    {'registrar', 'view', 'data', 'losses'},
    {'training', 'evaluation', 'api'},
    {'cli', 'bench'},
]


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f'{node.module}.{alias.name}' for alias in node.names}
    return names


def layer(part: str) -> int:
    return next(i for i, names in enumerate(LAYERS) if part in names)


@pytest.mark.parametrize('path', CORE, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_one_way(path):
    parts = path.relative_to(ROOT / 'gcl_core').with_suffix('').parts
    if parts == ('__init__',):
        return
    for name in imports(path):
        assert not name.startswith('rclpy')
        if name.startswith('gcl_ros'):
            # only when called
            assert parts in {('cli', 'bag'), ('cli', 'simulate'), ('data', 'formats')}
        if name.startswith('gcl_core.'):
            assert layer(name.split('.')[1]) <= layer(parts[0]), name


@pytest.mark.parametrize('path', [*CORE, *sorted((ROOT / 'gcl_ros').rglob('*.py'))], ids=str)
def test_files_and_functions_are_small(path):
    assert len(path.read_text().splitlines()) <= 400
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 60, node.name
