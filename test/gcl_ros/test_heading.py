"""The heading of the last transform: where it is looked for first, and nothing more."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import PointCloud
from gcl_ros.exchange import Exchange
from gcl_ros.heading import Heading
from gcl_ros.views import STEPS, Look, Scan, look_at


def test_it_is_remembered_for_a_while():
    heading = Heading(memory=5.0)
    assert heading.at(0.0) is None
    heading.found(10.0, se3.from_xyz_rpy(yaw=1.0))
    assert heading.at(15.0) == pytest.approx(1.0)
    assert heading.at(15.1) is None
    assert heading.at(4.0) is None  # stamps that jumped back
    heading.forget()
    assert heading.at(10.0) is None
    heading.found(10.0, se3.from_xyz_rpy(yaw=1.0))
    heading.memory = 0.0
    assert heading.at(10.0) is None


@pytest.mark.parametrize('yaw', [-np.pi, -1.0, 0.0, 0.3, 3.14])
def test_it_is_rounded_to_the_nearest_step(yaw):
    look = look_at(yaw)
    off = abs(np.angle(np.exp(1j * (look.yaw - yaw))))
    assert look.turns == 1
    assert 0 <= look.step < STEPS
    assert off <= np.pi / STEPS + 1e-9


@pytest.fixture(scope='module')
def exchange():
    exchange = Exchange(Registrar(RegistrarConfig(turns=6)))
    yield exchange
    exchange.close()


@pytest.fixture(scope='module')
def turned(meeting):
    """The source turned beyond what one heading bears, the target, the truth."""
    turn = se3.from_xyz_rpy(yaw=2.0)
    source, target, T = meeting
    clouds = (PointCloud(se3.transform(turn, source).astype(np.float32)), PointCloud(target))
    return *clouds, T @ se3.inverse(turn)


@pytest.mark.parametrize(('off', 'headings'), [(0.0, 1), (0.3, 1), (np.pi, 7), (None, 6)])
def test_a_wrong_one_costs_time_and_nothing_else(exchange, turned, off, headings):
    source, target, T = turned
    yaw = None if off is None else se3.yaw(T) + off
    registered = exchange.register(source=Scan(source), target=Scan(target), yaw=yaw)
    assert registered.result.accepted
    assert metrics.registered(registered.result.T_target_source, T, metrics.STRICT)
    assert registered.headings == headings
    assert len(exchange.agreeing(registered)) > 20


@pytest.mark.parametrize('described', ['source', 'target'])
def test_it_serves_described_scans_too(exchange, turned, described):
    """The raw side is turned by it, whichever that is; of a described one a row is taken."""
    source, target, T = turned
    scans = {'source': Scan(source), 'target': Scan(target)}
    view = exchange.registrar.view(scans[described].cloud, turns=6)
    scans[described] = Scan(scans[described].cloud, (view.headings[0],))
    registered = exchange.register(**scans, yaw=se3.yaw(T))
    assert registered.result.accepted
    assert registered.swapped == (described == 'source')
    assert registered.headings == 1
    assert metrics.registered(registered.result.T_target_source, T, metrics.STRICT)


def test_a_row_of_a_described_scan_is_taken(exchange, turned):
    source, target, T = turned
    view = exchange.registrar.view(source, turns=6)
    scans = {'source': Scan(source, tuple(view.headings)), 'target': Scan(target)}
    scans['target'] = Scan(target, (exchange.registrar.view(target).headings[0],))
    registered = exchange.register(**scans, yaw=se3.yaw(T))
    assert registered.result.accepted
    assert registered.headings == 1
    assert metrics.registered(registered.result.T_target_source, T, metrics.STRICT)


def test_what_was_prepared_is_not_made_again(exchange, turned):
    source, target, T = turned
    scans = Scan(source), Scan(target)
    yaw = se3.yaw(T)
    exchange.prepare(scans[0], turned=True, swapped=False, yaw=yaw)
    exchange.prepare(scans[1], turned=False, swapped=False, yaw=yaw)
    kept = exchange._views.get(scans[0], look_at(yaw)), exchange._views.get(scans[1], Look())
    registered = exchange.register(source=scans[0], target=scans[1], yaw=yaw)
    assert registered.source is kept[0]
    assert registered.target is kept[1]
