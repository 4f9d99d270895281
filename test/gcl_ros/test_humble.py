"""Humble's rclpy has every name that the package uses; Humble itself has no wheels to run on.

`humble.json` is what rclpy 3.3.15 offers, see `rclpy_names`.
"""

import ast
import importlib.util
import json
import sys
from collections import defaultdict
from pathlib import Path

import pytest
import rclpy

ROOT = Path(__file__).parents[2]
HUMBLE = json.loads(Path(__file__).with_name('humble.json').read_text())
SOURCES = sorted((ROOT / 'gcl_ros').rglob('*.py'))
ANYTHING = '**'


def _recorder():
    spec = importlib.util.spec_from_file_location(
        'rclpy_names', Path(__file__).with_name('rclpy_names.py')
    )
    module = sys.modules['rclpy_names'] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


recorder = _recorder()
HERE = recorder.modules(Path(rclpy.__file__).parent)


def attributes(offered):
    """Attributes of all classes, and by the name of what is called the keywords that it takes."""
    held, keywords = set(), defaultdict(set)
    for names in offered.values():
        for name, members in names.items():
            if members is None:
                continue
            split = [member.removesuffix(')').partition('(') for member in members]
            held |= {member for member, _, _ in split}
            if not any(bracket for _, bracket, _ in split):
                keywords[name] |= set(members)
            for member, bracket, taken in split:
                if bracket:
                    called = name if member in ('__init__', '__new__') else member
                    keywords[called] |= set(taken.split(', '))
    return held, keywords


def own_names(trees):
    """Attributes and keywords that these sources define themselves."""
    held, keywords = set(), defaultdict(set)
    for tree in trees:
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                held.add(node.name)
                keywords[node.name] |= set(recorder.parameters(node))
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                held.add(node.attr)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                held.add(node.id)
            elif isinstance(node, ast.ClassDef):
                fields = {n.target.id for n in node.body if isinstance(n, ast.AnnAssign)}
                held |= fields
                keywords[node.name] |= fields | {ANYTHING}
    return held, keywords


HELD, KEYWORDS = attributes(HUMBLE)
NEW = attributes(HERE)[0] - HELD  # attributes that came after Humble
CORE = sorted((ROOT / 'gcl_core').rglob('*.py'))
OWN, OWN_KEYWORDS = own_names([ast.parse(path.read_text()) for path in [*SOURCES, *CORE]])


def imported(tree):
    """Local names from rclpy, and where each is from: module and name, or a module."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split('.')[0] == 'rclpy':
                    found[alias.asname or 'rclpy'] = alias.name
        elif isinstance(node, ast.ImportFrom) and (node.module or '').split('.')[0] == 'rclpy':
            for alias in node.names:
                found[alias.asname or alias.name] = f'{node.module}.{alias.name}'
    return found


def exists(dotted):
    """Whether Humble has a module, or a name in one."""
    module, _, name = dotted.rpartition('.')
    return dotted in HUMBLE or name in HUMBLE.get(module, ())


def of_c(value, names):
    """Whether this is a class that Humble takes from C, where its members are written."""
    module, _, name = names.get(getattr(value, 'id', None), '').rpartition('.')
    return name in HUMBLE.get(module, ()) and HUMBLE[module][name] is None


def missing(text):
    """What a source uses that Humble does not have."""
    tree = ast.parse(text)
    names = imported(tree)
    if not names:
        return set()
    found = {dotted for dotted in names.values() if not exists(dotted)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            if isinstance(node.value, ast.Name) and names.get(node.value.id) in HUMBLE:
                dotted = f'{names[node.value.id]}.{node.attr}'
                found |= set() if exists(dotted) else {dotted}
            elif node.attr in NEW - OWN and not of_c(node.value, names):
                found.add(f'.{node.attr}')
        elif isinstance(node, ast.Call):
            found |= unknown_keywords(node)
        elif isinstance(node, ast.withitem) and isinstance(node.context_expr, ast.Call):
            called = ast.unparse(node.context_expr.func)
            if called.split('.')[0] in names:
                found.add(f'with {called}')
    return found


def unknown_keywords(call):
    """Keywords of a call that no function of that name takes, here or in Humble."""
    name = getattr(call.func, 'attr', getattr(call.func, 'id', None))
    if name not in KEYWORDS:
        return set()
    known = KEYWORDS[name] | OWN_KEYWORDS[name]
    given = {keyword.arg for keyword in call.keywords if keyword.arg}
    return set() if ANYTHING in known else {f'{name}({keyword}=)' for keyword in given - known}


@pytest.mark.parametrize('path', SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_humble_has_what_is_used(path):
    assert missing(path.read_text()) == set()


@pytest.mark.parametrize(
    ('line', 'wanting'),
    [
        ('from rclpy.clock_type import ClockType', {'rclpy.clock_type.ClockType'}),
        ('from rclpy.clock import ClockType; ClockType.STEADY_TIME', set()),
        ('with rclpy.init(): pass', {'with rclpy.init'}),
        ('node.add_pre_set_parameters_callback(f)', {'.add_pre_set_parameters_callback'}),
        ('rclpy.init(domain_id=3, signal_handler_options=None)', set()),
        ('rclpy.init(domain=3)', {'init(domain=)'}),
        ('node.create_subscription(a, b, c, d, raw=True)', set()),
        (
            'node.create_subscription(a, b, c, d, content_filter_options=e)',
            {'create_subscription(content_filter_options=)'},
        ),
        ('rclpy.spin_forever(node)', {'rclpy.spin_forever'}),
    ],
)
def test_what_humble_lacks_is_found(line, wanting):
    assert missing(f'import rclpy\n{line}') == wanting
