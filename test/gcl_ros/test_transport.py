"""Big clouds over the default transport are lost, and that is said at start."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gcl_ros.transport import PROFILE, PROFILE_KEYS, TRANSPORTS, keep_local, read_here, warning

ROOT = Path(__file__).parents[2]
RMW = 'rmw_fastrtps_cpp'
FASTDDS, FASTRTPS = PROFILE_KEYS
NODE = """
from rclpy.node import Node
from gcl_ros.startup import running_ros
from gcl_ros.transport import read_here

with running_ros():
    Node('reader')
    print(*read_here())
"""


def test_default_transport_loses_best_effort_clouds():
    for keys in (PROFILE_KEYS, [FASTRTPS]):
        assert f'{keys[0]} is not set:' in warning(RMW, reliable=False, read=keys, environment={})


def test_our_profile_carries_them_where_it_is_read():
    for key in PROFILE_KEYS:
        environment = {key: str(PROFILE)}
        assert warning(RMW, reliable=False, read=PROFILE_KEYS, environment=environment) is None
        assert warning(RMW, reliable=False, read=[key], environment=environment) is None
    unread = warning(RMW, reliable=False, read=[FASTRTPS], environment={FASTDDS: str(PROFILE)})
    assert f'{FASTRTPS} is not set ({FASTDDS} is, which this version does not read)' in unread


@pytest.mark.parametrize('key', PROFILE_KEYS)
def test_the_variables_named_are_those_that_are_read(tmp_path, key):
    """Fast DDS complains of a profile that is no XML, if it reads it at all."""
    broken = tmp_path / 'broken.xml'
    broken.write_text('<dds><profiles>')
    environment = {k: v for k, v in os.environ.items() if k not in PROFILE_KEYS}
    environment |= {key: str(broken), 'PYTHONPATH': str(ROOT)}
    command = [sys.executable, '-c', NODE]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    complains = 'XMLPARSER' in done.stdout + done.stderr
    assert complains == (key in done.stdout.split())


@pytest.mark.parametrize(
    ('library', 'keys'),
    [
        ('/opt/ros/kilted/lib/libfastdds.so.3.2.3', [FASTDDS, FASTRTPS, TRANSPORTS]),
        ('/opt/ros/jazzy/lib/libfastrtps.so.2.14.5', [FASTRTPS, TRANSPORTS]),
        ('/opt/ros/humble/lib/libfastrtps.so.2.6.10', [FASTRTPS]),
        ('', [FASTDDS, FASTRTPS, TRANSPORTS]),
    ],
)
def test_each_version_has_its_variable(library, keys):
    assert list(read_here(library)) == keys


def test_profiles_that_are_missing_or_too_small_are_named(tmp_path):
    environment = {FASTDDS: str(tmp_path / 'p.xml')}
    given = {'reliable': False, 'read': PROFILE_KEYS, 'environment': environment}
    assert 'cannot be read' in warning(RMW, **given)
    small = PROFILE.read_text().replace('33554432', '524288')
    (tmp_path / 'p.xml').write_text(small)
    assert '524288 bytes' in warning(RMW, **given)


def test_reliable_subscriptions_and_other_middleware_are_left_alone():
    assert warning(RMW, reliable=True, read=PROFILE_KEYS, environment={}) is None
    assert warning('rmw_cyclonedds_cpp', reliable=False, read=PROFILE_KEYS, environment={}) is None
    large = {TRANSPORTS: 'LARGE_DATA'}
    read = (FASTRTPS, TRANSPORTS)
    assert warning(RMW, reliable=False, read=read, environment=large) is None
    assert warning(RMW, reliable=False, read=[FASTRTPS], environment=large)  # on Humble


@pytest.mark.parametrize('distribution', ['humble', 'jazzy', 'kilted', None])
@pytest.mark.parametrize('given', [None, FASTDDS, FASTRTPS])
def test_processes_are_kept_local_with_room_for_big_clouds(monkeypatch, distribution, given):
    """A profile of the user's own is taken, whichever variable names it."""
    environment = {'ROS_DISTRO': distribution} if distribution else {}
    environment |= {given: '/own.xml'} if given else {}
    monkeypatch.setattr(os, 'environ', environment)
    keep_local()
    taken = {environment[name] for name in read_here() if name in environment}
    assert taken == {'/own.xml' if given else str(PROFILE)}
    local = {'ROS_LOCALHOST_ONLY', 'ROS_AUTOMATIC_DISCOVERY_RANGE'} & set(environment)
    if distribution == 'humble':
        assert {name: environment[name] for name in local} == {'ROS_LOCALHOST_ONLY': '1'}
    else:
        assert local == {'ROS_AUTOMATIC_DISCOVERY_RANGE'}
