"""The guides become a site in which every page is reached and every link leads somewhere."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_the_site_is_built_without_a_warning():
    pytest.importorskip('properdocs', reason='properdocs is not installed: make install')
    done = subprocess.run(
        ['sh', '.ci/site', sys.executable], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    for page in (ROOT / 'docs').glob('*.md'):
        assert (ROOT / 'build/site/docs' / page.stem / 'index.html').is_file()
