"""Big clouds over the default transport are lost, and that is said at start."""

from pathlib import Path

import pytest

from gcl_ros.transport import PROFILE_KEYS, warning

PROFILE = Path(__file__).parents[2] / 'config' / 'fastdds.xml'
RMW = 'rmw_fastrtps_cpp'


def test_default_transport_loses_best_effort_clouds():
    assert 'is not set' in warning(RMW, reliable=False, environment={})


@pytest.mark.parametrize('key', PROFILE_KEYS)
def test_our_profile_carries_them(key):
    assert warning(RMW, reliable=False, environment={key: str(PROFILE)}) is None


def test_profiles_that_are_missing_or_too_small_are_named(tmp_path):
    environment = {PROFILE_KEYS[0]: str(tmp_path / 'p.xml')}
    assert 'cannot be read' in warning(RMW, reliable=False, environment=environment)
    small = PROFILE.read_text().replace('33554432', '524288')
    (tmp_path / 'p.xml').write_text(small)
    assert '524288 bytes' in warning(RMW, reliable=False, environment=environment)


def test_reliable_subscriptions_and_other_middleware_are_left_alone():
    assert warning(RMW, reliable=True, environment={}) is None
    assert warning('rmw_cyclonedds_cpp', reliable=False, environment={}) is None
    large = {'FASTDDS_BUILTIN_TRANSPORTS': 'LARGE_DATA'}
    assert warning(RMW, reliable=False, environment=large) is None
