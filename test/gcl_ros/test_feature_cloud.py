"""Features as a PointCloud2: what is written is read back, what does not fit is refused."""

import numpy as np
import pytest
import torch
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import Features
from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.feature_cloud import (
    Described,
    feature_cloud,
    fill_feature_cloud,
    is_feature_cloud,
    selected,
    weights_hash,
)

HASH = '0123456789ab'


def features(count, seed=0) -> Features:
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(count, 3, generator=generator) * 100 - 50
    vectors = torch.randn(count, 32, generator=generator)
    return Features(points, torch.nn.functional.normalize(vectors, dim=1))


def written(headings) -> PointCloud2:
    described = Described(headings, [2.5 + k for k in range(len(headings))])
    return fill_feature_cloud(PointCloud2(), described, HASH, 1000, PointField)


def test_a_thousand_key_points_fit_forty_kilobytes():
    message = written([features(7000)])
    assert (message.height, message.width, len(message.data)) == (1, 1000, 40_000)


def test_most_key_points_are_above_the_ground():
    """Ground has little to tell places apart by, but some of it is needed for the checks."""
    ground, high = features(4000), features(3000, seed=1)
    ground.points[:, 2], high.points[:, 2] = -1.7, 3.0
    both = Features(
        torch.cat([ground.points, high.points]), torch.cat([ground.descriptors, high.descriptors])
    )
    kept = selected(both, 1000)
    assert len(kept) == 1000
    assert int((kept.points[:, 2] > 0).sum()) == 800
    assert len(selected(ground, 1000)) == len(selected(high, 1000)) == 1000
    assert len(selected(both, 6500)) == 6500


def test_round_trip_at_every_heading():
    headings = [features(200 + k, seed=k) for k in range(3)]
    message = written(headings)
    assert (message.height, message.width) == (3, 200)
    assert is_feature_cloud(message)
    read = feature_cloud(message, HASH)
    np.testing.assert_allclose(
        np.exp(1j * np.array(read.yaws)), np.exp([2.5j, 3.5j, 4.5j]), atol=1e-4
    )
    for k, back in enumerate(read.headings):
        distance, row = torch.cdist(
            back.points, headings[k].points, compute_mode='donot_use_mm_for_euclid_dist'
        ).min(1)
        assert distance.max() < 0.01
        cosine = (back.descriptors * headings[k].descriptors[row]).sum(1)
        assert cosine.min() > 0.999
        assert torch.allclose(back.descriptors.norm(dim=1), torch.ones(200), atol=1e-5)


def test_positions_are_written_in_the_sensors_own_frame():
    one = features(200)
    turn = se3.from_xyz_rpy(yaw=1.0)
    turned = Features(torch.from_numpy(se3.transform(turn, one.points.numpy())), one.descriptors)
    message = written([one, turned])
    rows = np.frombuffer(message.data, np.uint8).reshape(2, 200, 40)
    np.testing.assert_allclose(*rows[..., :6].copy().view('<i2').astype(int), atol=1)


def test_the_hash_tells_weights_apart(tiny_network):
    before = weights_hash(tiny_network)
    assert before == weights_hash(tiny_network)
    with torch.no_grad():
        next(tiny_network.parameters())[0] += 1e-3
    assert weights_hash(tiny_network) != before
    assert len(before) == 12


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (lambda m: setattr(m.fields[4], 'name', 'gcl1_' + HASH), 'format 1, this node reads 2'),
        (lambda m: setattr(m.fields[4], 'name', 'gcl2_ffff'), 'weights ffff, this node has 0123'),
        (lambda m: setattr(m.fields[4], 'count', 16), 'not as format 2 says'),
        (lambda m: setattr(m.fields[4], 'datatype', 7), 'not as format 2 says'),
        (lambda m: setattr(m.fields[0], 'datatype', 7), "'x' is missing or not as"),
        (lambda m: setattr(m.fields[4], 'offset', 9), 'lies outside'),
        (lambda m: m.fields.pop(1), "'y' is missing"),
        (lambda m: setattr(m, 'width', 0), 'empty'),
        (lambda m: setattr(m, 'height', 2), 'carries 8000 bytes'),
        (lambda m: setattr(m, 'data', bytes(8000)), 'descriptor is zero'),
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(change, text):
    message = written([features(200)])
    change(message)
    with pytest.raises(GclError, match=text):
        feature_cloud(message, HASH)


def test_raw_clouds_are_told_apart():
    raw = fill_point_cloud2(PointCloud2(), np.zeros((5, 3)), PointField)
    assert not is_feature_cloud(raw)
    with pytest.raises(GclError, match='no field of features; it has x, y, z'):
        feature_cloud(raw, HASH)
