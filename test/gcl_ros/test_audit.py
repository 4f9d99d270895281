"""Licences and known vulnerabilities of what is installed."""

from importlib import metadata

import pytest

from gcl_ros.audit import closure, licence, told, vulnerabilities


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
    said = capsys.readouterr().out
    assert 'NOT CHECKED: the advisory service answered for none of 1 packages' in said
    assert '0 with known' not in said
    sound = {'name': 'b', 'version': '1', 'vulns': []}
    assert told([sound, skipped]) == 0
    assert 'NOT CHECKED, unknown to the advisory service: a' in capsys.readouterr().out
    hole = {'id': 'CVE-1', 'fix_versions': ['2']}
    assert told([sound, {'name': 'c', 'version': '1', 'vulns': [hole]}]) == 1
    assert 'c 1: CVE-1, fixed in 2' in capsys.readouterr().out


def test_an_audit_without_an_answer_says_so(tmp_path, monkeypatch, capsys):
    """A stand-in for pip-audit, as it ends where nothing can be reached."""
    (tmp_path / 'pip_audit').mkdir()
    (tmp_path / 'pip_audit/__init__.py').touch()
    (tmp_path / 'pip_audit/__main__.py').write_text('raise SystemExit("no route to host")\n')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    assert vulnerabilities({'numpy': metadata.distribution('numpy')}) == 2
    assert 'NOT CHECKED: pip-audit failed' in (said := capsys.readouterr().out)
    assert 'no route to host' in said
