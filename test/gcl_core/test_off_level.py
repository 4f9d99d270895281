"""A vehicle off level by a few degrees is found, though the search assumes level ones."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import PointCloud


@pytest.fixture(scope='module')
def registrar():
    return Registrar(RegistrarConfig(headings=1))


@pytest.mark.parametrize('tilt_deg', [{'roll': 6.0}, {'pitch': 6.0}])
def test_off_level_vehicle_is_found_in_all_six_degrees(registrar, drive, tilt_deg):
    tilt = se3.from_xyz_rpy(**{axis: np.deg2rad(angle) for axis, angle in tilt_deg.items()})
    source = PointCloud(se3.transform(tilt, drive.scan(102).points))
    result = registrar.register(source=source, target=drive.scan(90))
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(102) @ se3.inverse(tilt)
    assert metrics.registered(result.T_target_source, T, metrics.STRICT)
