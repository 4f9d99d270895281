"""The YAML files name every parameter with its default and a comment."""

from pathlib import Path

import pytest
import yaml

from gcl_ros.parameters import flatten
from gcl_ros.registrar_node import NodeConfig
from gcl_ros.sender_node import SenderConfig

ROOT = Path(__file__).parents[2]
# Explained by the comment over the one before.
TOGETHER = {
    *('target_mount', 'turn', 'still', 'k', 'spread', 'batch', 'seeds', 'members', 'local_steps'),
    *('keep', 'points', 'edge_ratio', 'samples', 'confidence', 'seed', 'level'),
    *('fine_tolerance', 'max_turn_deg'),
}


def dotted(values, prefix=''):
    found = {}
    for key, value in values.items():
        if isinstance(value, dict):
            found.update(dotted(value, f'{prefix}{key}.'))
        else:
            found[prefix + key] = value
    return found


@pytest.mark.parametrize(
    ('name', 'config'), [('registrar', NodeConfig()), ('sender', SenderConfig())]
)
def test_the_file_holds_every_parameter_and_its_default(name, config):
    content = yaml.safe_load((ROOT / 'config' / f'{name}.yaml').read_text())
    assert dotted(content['/**']['ros__parameters']) == flatten(config)


@pytest.mark.parametrize('name', ['registrar', 'sender'])
def test_a_comment_stands_over_every_parameter(name):
    """Over each, or over the first of some that it explains together, which are named here."""
    lines = (ROOT / 'config' / f'{name}.yaml').read_text().splitlines()
    under_comment = False
    for line in lines[lines.index('  ros__parameters:') + 1 :]:
        text = line.strip()
        if text.startswith('#'):
            under_comment = True
        elif text.endswith(':'):  # a group of parameters
            under_comment = False
        else:
            assert under_comment or text.split(':')[0] in TOGETHER, f'{line} has no comment'
            under_comment = False


def test_the_rviz_view_shows_what_the_node_publishes():
    view = yaml.safe_load((ROOT / 'rviz' / 'registrar.rviz').read_text())['Visualization Manager']
    topics = {d['Topic']['Value'] for d in view['Displays'] if 'Topic' in d}
    assert topics >= {'/registrar/aligned', '/registrar/matches', '/registrar/pose'}
