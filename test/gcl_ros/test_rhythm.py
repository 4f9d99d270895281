"""What a slow consumer does with streams that come regularly."""

import pytest

from gcl_ros.pairing import Pairing
from gcl_ros.pairings import Pairings
from gcl_ros.rhythm import Rhythm


@pytest.fixture
def tenth():
    """Pairs every 0.1 s, the last at 1.0."""
    rhythm = Rhythm()
    for k in range(11):
        rhythm.arrived(k / 10)
    return rhythm


def test_nothing_is_foretold_from_one_pair():
    rhythm = Rhythm()
    assert rhythm.period is None
    rhythm.arrived(1.0)
    assert not rhythm.expects(1.05)
    assert rhythm.wait(1.05) == 0.0


@pytest.mark.parametrize(
    ('now', 'expected'), [(1.01, False), (1.07, True), (1.11, True), (1.5, False)]
)
def test_a_cloud_is_expected_to_pair_when_the_last_pair_is_a_period_old(tenth, now, expected):
    assert tenth.period == pytest.approx(0.1)
    assert tenth.expects(now) == expected


@pytest.mark.parametrize(('now', 'wait'), [(1.0, 0.0), (1.04, 0.0), (1.08, 0.04), (1.3, 0.0)])
def test_an_old_pair_is_left_for_the_next(tenth, now, wait):
    assert tenth.wait(now) == pytest.approx(wait)


def test_slow_streams_are_never_waited_for():
    rhythm = Rhythm()
    for k in range(5):
        rhythm.arrived(float(k))
    assert rhythm.wait(4.9) == 0.0


class Hand:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_message_whose_partner_is_about_to_come_is_offered_once():
    clock = Hand()
    pairing = Pairing(max_dt=0.05, clock=clock)
    for k in range(3):
        clock.now = k / 10
        pairing.add('target', clock.now, f't{k}')
        if k < 2:
            assert pairing.take_early() is None
            pairing.add('source', clock.now, f's{k}')
    assert pairing.take_early() == ('target', 't2')
    assert pairing.take_early() is None
    pairing.add('source', clock.now, 's2')
    assert pairing.take() == ('s2', 't2')


def test_a_message_that_was_paired_meanwhile_is_not_offered():
    clock = Hand()
    pairing = Pairing(max_dt=0.05, clock=clock)
    for k in range(4):
        clock.now = k / 10
        pairing.add('target', clock.now, f't{k}')
        pairing.add('source', clock.now, f's{k}')
    assert pairing.take_early() is None


def test_a_silent_partner_is_not_prepared_for():
    clock = Hand()
    pairing = Pairing(max_dt=0.05, clock=clock)
    for k in range(20):
        clock.now = k / 10
        pairing.add('target', clock.now, f't{k}')
        if k < 3:
            pairing.add('source', clock.now, f's{k}')
        elif k > 4:
            assert pairing.take_early() is None
        else:
            pairing.take_early()


def test_the_consumer_gets_early_messages_and_then_the_pair():
    pairings = Pairings(['a'], max_dt=0.1)
    pairings.of['a']._rhythm.expects = lambda now: True
    pairings.add_target(1.0, 't')
    assert pairings.take() == ('a', None, 't')
    pairings.of['a'].add('source', 1.0, 's')
    assert pairings.take() == ('a', 's', 't')


def test_the_consumer_leaves_an_old_pair_for_the_next():
    pairings = Pairings(['a'], max_dt=0.01)
    waits = [0.02, 0.0]
    pairings.of['a']._rhythm.wait = lambda now: waits.pop(0)
    pairings.add_target(1.0, 't1')
    pairings.of['a'].add('source', 1.0, 's1')
    assert pairings.take() == ('a', 's1', 't1')
    assert not waits
