"""Views of scans, made once each."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_ros.exchange import Exchange
from gcl_ros.views import Scan


@pytest.fixture(scope='module')
def exchange():
    exchange = Exchange(Registrar())
    yield exchange
    exchange.close()


def test_what_was_prepared_is_not_made_again(exchange, meeting):
    """Nor does it matter which of the two came first, or how its vehicle is turned."""
    turn = se3.from_xyz_rpy(yaw=2.0)
    source, target, T = meeting
    scans = [
        Scan(PointCloud(np.asarray(points, np.float32)))
        for points in (se3.transform(turn, source), target)
    ]
    for scan in reversed(scans):
        exchange.prepare(scan)
    kept = [exchange._views.get(scan) for scan in scans]
    registered = exchange.register(source=scans[0], target=scans[1])
    assert registered.source is kept[0]
    assert registered.target is kept[1]
    assert registered.result.accepted
    T_true = T @ se3.inverse(turn)
    assert metrics.registered(registered.result.T_target_source, T_true, metrics.STRICT)
    assert len(exchange.agreeing(registered)) > 20
