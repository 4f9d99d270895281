"""Licences and known vulnerabilities of what is installed."""

from importlib import metadata

import pytest

from gcl_ros.audit import closure, licence, told


def test_every_package_that_runs_is_listed_with_its_licence():
    try:
        metadata.distribution('gcl_ros')
    except metadata.PackageNotFoundError:
        pytest.skip('gcl_ros is not installed: pip knows nothing of what it needs')
    packages = closure('gcl_ros')
    assert {'numpy', 'torch', 'safetensors', 'rosbags', 'apsw'} <= set(packages)
    assert licence(packages['safetensors']).startswith('Apache')


def test_what_was_not_checked_is_not_taken_for_sound(capsys):
    skipped = {'name': 'a', 'skip_reason': 'unknown'}
    assert told([skipped]) == 2
    assert 'NOT checked, unknown to the advisory service: a' in capsys.readouterr().out
    sound = {'name': 'b', 'version': '1', 'vulns': []}
    assert told([sound, skipped]) == 0
    hole = {'id': 'CVE-1', 'fix_versions': ['2']}
    assert told([sound, {'name': 'c', 'version': '1', 'vulns': [hole]}]) == 1
    assert 'c 1: CVE-1, fixed in 2' in capsys.readouterr().out
