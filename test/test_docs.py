"""The guides say what is there: their commands parse, links lead somewhere, examples run."""

import argparse
import importlib
import re
import shlex
import sys
from dataclasses import fields, is_dataclass
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from gcl_core.config import load_config
from gcl_core.data import formats
from gcl_core.estimation.estimators import ESTIMATORS
from gcl_core.evaluation.benchmark import BenchmarkConfig
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.registrar import RegistrarConfig
from gcl_core.training.ablation import AblationConfig
from gcl_core.training.recipe import TrainConfig
from gcl_ros.registrar_node import NodeConfig
from gcl_ros.sender_node import SenderConfig

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').glob('*.md'))]
SCRIPTS = {
    'gcl': 'gcl_core.cli.main',
    'replay': 'gcl_ros.replay',
    'evaluate_bag': 'gcl_ros.evaluate_bag',
}
NODES = {'registrar': NodeConfig, 'sender': SenderConfig}
CONFIGS = {
    'train': TrainConfig,
    'evaluate': BenchmarkConfig,
    'gcl_core.training.ablation': AblationConfig,
}
FENCED = re.compile(r'^```(\w*)\n(.*?)^```', re.DOTALL | re.MULTILINE)
# Keys of a config in backticks, by the dataclass that their first part belongs to.
KEYS = {
    **dict.fromkeys(('registrar', 'motion'), (NodeConfig,)),
    **dict.fromkeys(('estimator', 'match', 'verify', 'refine'), (RegistrarConfig,)),
    **dict.fromkeys(('samples', 'loss', 'optimizer', 'groups'), (TrainConfig,)),
    'network': (ResUNetConfig, KPConvConfig),
}


def blocks(page, language):
    return [text for kind, text in FENCED.findall(page.read_text()) if kind == language]


def commands():
    """Lines of the pages' shell blocks and of the configs' comments, continued ones joined."""
    for page in PAGES:
        for block in blocks(page, 'bash'):
            for line in block.replace('\\\n', ' ').splitlines():
                yield page.name, line
    for config in sorted((ROOT / 'config').glob('*.yaml')):
        for line in re.findall(r'^# +((?:gcl|ros2) .*)$', config.read_text(), re.MULTILINE):
            yield config.name, line


def of_this_project():
    """Every command that this project's own parsers read, without what leads to it."""
    for page, line in commands():
        words = shlex.split(line, comments=True)
        words = words[1:] if words[:1] == ['sudo'] else words
        words = words[3:] if words[:3] == ['ros2', 'run', 'gcl_ros'] else words
        if '-m' in words and words[0] in ('python', 'torchrun'):
            words = words[words.index('-m') + 1 :]
        if words and (words[0] in {*SCRIPTS, *NODES} or words[0].startswith('gcl_')):
            yield pytest.param(words, id=f'{page}: {" ".join(words)[:60]}')


class ParsedError(Exception):
    """Ends a program as soon as its command line is parsed."""


@pytest.mark.parametrize('words', list(of_this_project()))
def test_a_command_parses(words, monkeypatch, capsys):
    name, arguments = words[0], words[1:]
    if name in NODES:
        check_node(name, arguments)
        return
    parse_args = argparse.ArgumentParser.parse_args

    def parse(self, *args):
        raise ParsedError(parse_args(self, *args))

    monkeypatch.setattr(argparse.ArgumentParser, 'parse_args', parse)
    monkeypatch.setattr(sys, 'argv', [name, *arguments])
    module = importlib.import_module(SCRIPTS.get(name, name))
    if hasattr(module, '__path__'):
        module = importlib.import_module(f'{name}.__main__')
    try:
        with pytest.raises(ParsedError) as parsed:
            module.main()
    except SystemExit:
        pytest.fail(capsys.readouterr().err)
    options = parsed.value.args[0]
    config = str(getattr(options, 'config', None))
    if config.startswith('config/'):
        settings = [s for s in getattr(options, 'set', []) if s != '…']
        load_config(CONFIGS[getattr(options, 'command', name)], ROOT / config, settings)


def check_node(name, arguments):
    """Parameters exist, and so does the file of parameters."""
    for flag, value in pairwise(arguments):
        if flag == '-p' and not value.startswith('use_sim_time:='):
            assert has_key(NODES[name], value.partition(':=')[0].split('.')), value
        if flag == '--params-file':
            assert (ROOT / value.replace('$CONFIG', 'config')).is_file(), value


def has_key(kind, parts):
    """Whether a dataclass has a field of this name, and its default the rest of the key."""
    for part in parts:
        if not is_dataclass(kind) or part not in {f.name for f in fields(kind)}:
            return False
        kind = getattr(kind if not isinstance(kind, type) else kind(), part)
    return True


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page):
    text = re.sub(r'`[^`]*`', '', FENCED.sub('', page.read_text()))
    for path, anchor in re.findall(r'\]\(([^)#:]*)(?:#([^)]*))?\)', text):
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), path
        headings = re.findall(r'^#+ (.*)$', target.read_text(), re.MULTILINE) if anchor else []
        slugs = {re.sub(r'[^\w -]', '', h.lower()).replace(' ', '-') for h in headings}
        assert not anchor or anchor in slugs, f'{path}#{anchor}'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_what_stands_in_backticks_exists(page):
    """Files of the project, keys of its configs, subcommands with their flags, make targets."""
    targets = re.findall(r'^([\w-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE)
    text = FENCED.sub('', page.read_text())
    for span in re.findall(r'`([^`]+)`', text):
        word = span.split()[0].rstrip(':')
        if re.fullmatch(r'(config|docs|launch|gcl_core|gcl_ros|test)/[\w/.]+\.\w+', word):
            assert (ROOT / word).exists(), word
        key = re.fullmatch(r'([a-z_]+)((?:\.[a-z_]+)+)(?:=.*)?', word)
        if key and key[1] in KEYS and not re.search(r'\.(py|yaml|json|launch)\b', word):
            parts = key[0].partition('=')[0].split('.')
            parts = parts[1:] if key[1] == 'network' else parts
            assert any(has_key(kind, parts) for kind in KEYS[key[1]]), word
        if span.startswith('make '):
            assert span.split()[1] in targets, span


def test_the_examples_of_extending_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for table, name in [
        (formats.LAYOUTS, 'npz'),
        (formats.OPENERS, 'npz'),
        (ESTIMATORS, 'spectral'),
    ]:
        monkeypatch.setitem(table, name, None)  # gone again afterwards
    torch.manual_seed(0)
    names = {}
    for number, text in enumerate(blocks(ROOT / 'docs/extend.md', 'python')):
        exec(compile(text, f'extend.md, block {number}', 'exec'), names)
    assert names['result'].accepted
    assert names['result'].T_target_source[0, 3] == pytest.approx(12, abs=0.3)
    norms = names['features'].descriptors.norm(dim=1)
    torch.testing.assert_close(norms, torch.ones_like(norms))
    assert names['shared'] > 0.6
