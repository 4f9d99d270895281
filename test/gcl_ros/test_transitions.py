"""What is at work, or half made, when the state or the settings change."""

import threading
from dataclasses import dataclass
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped

from gcl_ros import worker
from gcl_ros.conversions import seconds
from gcl_ros.exchange import Exchange
from gcl_ros.link import Link
from gcl_ros.registrar_node import RegistrarNode
from gcl_ros.sender_node import SenderNode
from gcl_ros.views import Views

EVERYTHING = {'motion__odometry': True, 'publish_aligned': True, 'publish_matches': True}


def topics(node) -> list[str]:
    """What a node publishes and subscribes."""
    return sorted(end.topic_name for end in [*node.publishers, *node.subscriptions])


@pytest.mark.parametrize('kind', [RegistrarNode, SenderNode])
def test_a_transition_that_fails_leaves_nothing_behind(rig, kind, monkeypatch):
    """Whichever creation of a publisher or a subscription fails, one after the other."""
    settings = EVERYTHING if kind is RegistrarNode else {'odometry': True}
    node = rig.make(kind, **settings)
    made, limit = [], [0]

    def failing(create):
        def wrapped(*args, **kwargs):
            made.append(args)
            if len(made) > limit[0]:
                raise RuntimeError('the middleware has no room')
            return create(*args, **kwargs)

        return wrapped

    for name in ('create_publisher', 'create_subscription'):
        monkeypatch.setattr(node, name, failing(getattr(node, name)))
    failures = 0
    for trigger in (node.trigger_configure, node.trigger_activate):
        before, threads, limit[0] = topics(node), set(threading.enumerate()), 0
        while True:
            made.clear()
            trigger()
            if not node.problem:
                break
            assert 'no room' in node.problem
            assert topics(node) == before, f'after {limit[0]} were made'
            assert set(threading.enumerate()) <= threads
            failures += 1
            limit[0] += 1
        assert len(topics(node)) == len(before) + limit[0]
    assert node.state == 'active'
    assert failures == (9 if kind is RegistrarNode else 3)


@dataclass
class Work:
    rig: Any
    node: RegistrarNode
    transforms: list

    def stamps(self) -> list[float]:
        return [seconds(message.header.stamp) for message in self.transforms]


@pytest.fixture
def work(rig, meeting):
    """A registrar to which pairs are sent one by one."""
    node = rig.add(RegistrarNode, registrar__headings=1)
    rig.publish_clouds()
    made = Work(rig, node, rig.listen(TransformStamped, '/registrar/transform'))
    assert rig.until(lambda: all(p.get_subscription_count() for p in rig.publishers.values()))
    return made


def once(monkeypatch, kind, name, *, before=None, after=None):
    """Let something happen before or after the next call of a method; the event says it did."""
    call, happened = getattr(kind, name), threading.Event()

    def wrapped(*args, **kwargs):
        first = not happened.is_set()
        happened.set()
        if first and before:
            before()
        result = call(*args, **kwargs)
        if first and after:
            after()
        return result

    monkeypatch.setattr(kind, name, wrapped)
    return happened


def test_a_pair_that_outlives_its_activation_is_not_published_in_the_next(
    work, meeting, monkeypatch
):
    rig, go_on = work.rig, threading.Event()
    monkeypatch.setattr(worker, 'PATIENCE', 0.1)
    reached = once(monkeypatch, Exchange, 'register', before=go_on.wait)
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(reached.is_set, every=send)
    held_back = rig.stamp
    for transition in ('deactivate', 'activate'):
        assert rig.change(transition)
    go_on.set()
    assert rig.until(lambda: work.transforms, every=send)
    assert min(work.stamps()) > held_back
    assert work.node.state == 'active'


@pytest.mark.parametrize('readable', [True, False], ids=['a pair', 'a pair that cannot be read'])
def test_a_pair_taken_before_a_reset_is_forgotten(work, meeting, monkeypatch, readable):
    """The reset comes between taking the pair and working on it."""
    rig = work.rig
    number = None if readable else 10  # too few points to register
    once(monkeypatch, Link, 'register', before=lambda: rig.trigger('reset'))
    rig.send(source=meeting[0][:number], target=meeting[1])
    assert rig.until(lambda: rig.figures().get('pairs') == '0' and not work.node._at_work.locked())
    assert not rig.until(lambda: work.transforms, patience=3.0)
    assert (rig.figures()['accepted'], rig.figures()['left out']) == ('0', '0')
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(lambda: work.transforms, every=send)


def test_a_parameter_that_changes_leaves_the_pair_at_work_alone(work, meeting, monkeypatch):
    """Accepted by the settings that it began with; the next is withheld by the new ones."""
    rig = work.rig
    set_now = lambda: rig.set('registrar.min_probability', 1.0)  # noqa: E731
    changed = once(monkeypatch, Views, 'both', after=set_now)
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(changed.is_set, every=send)
    assert rig.until(lambda: work.transforms)
    assert rig.until(lambda: rig.says('no transform: probability'), every=send)
