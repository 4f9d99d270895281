import threading

import pytest

from gcl_ros.pairing import Pairing


def take_now(pairing):
    """Pair that waits, or None: closing wakes the consumer of an empty one."""
    return pairing._newest and pairing.take()


def test_pairs_by_stamp_whatever_the_order():
    pairing = Pairing(max_dt=0.05)
    pairing.add('source', 1.00, 's1')
    pairing.add('source', 1.10, 's2')
    pairing.add('target', 1.02, 't1')
    assert pairing.take() == ('s1', 't1')
    pairing.add('target', 1.11, 't2')
    assert pairing.take() == ('s2', 't2')


def test_stamps_too_far_apart_make_no_pair():
    pairing = Pairing(max_dt=0.05)
    pairing.add('source', 1.0, 's')
    pairing.add('target', 1.06, 't')
    assert take_now(pairing) is None


def pairs_of(*, offset, lost=()):
    """(source, target) stamps of the pairs that come of two streams of 10 Hz, taken at once."""
    pairing, found = Pairing(max_dt=0.1), []
    arrivals = [(k / 10, 'target') for k in range(20) if k not in lost]
    arrivals += [(k / 10 + offset, 'source') for k in range(20)]
    for stamp, side in sorted(arrivals):
        pairing.add(side, stamp, stamp)
        if pair := take_now(pairing):
            found.append(pair)
    return found


@pytest.mark.parametrize(
    ('offset', 'apart'), [(0.01, 0.01), (0.04, 0.04), (0.06, 0.04), (0.09, 0.01)]
)
def test_streams_out_of_step_pair_with_the_nearest(offset, apart):
    found = pairs_of(offset=offset)
    assert len(found) >= 18
    for source, target in found[2:]:  # the rhythm shows from the second on
        assert abs(source - target) == pytest.approx(apart)


def test_a_lost_message_costs_its_own_pair_only():
    found = pairs_of(offset=0.09, lost=(10,))
    assert len(found) >= 17
    assert all(abs(source - target) == pytest.approx(0.01) for source, target in found[2:])


def test_newest_pair_replaces_the_one_that_waits():
    pairing = Pairing(max_dt=0.05)
    for i in range(5):
        pairing.add('source', float(i), f's{i}')
        pairing.add('target', float(i), f't{i}')
    assert pairing.take() == ('s4', 't4')
    assert pairing.counts.replaced == 4


def test_late_pair_does_not_replace_a_newer_one():
    pairing = Pairing(max_dt=0.05)
    pairing.add('source', 1.0, 's1')
    pairing.add('source', 2.0, 's2')
    pairing.add('target', 2.0, 't2')
    pairing.add('target', 1.0, 't1')
    assert pairing.take() == ('s2', 't2')
    assert take_now(pairing) is None


def test_reset_forgets_the_clock():
    pairing = Pairing(max_dt=0.05)
    pairing.add('source', 100.0, 'old')
    pairing.add('target', 100.0, 'old')
    pairing.reset()
    pairing.add('source', 1.0, 's')
    pairing.add('target', 1.0, 't')
    assert pairing.take() == ('s', 't')


def test_close_wakes_the_consumer():
    pairing = Pairing(max_dt=0.05)
    result = []
    thread = threading.Thread(target=lambda: result.append(pairing.take()))
    thread.start()
    pairing.close()
    thread.join(timeout=5)
    assert result == [None]


def test_stamps_that_jump_back_start_anew():
    pairing = Pairing(max_dt=0.05)
    for stamp in (100.0, 3.0):
        pairing.add('source', stamp, f's{stamp:.0f}')
        pairing.add('target', stamp, f't{stamp:.0f}')
    assert pairing.take() == ('s3', 't3')
    assert pairing.counts.jumps == 1


def test_every_message_without_a_partner_is_counted():
    pairing = Pairing(max_dt=0.05, depth=3)
    for i in range(5):
        pairing.add('source', float(i), f's{i}')
    assert pairing.counts.unpaired == 2
    pairing.add('target', 4.0, 't4')
    assert (pairing.counts.unpaired, pairing.counts.pairs) == (4, 1)
    assert pairing.take() == ('s4', 't4')


def test_clocks_that_differ_show_as_an_offset():
    pairing = Pairing(max_dt=0.05)
    assert pairing.offset() is None
    pairing.add('source', 107.5, 's')
    pairing.add('target', 100.0, 't')
    assert pairing.offset() == 7.5
    assert take_now(pairing) is None


def test_on_demand_pairs_wait_until_they_are_asked_for():
    pairing = Pairing(max_dt=0.05, on_demand=True)
    assert not pairing.ask()
    result = []
    thread = threading.Thread(target=lambda: result.append(pairing.take()))
    thread.start()
    pairing.add('source', 1.0, 's')
    pairing.add('target', 1.0, 't')
    thread.join(timeout=0.2)
    assert not result
    assert pairing.ask()
    thread.join(timeout=5)
    assert result == [('s', 't')]
    assert pairing.ask()  # the same pair once more
    assert pairing.take() == ('s', 't')
