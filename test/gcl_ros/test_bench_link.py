"""The emulated channel, where the machine lets one be made; else it must say what it needs."""

import math
import os
import random
import shutil
import subprocess
import sys
from contextlib import ExitStack

import pytest

from gcl_core.errors import GclError
from gcl_ros.bench_channel import TUN, Channel, Conditions
from gcl_ros.bench_link import Case, cases, flat, measure, parser, row, table

MIGHT = os.geteuid() == 0 and bool(shutil.which('ip')) and TUN.exists()
QUIET = Conditions(27.0, loss=0.0)

RECEIVE = """
import socket, sys, time
heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
heard.bind(('0.0.0.0', 5000))
heard.settimeout(5.0)
print('ready', flush=True)
try:
    while True:
        data = heard.recv(2000)
        print(time.time(), *data[:30].decode().split(), len(data), flush=True)
except TimeoutError:
    pass
"""
SEND = """
import socket, sys, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
where = ('10.77.0.%s' % sys.argv[1], 5000)
out.sendto(b'0 -1'.ljust(30), where)  # from now on their addresses are known
time.sleep(0.5)
for number in range(int(sys.argv[2])):
    out.sendto(f'{time.time()} {number}'.encode().ljust(1000), where)
"""


@pytest.fixture(autouse=True)
def own_domain(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(random.randint(1, 100)))


def namespaces() -> str:
    return subprocess.run(['ip', 'netns', 'list'], capture_output=True, text=True).stdout


def through(air, senders, number):
    """What the last station hears of datagrams of the others: (heard, sent, number) of each."""
    with Channel(senders + 1, air) as channel, ExitStack() as running:
        python = [sys.executable, '-S', '-c']
        pipe = {'stdout': subprocess.PIPE, 'text': True}
        receiver = channel.start(senders, [*python, RECEIVE], **pipe)
        running.enter_context(receiver)
        receiver.stdout.readline()
        for station in range(senders):
            command = [*python, SEND, str(senders + 1), str(number)]
            running.enter_context(channel.start(station, command))
        lines = [line.split() for line in receiver.stdout]
    return [(float(a), float(b), int(c)) for a, b, c, _ in lines if c != '-1']


@pytest.mark.parametrize('senders', [1, 3])
def test_stations_share_the_rate(senders):
    if not MIGHT:
        with pytest.raises(GclError, match=r'needs root.*iproute2'), Channel(2, QUIET):
            pass
        return
    found = through(Conditions(8.0, loss=0.0), senders, number=300)
    assert len(found) == 300 * senders
    times = [heard for heard, *_ in found]
    assert max(times) - min(times) > 0.9 * len(found) * 8e-6 * 1066 / 8.0  # no faster than it is
    assert min(heard - sent for heard, sent, _ in found) > 0.02
    assert 'gcl_' not in namespaces()


def test_as_many_frames_are_lost_as_are_said_and_none_comes_out_of_turn():
    if not MIGHT:
        return
    found = through(Conditions(27.0, loss=0.2), 1, number=1000)
    numbers = [number for *_, number in found]
    assert 740 < len(numbers) < 860  # 800 and nearly five standard deviations
    assert numbers == sorted(numbers)


def test_what_it_made_goes_when_something_fails():
    if not MIGHT:
        return
    made = []

    def fail() -> None:
        with Channel(3, QUIET) as channel:
            made.extend(name for name in channel.names if name in namespaces())
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert len(made) == 3
    assert 'gcl_' not in namespaces()


@pytest.mark.parametrize('wrong', [{'mbit': 0}, {'loss': 1.0}, {'delay': -1.0}])
def test_conditions_that_no_channel_has(wrong):
    with pytest.raises(GclError, match='choose'):
        Conditions(**{'mbit': 6.0, **wrong})


def test_scans_over_a_channel(tmp_path):
    """All that is small comes, whoever sends; of what is large, nothing before its bytes."""
    if not MIGHT:
        return
    found = measure(Case('compact', 2, False, QUIET, number=10), tmp_path)
    assert (found.received, found.sent) == (20, 20)
    assert found.median_ms > 20.0  # the delay alone
    found = measure(Case('raw', 1, False, QUIET, number=2), tmp_path)
    assert found.received == 2
    assert found.median_ms > 1.92e6 * 8 / 27e6 * 1e3
    assert 'gcl_' not in namespaces()


def test_what_did_not_come_is_said():
    case = Case('compact', 2, True, Conditions(6.0), number=3)
    some, none = row(case, [0.5, 0.7], [0.001]), row(case, [], [])
    assert (some.sent, some.received, some.median_ms) == (6, 2, 600.0)
    assert (none.sent, none.received) == (6, 0)
    assert math.isnan(none.median_ms)
    lines = table([some, none]).splitlines()
    assert lines[2].startswith('| 6 | 5 | 2 | compact | yes | 2/6 | 600.0 |')
    assert lines[3].endswith('| 0/6 | nan | nan |')
    assert (
        flat(some).items() >= {'mbit': 6.0, 'loss': 0.05, 'received': 2, 'bytes': 10_000}.items()
    )


def test_every_rate_with_and_without_loss_then_every_number_of_vehicles():
    asked = cases(parser().parse_args(['--mbit', '27', '6', '--raw', '4', '--number', '9']))
    alone = [case for case in asked if case.vehicles == 1]
    places = [(case.air.mbit, case.air.loss) for case in alone]
    assert places == [(m, loss) for m in (27.0, 6.0) for loss in (0.0, 0.05) for _ in range(4)]
    assert [(c.scans, c.number) for c in alone[:4]] == [('raw', 4)] * 2 + [('compact', 9)] * 2
    together = [case for case in asked if case.vehicles > 1]
    assert {case.vehicles for case in together} == {2, 5, 10}
    assert {(case.scans, case.air.mbit) for case in together} == {('compact', 10.0)}
    slow = next(case for case in alone if (case.scans, case.air.mbit) == ('raw', 6.0))
    assert slow.period == pytest.approx(2 * 1.92e6 * 8 / 6e6)
