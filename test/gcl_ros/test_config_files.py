"""The YAML files name every parameter with its default and a comment; the launch files exist."""

import ast
from pathlib import Path

import pytest
import yaml

from gcl_ros.describer_node import DescriberConfig
from gcl_ros.parameters import flatten
from gcl_ros.registrar_node import NodeConfig

ROOT = Path(__file__).parents[2]
LAUNCH = sorted((ROOT / 'launch').glob('*.launch.py'))


def dotted(values, prefix=''):
    found = {}
    for key, value in values.items():
        if isinstance(value, dict):
            found.update(dotted(value, f'{prefix}{key}.'))
        else:
            found[prefix + key] = value
    return found


@pytest.mark.parametrize(
    ('name', 'config'), [('registrar', NodeConfig()), ('describer', DescriberConfig())]
)
def test_the_file_holds_every_parameter_and_its_default(name, config):
    content = yaml.safe_load((ROOT / 'config' / f'{name}.yaml').read_text())
    assert dotted(content['/**']['ros__parameters']) == flatten(config)


def test_the_rviz_view_shows_what_the_node_publishes():
    view = yaml.safe_load((ROOT / 'rviz' / 'registrar.rviz').read_text())['Visualization Manager']
    topics = {d['Topic']['Value'] for d in view['Displays'] if 'Topic' in d}
    assert topics >= {'/registrar/aligned', '/registrar/matches', '/registrar/pose'}


@pytest.mark.parametrize('path', LAUNCH, ids=lambda p: p.name)
def test_launch_files_start_programs_that_are_installed(path):
    setup = (ROOT / 'setup.py').read_text()
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    nodes = [
        {k.arg: k.value.value for k in c.keywords if isinstance(k.value, ast.Constant)}
        for c in calls
        if getattr(c.func, 'id', '') == 'Node'
    ]
    own = [node['executable'] for node in nodes if node['package'] == 'gcl_ros']
    assert own
    for executable in own:
        assert f"'{executable} = gcl_ros." in setup


@pytest.mark.parametrize('path', LAUNCH, ids=lambda p: p.name)
def test_launch_files_describe_a_launch(path):
    pytest.importorskip('launch_ros', reason='launch comes with a ROS installation only')
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    assert get_launch_description_from_python_launch_file(str(path)).entities
