"""The heading of the last transform: where it is looked for first, and nothing more."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_ros.exchange import Exchange
from gcl_ros.heading import Heading
from gcl_ros.views import STEPS, Look, look_at


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
    exchange = Exchange(Registrar())
    yield exchange
    exchange.close()


@pytest.fixture(scope='module')
def turned(meeting):
    """The source turned beyond what one heading bears, the target, the truth."""
    turn = se3.from_xyz_rpy(yaw=2.0)
    source, target, T = meeting
    clouds = (PointCloud(se3.transform(turn, source).astype(np.float32)), PointCloud(target))
    return *clouds, T @ se3.inverse(turn)


@pytest.mark.parametrize(
    ('off', 'headings'), [(0.0, {1}), (0.1, {1}), (np.pi / 2, {5, 17}), (None, {4, 16})]
)
def test_a_wrong_one_costs_time_and_nothing_else(exchange, turned, off, headings):
    source, target, T = turned
    yaw = None if off is None else se3.yaw(T) + off
    scans = {'source': exchange.raw(source), 'target': exchange.raw(target)}
    registered = exchange.register(**scans, yaw=yaw)
    assert registered.result.accepted
    assert metrics.registered(registered.result.T_target_source, T, metrics.STRICT)
    assert registered.headings in headings
    assert len(exchange.agreeing(registered)) > 20


def test_what_was_prepared_is_not_made_again(exchange, turned):
    source, target, T = turned
    scans = exchange.raw(source), exchange.raw(target)
    yaw = se3.yaw(T)
    exchange.prepare_target(scans[1])
    exchange.prepare_source(scans[0], yaw=yaw)
    between = se3.yaw(scans[1].T_view_lidar @ T @ se3.inverse(scans[0].T_view_lidar))
    kept = exchange._views.get(scans[0], look_at(between)), exchange._views.get(scans[1], Look())
    registered = exchange.register(source=scans[0], target=scans[1], yaw=yaw)
    assert registered.source is kept[0]
    assert registered.target is kept[1]


def test_a_second_look_takes_over_what_the_first_made(exchange, turned):
    scan = exchange.raw(turned[0])
    first, second = (exchange._views.get(scan, Look(turns)) for turns in (4, 12))
    assert second.surface is first.surface
    assert second.prepared is first.prepared
    assert all(a is b for a, b in zip(first.headings, second.headings[::3], strict=True))
