"""What SROS 2 does here: the PyPI wheels have no security plugins, and the node fails closed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def library() -> Path | None:
    """Fast DDS of the PyPI wheels; None where another installation serves."""
    found = sorted((Path(sys.prefix) / 'lib').glob('libfastdds.so.*'))
    return found[-1] if found else None


def has_plugins(path: Path) -> bool:
    """Whether the authentication plugin is compiled in."""
    return re.search(rb'dds\.sec\.auth\.builtin\.PKI-DH', path.read_bytes()) is not None


def test_a_node_that_is_told_to_be_secure_is_secure_or_does_not_start(tmp_path):
    """With `ROS_SECURITY_STRATEGY=Enforce` and no plugins, no unprotected node comes up."""
    path = library()
    if path is None or has_plugins(path):
        pytest.skip('Fast DDS has its security plugins here: docs/security.md tells how to set up')
    (tmp_path / 'enclaves').mkdir()
    security = {
        'ROS_SECURITY_ENABLE': 'true',
        'ROS_SECURITY_STRATEGY': 'Enforce',
        'ROS_SECURITY_KEYSTORE': str(tmp_path),
    }
    done = subprocess.run(
        [sys.executable, '-m', 'gcl_ros.registrar'],
        env=os.environ | security,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode != 0
    assert "doesn't have the security libraries" in done.stdout + done.stderr
