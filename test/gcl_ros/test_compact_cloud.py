"""Compact scans as a PointCloud2: what is written is read back, what does not fit is refused."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros.bag_reader import deserialized
from gcl_ros.compact_cloud import FIELD, compact_cloud, compact_header, fill_compact, is_compact
from gcl_ros.conversions import fill_point_cloud2, point_cloud

POINTS = np.random.default_rng(0).uniform(-40, 40, (3000, 3)).astype(np.float32)


def written(**config) -> PointCloud2:
    data = encode(PointCloud(POINTS), CompactConfig(**config))
    message = fill_compact(PointCloud2(), data, PointField)
    message.header.frame_id = 'lidar'
    return message


@pytest.mark.parametrize('bits', [0, 4])
def test_what_is_written_is_read(bits):
    """By what rclpy takes from the wire and by what the nodes and bags do."""
    message = written(residual_bits=bits)
    expected = decode(bytes(message.data)).points
    wire = serialize_message(message)
    for taken in (
        message,
        deserialize_message(wire, PointCloud2),
        deserialized(wire, 'sensor_msgs/msg/PointCloud2'),
    ):
        assert is_compact(taken)
        assert compact_header(taken).count == len(expected)
        np.testing.assert_array_equal(compact_cloud(taken).points, expected)


def test_raw_clouds_are_told_apart():
    assert not is_compact(fill_point_cloud2(PointCloud2(), POINTS, PointField))


def test_a_reader_of_raw_clouds_names_the_field():
    """What an older version, and any other program, says of a compact scan."""
    with pytest.raises(GclError, match=f"'lidar' has no field 'x'; it has {FIELD}"):
        point_cloud(written())


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (lambda m: setattr(m, 'width', 0), "'lidar' is empty"),
        (lambda m: setattr(m, 'width', m.width + 1), r'claims \d+ points of 1 bytes but carries'),
        (lambda m: m.data.__setitem__(0, 0), "'lidar' is no compact scan"),
        (lambda m: m.data.__setitem__(4, 9), 'format 9, this version reads 1; install the same'),
        (lambda m: m.data.__setitem__(40, m.data[40] ^ 1), "'lidar' is damaged: its checksum"),
        (lambda m: setattr(m.fields[0], 'name', 'gcl2_0123456789ab'), 'run `sender` there'),
        (lambda m: setattr(m.fields[0], 'name', 'gcl1_0123456789ab'), 'run `sender` there'),
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(change, text):
    message = written()
    change(message)
    assert is_compact(message)
    with pytest.raises(GclError, match=text):
        compact_cloud(message)


def test_more_voxels_than_are_taken_are_refused_by_the_header():
    with pytest.raises(GclError, match=r'voxels, 100 are read at most'):
        compact_cloud(written(), most_voxels=100)
