"""What a release is made of: its citation, and the files that the forge reads."""

import xml.etree.ElementTree as ET
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def test_the_citation_says_what_to_cite():
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert cited['cff-version'] == '1.2.0'
    assert {'message', 'title', 'authors'} <= cited.keys()
    assert cited['license'] == ET.parse(ROOT / 'package.xml').getroot().findtext('license')
    paper = cited['preferred-citation']
    assert (paper['year'], len(paper['authors'])) == (2023, 6)
    assert paper['url'] == ET.parse(ROOT / 'package.xml').getroot().findtext('url')
