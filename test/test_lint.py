"""The checkers that `make lint type` runs find a name that nothing defines."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SHAPES = """
import numpy as np
from jaxtyping import Float


def shapes(a: Float[np.ndarray, ' n'], b: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, '*n 6 6']:
    \"\"\"Axes are no undefined names.\"\"\"
    return a + b
"""
UNDEFINED = {
    'in a function': 'def f() -> int:\n    """Do it."""\n    return undefined\n',
    'in an annotation': 'def f(x: Undefined) -> None:\n    """Do it."""\n',
    'in a quoted annotation': 'def f(x: \'dict[str, Undefined]\') -> None:\n    """Do it."""\n',
}
CHECKERS = {
    'ruff': ['ruff', 'check', '--no-cache', '--config', 'pyproject.toml'],
    'mypy': ['mypy', '--config-file', 'pyproject.toml'],
}


def check(checker: str, folder: Path, code: str) -> subprocess.CompletedProcess:
    path = folder / 'checked.py'
    path.write_text(f'"""A module."""\n\nfrom __future__ import annotations\n{code}')
    cache = ['--cache-dir', str(folder)] if checker == 'mypy' else []
    return subprocess.run(
        [sys.executable, '-m', *CHECKERS[checker], *cache, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize('kind', UNDEFINED)
def test_ruff_finds_an_undefined_name(kind, tmp_path):
    done = check('ruff', tmp_path, '\n\n' + UNDEFINED[kind])
    assert done.returncode == 1
    assert 'F821' in done.stdout


@pytest.mark.parametrize('kind', UNDEFINED)
def test_mypy_finds_an_undefined_name(kind, tmp_path):
    done = check('mypy', tmp_path, '\n\n' + UNDEFINED[kind])
    assert done.returncode == 1
    assert 'is not defined' in done.stdout


def test_the_axes_of_shapes_are_none(tmp_path):
    done = check('ruff', tmp_path, SHAPES)
    assert 'F821' not in done.stdout
    done = check('mypy', tmp_path, SHAPES)
    assert 'is not defined' not in done.stdout
    assert 'syntax' not in done.stdout
