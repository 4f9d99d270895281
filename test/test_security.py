"""What an attacker may hope for is not there: pickles, code in data, weights without a hash."""

import ast
import hashlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = [
    *(path for name in ('gcl_core', 'gcl_ros', 'launch') for path in (ROOT / name).rglob('*.py')),
    ROOT / 'setup.py',
]
PICKLES = {'pickle', '_pickle', 'cPickle', 'dill', 'cloudpickle', 'joblib', 'shelve', 'marshal'}
# Calls that read or write pickles, or run what they read.
FORBIDDEN = {'torch.load', 'torch.save', 'torch.jit.load', 'torch.hub.load', 'pandas.read_pickle'}
FORBIDDEN |= {'yaml.load', 'yaml.load_all', 'yaml.unsafe_load', 'yaml.full_load', 'os.system'}
FORBIDDEN |= {'eval', 'exec', '__import__'}
NUMPY = {'numpy.load', 'numpy.save', 'numpy.savez', 'numpy.savez_compressed'}
OBJECTS = re.compile(r'torch\.distributed\.\w*object\w*')  # pickles between processes


def name_of(node: ast.expr, imported: dict[str, str]) -> str:
    """Dotted name of what is called, as its module calls it; empty where it is none."""
    if isinstance(node, ast.Attribute):
        return f'{name_of(node.value, imported)}.{node.attr}'
    return imported.get(node.id, node.id) if isinstance(node, ast.Name) else ''


def offences(text: str) -> list[str]:
    """What in a source may read or write a pickle, or run its input."""
    found, imported = [], {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name.split('.')[0] in PICKLES]
            imported |= {alias.asname: alias.name for alias in node.names if alias.asname}
        elif isinstance(node, ast.ImportFrom):
            parts = {(node.module or '').split('.')[0], *(alias.name for alias in node.names)}
            found += sorted(parts & PICKLES)
            imported |= {a.asname or a.name: f'{node.module}.{a.name}' for a in node.names}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            name = name_of(node.func, imported)
            options = {k.arg: getattr(k.value, 'value', None) for k in node.keywords}
            unsafe = name in NUMPY and options.get('allow_pickle', True)
            if name in FORBIDDEN or OBJECTS.fullmatch(name) or unsafe or options.get('shell'):
                found.append(name)
    return found


@pytest.mark.parametrize(
    'text',
    [
        'import pickle',
        'from torch.serialization import pickle',
        'torch.load(path)',
        'from torch import load\nload(path)',
        'import torch.distributed as dist\ndist.all_gather_object(found, value)',
        'import numpy as np\nnp.load(path)',
        'import numpy as np\nnp.load(path, allow_pickle=True)',
        'import numpy\nnumpy.save(path, array)',
        'subprocess.run(text, shell=True)',
        'yaml.load(text, Loader=yaml.Loader)',
    ],
)
def test_the_scan_sees_what_it_looks_for(text):
    assert offences(text)


def test_no_source_reads_or_writes_pickles_or_runs_its_input():
    assert len(SOURCES) > 100
    assert {str(path): offences(path.read_text()) for path in SOURCES} == {
        str(path): [] for path in SOURCES
    }


def test_all_shipped_weights_have_a_record_of_their_hash():
    weights = sorted((ROOT / 'gcl_core/models/weights').glob('*.safetensors'))
    assert weights
    for path in weights:
        record = json.loads(path.with_suffix('.json').read_text())
        assert record['sha256'] == hashlib.sha256(path.read_bytes()).hexdigest()
