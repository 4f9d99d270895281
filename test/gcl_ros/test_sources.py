"""Several sources against one target."""

import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_ros.answers import Answers
from gcl_ros.conversions import matrix
from gcl_ros.pairings import Pairings
from gcl_ros.recent import Recent
from gcl_ros.registrar_node import NodeConfig, RegistrarNode


def test_sources_take_turns():
    pairings = Pairings(['a', 'b'], max_dt=0.1)
    for stamp in (1.0, 2.0):
        pairings.add_target(stamp, f't{stamp:.0f}')
        pairings.of['a'].add('source', stamp, f'a{stamp:.0f}')
        if stamp == 1.0:
            pairings.of['b'].add('source', stamp, 'b1')
    assert pairings.take() == ('a', 'a2', 't2')
    pairings.of['a'].add('source', 3.0, 'a3')
    pairings.add_target(3.0, 't3')
    assert pairings.take() == ('b', 'b1', 't1')
    assert pairings.take() == ('a', 'a3', 't3')
    pairings.close()
    assert pairings.take() is None


def test_recent_keeps_what_is_asked_for():
    recent, made = Recent(2), []
    keys = [object() for _ in range(3)]

    def get(key, other=keys[0]):
        return recent.get((key, other), lambda: made.append(key) or len(made))

    assert [get(keys[0]), get(keys[1]), get(keys[0]), get(keys[2]), get(keys[0])] == [
        1,
        2,
        1,
        3,
        1,
    ]
    assert get(keys[1]) == 4
    assert get(keys[1], other=keys[2]) == 5


@pytest.mark.parametrize('names', [(), ('a', 'a'), ('a', 'target'), ('a b',), ('/a',)])
def test_names_that_are_no_topics_are_refused(names):
    with pytest.raises(GclError, match='sources'):
        NodeConfig(sources=names)


def test_two_sources_are_told_apart(rig, meeting):
    """One is turned around; the target is described once for both."""
    source, target, T = meeting
    turn = se3.from_xyz_rpy(x=1.0, yaw=0.5)
    truths = {'b': T, 'c': T @ se3.inverse(turn)}
    node = rig.add(RegistrarNode, registrar__headings=1, sources=['b', 'c'], on_demand=True)
    rig.publish_clouds()
    for name in truths:
        publisher = rig.node.create_publisher(PointCloud2, f'/{name}/points', QoSProfile(depth=1))
        rig.publishers[name], rig.offset[name] = publisher, 0.0
    heard = {n: rig.listen(TransformStamped, f'/registrar/{n}/transform') for n in truths}
    described = []
    view = node._exchange.registrar.view
    node._exchange.registrar.view = lambda *a, **k: described.append(1) or view(*a, **k)

    del rig.publishers['source']
    joined = lambda: all(p.get_subscription_count() for p in rig.publishers.values())  # noqa: E731
    assert rig.until(joined)
    rig.send(b=source, c=se3.transform(turn, source), target=target)
    assert rig.until(lambda: all(p.has_pair for p in node._pairings.of.values()))
    answer = rig.trigger('trigger')
    assert answer.success
    assert 'b: ' in answer.message
    assert 'c: ' in answer.message
    assert rig.until(lambda: all(heard.values()))
    for name, truth in truths.items():
        message = heard[name][0]
        assert message.child_frame_id == f'{name}_lidar'
        assert metrics.registered(matrix(message.transform), truth, metrics.STRICT)
    assert len(described) == 3
    assert rig.until(lambda: rig.status and rig.status.name == 'registrar: b')


def test_an_outcome_answers_those_who_had_called_for_its_pair():
    answers = Answers()
    first = answers.expect(['a'], None)
    taken = answers.calls
    second = answers.expect(['a'], None)  # while that pair is at work: for a newer one
    answers.outcome('a', True, 'one', calls=taken)
    assert (first.done(), second.done()) == (True, False)
    answers.outcome('a', False, 'two', calls=answers.calls)
    assert (first.result(), second.result()) == ((True, 'one'), (False, 'two'))
