"""Lifecycle transitions and parameters, over the services that tools use."""

import random
import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2, PointField

from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.parameters import flatten
from gcl_ros.ranges import range_of
from gcl_ros.registrar_node import NodeConfig, RegistrarNode
from gcl_ros.sender_node import SenderConfig, SenderNode

# (state, transition) that exist, and where they lead
LEADS = {
    ('unconfigured', Transition.TRANSITION_CONFIGURE): 'inactive',
    ('inactive', Transition.TRANSITION_ACTIVATE): 'active',
    ('active', Transition.TRANSITION_DEACTIVATE): 'inactive',
    ('inactive', Transition.TRANSITION_CLEANUP): 'unconfigured',
}
TRANSITIONS = [transition for _, transition in LEADS]


def state(rig, node='registrar') -> str:
    return rig.call(GetState, f'/{node}/get_state').current_state.label


def test_transitions_in_any_order(rig, meeting):
    """Those that do not exist are refused and change nothing; the node works in the end."""
    rig.add(RegistrarNode, start=False, registrar__headings=1)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    assert state(rig) == 'unconfigured'
    expected, rng = 'unconfigured', random.Random(5)
    for _ in range(25):
        transition = rng.choice(TRANSITIONS)
        rig.send(source=meeting[0], target=meeting[1])
        leads = LEADS.get((expected, transition))
        assert rig.change(transition) == (leads is not None)
        expected = leads or expected
        assert state(rig) == expected
    for transition in TRANSITIONS[:2]:
        rig.change(transition)
    assert state(rig) == 'active'
    transforms.clear()
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(lambda: transforms, every=send)
    assert rig.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert state(rig) == 'finalized'


def test_the_sender_takes_transitions_in_any_order_too(rig, meeting):
    rig.add(SenderNode, start=False)
    points = rig.node.create_publisher(PointCloud2, '/points', 1)
    scans = rig.listen(PointCloud2, '/compact')
    cloud = fill_point_cloud2(PointCloud2(), meeting[0], PointField)
    expected, rng = 'unconfigured', random.Random(7)
    for _ in range(25):
        transition = rng.choice(TRANSITIONS)
        points.publish(cloud)
        leads = LEADS.get((expected, transition))
        assert rig.change(transition, 'sender') == (leads is not None)
        expected = leads or expected
        assert state(rig, 'sender') == expected
    for transition in TRANSITIONS[:2]:
        rig.change(transition, 'sender')
    scans.clear()
    assert rig.until(lambda: scans, every=lambda: points.publish(cloud))


@pytest.mark.parametrize('asked', [99, 'fly', Transition.TRANSITION_ACTIVATE, 'activate'])
def test_a_transition_that_is_none_is_answered(rig, asked):
    rig.add(RegistrarNode, start=False)
    assert not rig.change(asked)
    assert state(rig) == 'unconfigured'
    assert rig.change('shutdown')  # by its name, too
    assert state(rig) == 'finalized'


@pytest.mark.parametrize(
    ('before', 'shutdown'),
    [
        ([], Transition.TRANSITION_UNCONFIGURED_SHUTDOWN),
        (TRANSITIONS[:1], Transition.TRANSITION_INACTIVE_SHUTDOWN),
        (TRANSITIONS[:2], Transition.TRANSITION_ACTIVE_SHUTDOWN),
    ],
    ids=['unconfigured', 'inactive', 'active'],
)
def test_it_can_be_shut_down_in_every_state(rig, meeting, before, shutdown):
    rig.add(RegistrarNode, start=False, registrar__headings=1)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    for transition in before:
        assert rig.change(transition)
    assert rig.change(shutdown)
    assert state(rig) == 'finalized'
    assert not any(rig.change(transition) for transition in TRANSITIONS)
    transforms.clear()
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert not rig.until(lambda: transforms, every=send, patience=1.0)
    assert rig.until(lambda: rig.says('finalized, not active'))


def test_nothing_is_published_once_inactive(rig, meeting):
    rig.add(RegistrarNode, registrar__headings=1)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(lambda: transforms, every=send)
    send()
    assert rig.change(Transition.TRANSITION_DEACTIVATE)
    rig.until(lambda: False, patience=0.2)
    count = len(transforms)
    assert not rig.until(lambda: len(transforms) > count, every=send, patience=2.0)
    assert rig.until(lambda: rig.says('inactive, not active'))
    assert not rig.trigger('trigger').success


def test_a_wrong_start_value_can_be_set_right(rig):
    rig.add(RegistrarNode, registrar__headings=0, max_pair_dt=99)
    assert state(rig) == 'unconfigured'
    assert rig.until(lambda: rig.says('registrar.headings'))
    assert rig.status.level == b'\2'
    assert not rig.change(Transition.TRANSITION_CONFIGURE)
    assert not rig.set('registrar.headings', 1).successful  # the other is still wrong
    both = [Parameter('registrar.headings', value=1), Parameter('max_pair_dt', value=0.1)]
    request = SetParametersAtomically.Request(parameters=[p.to_parameter_msg() for p in both])
    service = '/registrar/set_parameters_atomically'
    assert rig.call(SetParametersAtomically, service, request).result.successful
    assert rig.change(Transition.TRANSITION_CONFIGURE)


@dataclass
class Live:
    rig: Any
    node: RegistrarNode


@pytest.fixture
def live(rig):
    return Live(rig, rig.add(RegistrarNode))


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('max_pair_dt', -1.0, 'out of range'),
        ('max_pair_dt', 11, 'out of range'),
        ('max_pair_dt', float('nan'), 'out of range'),
        ('max_pair_dt', 'soon', 'expected float'),
        ('registrar.headings', 0, 'out of range'),
        ('registrar.headings', 2.5, 'expected int'),
        ('registrar.verify.finalists', 50, 'at most verify.hypotheses'),
        ('registrar.estimator.name', 'guess', "'guess' is none of"),
        ('registrar.refine.reach', [1.0], 'one of each for every step'),
        ('registrar.weights', 'other', 'unconfigured only'),
        ('publish_aligned', True, 'unconfigured only'),
        ('registrar.heding', 1, ''),
    ],
)
def test_values_that_do_not_fit_are_refused_with_the_reason(live, name, value, reason):
    before = live.node.config
    result = live.rig.set(name, value)
    assert not result.successful
    assert reason in result.reason
    assert live.node.config == before


@pytest.mark.parametrize('kind', [NodeConfig, SenderConfig])
def test_every_number_has_a_range_and_beyond_it_is_refused(rig, kind):
    """But seeds, and lists, which are checked as a whole."""
    node = rig.add(RegistrarNode if kind is NodeConfig else SenderNode, start=False)
    for name, default in flatten(kind()).items():
        if isinstance(default, bool | str | list) or name.endswith('seed'):
            continue
        low, high = range_of(name)
        assert low <= default <= high, name
        for value in (low - 1, high + 1):
            (result,) = node.set_parameters([Parameter(name, value=type(default)(value))])
            assert not result.successful, (name, value)
        assert node.get_parameter(name).value == default


def test_safe_values_change_while_active(live):
    assert live.rig.set('max_pair_dt', 1).successful
    assert live.rig.set('registrar.min_probability', 0.5).successful
    assert live.rig.set('registrar.estimator.ransac.samples', 1000).successful
    config = live.node.config
    assert config.max_pair_dt == 1.0
    assert config.registrar.min_probability == 0.5
    assert config.registrar.estimator.ransac.samples == 1000


@pytest.mark.parametrize('service', ['set_parameters', 'set_parameters_atomically'])
def test_a_double_given_without_a_point_stays_a_double(rig, service):
    """As people type it, at start and later: `ros2 param set /registrar max_age 7`."""
    typed = {'max_age': 7, 'registrar.refine.reach': [3, 1]}
    node = rig.add(RegistrarNode, start=False, silence=3, registrar__refine__resolution=[2, 1])
    messages = [Parameter(name, value=value).to_parameter_msg() for name, value in typed.items()]
    if service == 'set_parameters':
        request = SetParameters.Request(parameters=messages)
        results = rig.call(SetParameters, f'/registrar/{service}', request).results
    else:
        request = SetParametersAtomically.Request(parameters=messages)
        results = [rig.call(SetParametersAtomically, f'/registrar/{service}', request).result]
    assert all(result.successful for result in results), results
    request = GetParameters.Request(
        names=[*typed, 'silence', 'registrar.refine.resolution', 'registrar.headings']
    )
    age, reach, silence, resolution, turns = rig.call(
        GetParameters, '/registrar/get_parameters', request
    ).values
    assert (age.type, age.double_value) == (ParameterType.PARAMETER_DOUBLE, 7.0)
    assert (silence.type, silence.double_value) == (ParameterType.PARAMETER_DOUBLE, 3.0)
    assert reach.type == resolution.type == ParameterType.PARAMETER_DOUBLE_ARRAY
    assert (list(reach.double_array_value), list(resolution.double_array_value)) == (
        [3, 1],
        [2, 1],
    )
    assert turns.type == ParameterType.PARAMETER_INTEGER
    assert rig.change(Transition.TRANSITION_CONFIGURE)
    assert node.config.registrar.refine.reach == (3.0, 1.0)


def test_every_parameter_is_described(live):
    names = list(flatten(NodeConfig()))
    request = DescribeParameters.Request(names=names)
    found = live.rig.call(DescribeParameters, '/registrar/describe_parameters', request)
    assert [d.name for d in found.descriptors if not d.description] == []
    by_name = {d.name: d for d in found.descriptors}
    assert by_name['registrar.headings'].integer_range[0].to_value == 12
    assert by_name['max_pair_dt'].floating_point_range[0].to_value == 10.0
    assert 'level, rigid' in by_name['registrar.estimator.ransac.model'].additional_constraints


def test_tf_is_refused_where_it_is_not_installed(rig, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    rig.add(RegistrarNode, publish_tf=True)
    assert state(rig) == 'unconfigured'
    assert rig.until(lambda: rig.says('publish_tf needs tf2_ros'))


def test_tf_is_broadcast_where_it_is_asked_for(rig, meeting, monkeypatch):
    """tf2_ros comes with ROS only: a stand-in with its interface, over a real topic."""
    module = ModuleType('tf2_ros')

    class TransformBroadcaster:
        def __init__(self, node):
            self.pub_tf = node.create_publisher(TransformStamped, '/tf_stand_in', 10)

        def sendTransform(self, transform):
            self.pub_tf.publish(transform)

    module.TransformBroadcaster = TransformBroadcaster
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    rig.add(RegistrarNode, publish_tf=True, registrar__headings=1)
    rig.publish_clouds()
    heard = rig.listen(TransformStamped, '/tf_stand_in')
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(lambda: heard, every=send)
    assert heard[0].child_frame_id == 'source_lidar'
    for transition in TRANSITIONS[2:]:  # back to unconfigured
        assert rig.change(transition)
    assert rig.until(lambda: not rig.node.count_publishers('/tf_stand_in'))
