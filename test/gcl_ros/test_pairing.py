import threading

from gcl_ros.pairing import Pairing
from gcl_ros.pairings import Pairings


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
    assert pairing.offset(lately=2.0) is None
    pairing.add('source', 107.5, 's')
    pairing.add('target', 100.0, 't')
    assert pairing.offset(lately=2.0) == 7.5
    assert take_now(pairing) is None


def test_a_stream_that_comes_later_is_no_offset_while_pairs_come():
    now = [0.0]
    pairing = Pairing(max_dt=0.05, clock=lambda: now[0])
    for i in range(5):
        pairing.add('source', float(i), f's{i}')
        pairing.add('target', i - 1.0, f't{i - 1}')  # a second late
        now[0] += 1.0
    assert pairing.counts.pairs == 4
    assert pairing.offset(lately=2.0) is None
    now[0] += 1.5
    assert pairing.offset(lately=2.0) == 1.0


def test_streams_out_of_step_find_the_nearer_neighbour_again():
    """Sweeps of 10 Hz, 0.01 s apart: a lost one must not shift all pairs after it by a sweep."""
    pairing = Pairing(max_dt=0.1)
    pairs = []
    for i in range(10):
        if i != 4:  # of the source, lost
            pairing.add('source', i / 10, i)
        pairing.add('target', i / 10 + 0.01, i)
        pairs.append(take_now(pairing))
    assert pairs == [(i, i) if i != 4 else None for i in range(10)]
    assert pairing.counts.pairs == 10  # one of them replaced by the nearer one
    assert pairing.counts.replaced == 1


def test_streams_half_a_sweep_apart_are_paired_once_each():
    pairing = Pairing(max_dt=0.1)
    for i in range(20):
        jitter = 0.002 * (-1) ** i
        pairing.add('source', i / 10, f's{i}')
        pairing.add('target', i / 10 + 0.05 + jitter, f't{i}')
    assert pairing.counts.pairs == 20


def test_a_question_outlives_a_jump_back_in_time():
    """What was asked for is gone: the next pair is the answer, and the consumer does not end."""
    pairings = Pairings(['a'], max_dt=0.05, on_demand=True)
    pairing = pairings.of['a']
    pairing.add('source', 100.0, 's')
    pairing.add('target', 100.0, 't')
    assert pairing.ask()
    pairing.add('source', 3.0, 's3')
    taken = []
    thread = threading.Thread(target=lambda: taken.append(pairings.take()))
    thread.start()
    thread.join(timeout=0.2)
    assert not taken
    pairing.add('target', 3.0, 't3')
    thread.join(timeout=5)
    assert taken == [('a', 's3', 't3')]


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
