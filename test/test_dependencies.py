"""setup.py, package.xml, constraints.txt and docs/install.md speak of the same dependencies."""

import ast
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Where rosdep has a key, it is this one; the rest comes by pip.
ROSDEP = {
    'numpy': 'python3-numpy',
    'scipy': 'python3-scipy',
    'pyyaml': 'python3-yaml',
    'matplotlib': 'python3-matplotlib',
    'tqdm': 'python3-tqdm',
}
WITH_ROS_ONLY = {'launch', 'launch_ros', 'tf2_ros_py'}  # no wheels of them
OPTIONAL = {
    'argcomplete',
    'kiss_matcher',
    'rerun',
    'tf2_ros',
    'spconv',
    'atheris',
    'packaging',
    'DracoPy',
}
WHEELS_ONLY = {'rmw_fastrtps_cpp'}  # a ROS installation has a middleware


def names(requirements):
    """Names of packages as pip compares them."""
    return {re.split(r'[<>=!;\[ ]', line)[0].lower().replace('_', '-') for line in requirements}


@pytest.fixture(scope='module')
def setup():
    """What setup.py tells setuptools."""
    tree = ast.parse((ROOT / 'setup.py').read_text())
    call = next(n for n in ast.walk(tree) if isinstance(n, ast.Call) and n.keywords)
    told = {k.arg: k.value for k in call.keywords}
    extras = zip(told['extras_require'].keys, told['extras_require'].values)
    (packages,) = (
        ast.literal_eval(n.value)
        for n in tree.body
        if isinstance(n, ast.Assign) and n.targets[0].id == 'ROS_PACKAGES'
    )
    return {
        'install': names(ast.literal_eval(told['install_requires'])),
        'requirements': ast.literal_eval(told['install_requires']),
        'tools': names(next(ast.literal_eval(v) for k, v in extras if k.value == 'dev')),
        'license': told['license'].value,
        'python': told['python_requires'].value,
        'ros': {package.replace('-', '_') for package in packages},
    }


@pytest.fixture(scope='module')
def manifest():
    return ET.parse(ROOT / 'package.xml').getroot()


def test_the_manifest_names_what_setup_needs(setup, manifest):
    wanted = {node.text for node in manifest.findall('exec_depend')}
    packages = {ROSDEP[name] for name in setup['install'] & set(ROSDEP)}
    assert wanted == (setup['ros'] - WHEELS_ONLY) | WITH_ROS_ONLY | packages


def test_the_manifest_says_what_comes_by_pip(setup):
    (comment,) = re.findall(r'<!-- (.*) come by pip', (ROOT / 'package.xml').read_text())
    listed = names(re.split(', | and ', comment))
    assert listed == {n.removesuffix('-cpu') for n in setup['install']} - set(ROSDEP)


def test_beside_ros_all_of_it_comes_by_pip(setup):
    """Debian's matplotlib and scipy are built for another numpy than the one that pip brings."""
    page = (ROOT / 'docs/install.md').read_text().replace('\\\n', '')
    (line,) = re.findall(r'pip install -c src/gcl_ros/constraints.txt (.*)', page)
    assert names(line.split()) == setup['install'] - {'open3d'}


def test_the_manifest_says_who_and_where(manifest):
    assert manifest.findtext('author')
    assert manifest.findtext('url').startswith('https://')


def test_the_licence_is_the_same(setup, manifest):
    assert manifest.findtext('license') == setup['license']


def test_constraints_pin_what_is_installed(setup):
    lines = (ROOT / 'constraints.txt').read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith('#')]
    assert all('==' in pin for pin in pins)
    assert names(pins) <= setup['install'] | setup['tools']


def test_the_lowest_constraints_are_what_setup_allows(setup):
    """`make test-lowest` installs them: a lower bound that is not tried is a guess."""
    lines = (ROOT / 'constraints-lowest.txt').read_text().splitlines()
    pins = {line for line in lines if not line.startswith('#')}
    bounds = (line.split(';')[0].strip() for line in setup['requirements'])
    assert pins == {line.replace('>=', '==') for line in bounds if not line.startswith('open3d>')}


def private(path):
    """Attributes of torch that are its own business."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and node.attr.startswith('_'):
            whole = ast.unparse(node)
            if whole.startswith('torch.') and not node.attr.startswith('__'):
                yield whole


@pytest.mark.parametrize('package', ['gcl_core', 'gcl_ros'])
def test_nothing_private_of_torch_is_used(package):
    """It comes and goes between the versions that setup.py allows."""
    found = {
        (path.name, name) for path in (ROOT / package).rglob('*.py') for name in private(path)
    }
    assert found == set()


def modules(path):
    """Top-level names of everything a file imports, at its head or when it is called."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.split('.')[0]


def test_imports_are_declared(setup):
    declared = {name.replace('-', '_') for name in setup['install']} | setup['ros']
    known = declared | {'yaml', 'gcl_core', 'gcl_ros'} | OPTIONAL | set(sys.stdlib_module_names)
    for path in [*(ROOT / 'gcl_core').rglob('*.py'), *(ROOT / 'gcl_ros').rglob('*.py')]:
        assert set(modules(path)) <= known, path


def test_the_lowest_python_is_said_everywhere(setup):
    lowest = setup['python'].removeprefix('>=')
    tools = (ROOT / 'pyproject.toml').read_text()
    assert f'python_version = "{lowest}"' in tools
    assert f'target-version = "py{lowest.replace(".", "")}"' in tools
    assert (
        f'target-version = "py{lowest.replace(".", "")}"' in (ROOT / 'pyproject.toml').read_text()
    )
    assert f'Python {lowest} to' in (ROOT / 'docs/install.md').read_text()
