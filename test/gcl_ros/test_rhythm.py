"""What a slow consumer does with streams that come regularly."""

import numpy as np
import pytest

from gcl_ros.pairing import Pairing
from gcl_ros.pairings import Pairings
from gcl_ros.rhythm import Rhythm, Throttle


def heard(*times: float) -> Rhythm:
    rhythm = Rhythm()
    for time in times:
        rhythm.arrived(time)
    return rhythm


@pytest.fixture
def tenth():
    """Pairs every 0.1 s, the last at 1.0."""
    return heard(*(k / 10 for k in range(11)))


@pytest.mark.parametrize(
    ('stream', 'taken'), [(10.0, 100), (20.0, 100), (5.0, 50)], ids=['same', 'twice', 'half']
)
def test_a_regular_stream_passes_in_spite_of_jitter(stream, taken):
    """Ten seconds at most 10 Hz; clouds come up to 10 ms early or late."""
    throttle, jitter = Throttle(), np.random.default_rng(0).uniform(-0.01, 0.01, 1000)
    passed = sum(throttle.passes(k / stream + jitter[k], 10.0) for k in range(int(10 * stream)))
    assert passed == pytest.approx(taken, abs=2)


def test_nothing_is_foretold_from_one_pair():
    assert heard().period is None
    rhythm = heard(1.0)
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
    assert heard(0.0, 1.0, 2.0, 3.0, 4.0).wait(4.9) == 0.0


class Streams:
    """A pairing of two streams of 10 Hz, by a clock that is set by hand."""

    def __init__(self) -> None:
        self._now = 0.0
        self.pairing = Pairing(max_dt=0.05, clock=lambda: self._now)

    def send(self, number: int, *sides: str) -> None:
        self._now = number / 10
        for side in sides:
            self.pairing.add(side, self._now, f'{side[0]}{number}')


def test_a_message_whose_partner_is_about_to_come_is_offered_once():
    streams = Streams()
    for k in range(2):
        streams.send(k, 'target')
        assert streams.pairing.take_early() is None
        streams.send(k, 'source')
    streams.send(2, 'target')
    assert streams.pairing.take_early() == ('target', 't2')
    assert streams.pairing.take_early() is None
    streams.send(2, 'source')
    assert streams.pairing.take() == ('s2', 't2')


def test_a_message_that_was_paired_meanwhile_is_not_offered():
    streams = Streams()
    for k in range(4):
        streams.send(k, 'target', 'source')
    assert streams.pairing.take_early() is None


def test_a_silent_partner_is_not_prepared_for():
    streams = Streams()
    for k in range(3):
        streams.send(k, 'target', 'source')
    for k in range(3, 20):
        streams.send(k, 'target')
        early = streams.pairing.take_early()
        assert early is None or k < 5


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
