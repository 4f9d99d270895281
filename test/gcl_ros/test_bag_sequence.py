"""A bag as a drive: clouds, odometry at other times, a static mount."""

import numpy as np
import pytest
from recordings import M, cloud, header, odometry, pose, transform, write
from rosbags.rosbag2 import StoragePlugin

from gcl_core import se3
from gcl_core.data.formats import open_sequence
from gcl_core.errors import GclError
from gcl_ros.bag_sequence import BagSequence

STEP = 200_000_000  # nanoseconds between poses; scans lie half-way
T_BASE_LIDAR = se3.from_xyz_rpy(1.2, 0.0, 1.7, yaw=0.3)
T_BASE_RIG = se3.from_xyz_rpy(0.5, yaw=-0.2)


def base(seconds):
    """Pose of the vehicle: 5 m/s along a gentle curve."""
    turn = 0.1 * seconds
    return se3.from_xyz_rpy(x=50 * np.sin(turn), y=50 - 50 * np.cos(turn), yaw=turn)


def stamps(count):
    return [10**9 + i * STEP + STEP // 2 for i in range(count)]


def clouds(scans, topic='/points', frame='lidar'):
    """Written all at once, and the last first, as a late driver would."""
    times = stamps(len(scans))
    rows = list(zip(times, scans, strict=True))
    return [(topic, 5 * 10**9, cloud(t, s.points, frame)) for t, s in rows[::-1]]


def tracks(count=5, child='base_link'):
    times = [10**9 + i * STEP for i in range(count)]
    return [('/odom', t, odometry(t, base(t * 1e-9), child)) for t in times]


def mount():
    links = [
        transform(0, 'rig', 'lidar', se3.inverse(T_BASE_RIG) @ T_BASE_LIDAR),
        transform(0, 'base_link', 'rig', T_BASE_RIG),
    ]
    return [('/tf_static', 0, M['tf2_msgs/msg/TFMessage'](transforms=links))]


@pytest.fixture(scope='module')
def scans(drive):
    return [drive.scan(i) for i in (90, 91, 92)]


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_scans_by_stamp_with_interpolated_poses(tmp_path, scans, storage):
    path = write(tmp_path / 'ride', mount() + tracks() + clouds(scans), storage)
    for sequence in (open_sequence(path), open_sequence(next(path.glob('ride.*')))):
        assert sequence.name == 'bag/ride'
        assert len(sequence) == 3
        for i, (scan, stamp) in enumerate(zip(scans, stamps(3), strict=True)):
            np.testing.assert_array_equal(sequence.scan(i).points, scan.points)
            expected = base(stamp * 1e-9) @ T_BASE_LIDAR
            np.testing.assert_allclose(sequence.T_world_lidar(i), expected, atol=1e-6)


def test_poses_of_the_clouds_own_frame_need_no_mount(tmp_path, scans):
    path = write(tmp_path / 'b', clouds(scans) + tracks(child='lidar'))
    expected = base(stamps(3)[1] * 1e-9)
    np.testing.assert_allclose(BagSequence(path).T_world_lidar(1), expected, atol=1e-6)


@pytest.mark.parametrize('stamped', ['TransformStamped', 'PoseStamped'])
def test_other_kinds_of_poses(tmp_path, scans, stamped):
    rows = []
    for i in range(5):
        t = 10**9 + i * STEP
        T = base(t * 1e-9)
        rows.append(
            ('/p', t, transform(t, 'map', 'lidar', T))
            if stamped == 'TransformStamped'
            else ('/p', t, M['geometry_msgs/msg/PoseStamped'](header(t, 'map'), pose(T)))
        )
    path = write(tmp_path / 'b', clouds(scans) + rows)
    expected = base(stamps(3)[2] * 1e-9)
    if stamped == 'PoseStamped':
        with pytest.raises(GclError, match=r"poses are of frame ''.*give T_child_lidar"):
            BagSequence(path).T_world_lidar(2)
        sequence = BagSequence(path, T_child_lidar=T_BASE_LIDAR)
        expected = expected @ T_BASE_LIDAR
    else:
        sequence = BagSequence(path, pose_topic='/p')
    np.testing.assert_allclose(sequence.T_world_lidar(2), expected, atol=1e-6)


def test_an_unknown_mount_is_refused(tmp_path, scans):
    path = write(tmp_path / 'b', clouds(scans) + tracks())
    with pytest.raises(GclError, match="of frame 'base_link', the clouds in 'lidar'"):
        BagSequence(path).T_world_lidar(0)


def test_scans_without_poses_around_are_refused(tmp_path, scans):
    path = write(tmp_path / 'late', clouds(scans) + tracks(2, 'lidar'))
    BagSequence(path).T_world_lidar(0)
    with pytest.raises(GclError, match=r'scan at 1\.300 s lies outside the poses, 1\.000 to 1\.2'):
        BagSequence(path).T_world_lidar(1)
    rows = tracks(5, 'lidar')
    path = write(tmp_path / 'gap', clouds(scans) + rows[:1] + rows[-1:])
    with pytest.raises(GclError, match=r'lies between poses 0\.80 s apart'):
        BagSequence(path).T_world_lidar(1)


def test_missing_and_ambiguous_topics_are_named(tmp_path, scans):
    bare = BagSequence(write(tmp_path / 'bare', clouds(scans)))
    assert len(bare.scan(0)) == len(scans[0])
    with pytest.raises(GclError, match='needs one topic of poses, name it; it has none of nav'):
        bare.T_world_lidar(0)
    both = write(tmp_path / 'both', clouds(scans, '/a') + clouds(scans, '/b'))
    with pytest.raises(GclError, match='needs one topic of clouds, name it; it has /a, /b'):
        open_sequence(both)
    assert len(open_sequence(both, '/b')) == 3
    with pytest.raises(GclError, match="'other' is not there; there are both"):
        open_sequence(both, 'other')
    with pytest.raises(GclError, match='has no topic of clouds /c; it has /a, /b'):
        open_sequence(both, '/c')
    with pytest.raises(GclError, match='it has none of sensor_msgs'):
        BagSequence(write(tmp_path / 'poses', tracks()))
    mixed = clouds(scans[:1]) + clouds(scans[1:], frame='other')
    with pytest.raises(GclError, match='mixes the frames lidar, other'):
        BagSequence(write(tmp_path / 'mixed', mixed))
    path = write(tmp_path / 'two', clouds(scans) + tracks(2) + tracks(2, 'lidar'))
    with pytest.raises(GclError, match='mixes the frames base_link, lidar'):
        BagSequence(path).T_world_lidar(0)


def test_damaged_bags_are_named(tmp_path):
    (tmp_path / 'metadata.yaml').write_text('nonsense')
    with pytest.raises(GclError, match='cannot read bag'):
        open_sequence(tmp_path)
