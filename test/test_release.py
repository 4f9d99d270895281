"""What a release is made of: one version, its citation, and the files that the forge reads."""

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

import gcl_core

ROOT = Path(__file__).parents[1]
INSTALL = (ROOT / 'docs/install.md').read_text()


def test_the_version_is_the_same_everywhere():
    """setup.py reads it from gcl_core; static files can not."""
    version = gcl_core.__version__
    told = subprocess.run(
        [sys.executable, 'setup.py', '--version'], cwd=ROOT, capture_output=True, text=True
    )
    assert told.stdout.split()[-1] == version, told.stderr
    assert ET.parse(ROOT / 'package.xml').getroot().findtext('version') == version
    assert yaml.safe_load((ROOT / 'CITATION.cff').read_text())['version'] == version
    newest = re.search(r'^## (\S+)', (ROOT / 'CHANGELOG.md').read_text(), re.MULTILINE)
    assert newest[1] == version


def test_the_citation_says_what_to_cite():
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert cited['cff-version'] == '1.2.0'
    assert {'message', 'title', 'authors'} <= cited.keys()
    assert cited['license'] == ET.parse(ROOT / 'package.xml').getroot().findtext('license')
    paper = cited['preferred-citation']
    assert (paper['year'], len(paper['authors'])) == (2023, 6)
    assert paper['url'] == ET.parse(ROOT / 'package.xml').getroot().findtext('url')


def test_commits_are_checked_as_make_checks_them():
    hooks = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text())['repos'][0]['hooks']
    rules = (ROOT / 'Makefile').read_text().replace('$(BIN)', '.venv/bin')
    recipes = re.findall(r'^(?:lint|type): install\n\t(.*)', rules, re.MULTILINE)
    assert {hook['entry'] for hook in hooks} == set(' && '.join(recipes).split(' && '))


def test_the_forge_runs_what_is_there():
    jobs = yaml.safe_load((ROOT / '.github/workflows/ci.yml').read_text())['jobs']
    targets = re.findall(r'^([\w-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE)
    commands = jobs['check']['strategy']['matrix']['command']
    assert '.ci/run' in commands
    run = (ROOT / '.ci/run').read_text()
    for target in re.findall(r'^make (\S+)', '\n'.join([*commands, run]), re.MULTILINE):
        assert target in targets
    assert {'make test', 'make test-jazzy'} <= set(run.splitlines())  # both distributions


@pytest.mark.parametrize('form', sorted((ROOT / '.github/ISSUE_TEMPLATE').glob('[!c]*.yml')))
def test_issue_forms_are_as_the_forge_reads_them(form):
    content = yaml.safe_load(form.read_text())
    assert {'name', 'description', 'body'} <= content.keys()
    ids = [field['id'] for field in content['body']]
    assert len(ids) == len(set(ids))
    for field in content['body']:
        assert field['type'] in {'input', 'textarea'}
        assert field['attributes']['label']


@pytest.mark.parametrize('distribution', ['humble', 'jazzy'])
def test_images_are_set_up_as_the_guide_says(distribution):
    """They are not built here: what can be held is that both say the same."""
    image = (ROOT / f'docker/{distribution}.Dockerfile').read_text()
    (install,) = re.findall(r'pip install -c src/\S+ ((?:\\\n|.)*)', INSTALL)
    assert install in image
    assert f'FROM ros:{distribution}-ros-base\n' in image
    assert 'Not tried' in image
    other = {'humble': 'jazzy', 'jazzy': 'humble'}[distribution]
    assert other not in image.lower()
