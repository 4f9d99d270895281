"""A packed bag is the bag it was made from but for its clouds, and is read as it was."""

import json
import sys
import threading

import numpy as np
import pytest
from recordings import TYPES, cloud, odometry, transform, write
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial import cKDTree
from sensor_msgs.msg import PointCloud2

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.data.formats import open_sequence
from gcl_core.evaluation import metrics
from gcl_core.types import PointCloud
from gcl_ros import evaluate_bag
from gcl_ros.bag import SOURCE, TARGET, VERSION, Encounter, read_encounters, write_bag
from gcl_ros.bag_info import look
from gcl_ros.bag_packing import pack_bag
from gcl_ros.bag_reader import cloud_of, open_bag
from gcl_ros.compact_cloud import compact_cloud, is_compact
from gcl_ros.conversions import point_cloud
from gcl_ros.playback import Playback, replay

CLOUD = 'sensor_msgs/msg/PointCloud2'
LATCHED = Qos(
    QosHistory.KEEP_LAST,
    3,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)
PACKETS = 'velodyne_msgs/msg/VelodynePacket'
PLUGINS = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}
NOISE = np.random.default_rng(0).normal(0, 9, (500, 3)).astype(np.float32)


@pytest.fixture(scope='module')
def scans(drive):
    return [drive.scan(i) for i in (90, 95, 100)]


def times(count):
    return [10**9 + i * 10**8 for i in range(count)]


def recorded(path, scans, storage='mcap', poses=None):
    """A drive as a recorder leaves it: clouds, poses, mount, a driver's packets."""
    odom = TYPES.types['nav_msgs/msg/Odometry']
    with Writer(path, version=VERSION, storage_plugin=PLUGINS[storage]) as writer:
        add = writer.add_connection
        points = add('/points', CLOUD, typestore=TYPES, offered_qos_profiles=[LATCHED])
        odometer = add('/odom', odom.__msgtype__, typestore=TYPES)
        definition = {'msgdef': 'uint8[] data\n', 'rihs01': f'RIHS01_{"ab" * 32}'}
        packets = add('/packets', PACKETS, **definition)
        writer.set_custom_data('vehicle', 'red')
        for i, (stamp, scan) in enumerate(zip(times(len(scans)), scans, strict=True)):
            message = cloud(stamp, scan.points) if isinstance(scan, PointCloud) else scan
            pose = odometry(stamp, poses[i] if poses else se3.from_xyz_rpy(5.0 * i), 'lidar')
            for connection, sent in ((points, message), (odometer, pose)):
                raw = TYPES.serialize_cdr(sent, sent.__msgtype__)
                writer.write(connection, stamp + 10**7, raw)
            writer.write(packets, stamp + 10**7, b'\0\1\0\0\3\0\0\0abc')
    return path


def content(path):
    with open_bag(path) as bag:
        topics = [(c.topic, c.msgtype, c.msgdef, c.digest, c.ext) for c in bag.connections]
        rows = [(c.topic, written, bytes(raw)) for c, written, raw in bag.raw()]
        return topics, rows, bag.custom


@pytest.mark.parametrize('storage', PLUGINS)
@pytest.mark.parametrize('given', PLUGINS)
def test_all_but_the_clouds_is_as_it_was(tmp_path, scans, storage, given, capsys):
    path, out = recorded(tmp_path / 'drive', scans, given), tmp_path / 'packed'
    assert main(['bag', 'pack', str(path), str(out), '--storage', storage]) == 0
    assert '/points  3 clouds packed' in capsys.readouterr().out
    before, after = content(path), content(out)
    assert sorted(map(repr, after[0])) == sorted(map(repr, before[0]))
    assert after[2] == before[2] == {'vehicle': 'red'}
    assert [row[:2] for row in after[1]] == [row[:2] for row in before[1]]
    for (topic, _, raw), (_, _, own) in zip(after[1], before[1], strict=True):
        if topic != '/points':
            assert raw == own
            continue
        message, cloud_before = (TYPES.deserialize_cdr(r, CLOUD) for r in (raw, own))
        assert message.header == cloud_before.header
        expected = decode(encode(point_cloud(cloud_before))).points
        np.testing.assert_array_equal(compact_cloud(message).points, expected)
    assert len(list(out.glob(f'*.{"mcap" if storage == "mcap" else "db3"}'))) == 1


def test_a_packed_drive_is_a_drive(tmp_path, scans, capsys):
    path = recorded(tmp_path / 'drive', scans)
    facts = pack_bag(path, tmp_path / 'packed', CompactConfig())
    raw, packed = open_sequence(path), open_sequence(tmp_path / 'packed')
    for i, scan in enumerate(scans):
        np.testing.assert_array_equal(packed.scan(i).points, decode(encode(scan)).points)
        np.testing.assert_array_equal(packed.T_world_lidar(i), raw.T_world_lidar(i))
    (topic,) = facts.topics
    assert topic.after * 50 < topic.before
    assert facts.before > sum(12 * len(scan) for scan in scans) > 50 * topic.after
    assert facts.after == sum(file.stat().st_size for file in (tmp_path / 'packed').iterdir())
    assert main(['inspect', '--data', str(tmp_path / 'packed'), '--pair', '1', '0']) == 0
    assert '5.0 m and 0.0°' in capsys.readouterr().out


def test_info_knows_compact_topics(tmp_path, scans, capsys):
    path = recorded(tmp_path / 'drive', scans)
    pack_bag(path, tmp_path / 'packed', CompactConfig())
    assert main(['bag', 'info', str(tmp_path / 'packed')]) == 0
    sizes = [len(encode(scan)) for scan in scans]
    voxels = int(np.median([len(decode(encode(scan))) for scan in scans]))
    line = next(li for li in capsys.readouterr().out.splitlines() if '/points' in li)
    assert line.endswith(
        f"frame 'lidar', compact, {np.mean(sizes):,.0f} bytes on average, {voxels:,} voxels"
    )
    rows = {topic.name: topic for topic in look(path).topics}
    assert rows['/points'].compact_bytes is None
    assert main(['bag', 'info', str(tmp_path / 'packed'), '--json']) == 0
    topics = json.loads(capsys.readouterr().out)['topics']
    assert {t['name']: t['compact_bytes'] for t in topics}['/points'] == np.mean(sizes)


def test_one_topic_of_two_is_packed_with_the_settings_told(tmp_path, scans, capsys):
    rows = [(f'/{name}', t, cloud(t, scans[0].points)) for t in times(1) for name in 'ab']
    path, out = write(tmp_path / 'both', rows), tmp_path / 'out'
    settings = ['--topics', '/b', '--voxel-size', '0.5', '--residual-bits', '2', '--json']
    assert main(['bag', 'pack', str(path), str(out), *settings]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [(t['name'], t['packed'], t['left']) for t in facts['topics']] == [('/b', 1, 0)]
    np.testing.assert_array_equal(open_sequence(out, '/a').scan(0).points, scans[0].points)
    expected = decode(encode(scans[0], CompactConfig(0.5, residual_bits=2)))
    np.testing.assert_array_equal(open_sequence(out, '/b').scan(0).points, expected.points)


def test_clouds_that_cannot_be_packed_stay_and_are_told(tmp_path, scans, capsys):
    empty = cloud(times(2)[1], NOISE)
    empty.width = 0
    empty.data = np.empty(0, np.uint8)
    rows = [scans[0], empty, PointCloud(NOISE * 0 + 500)]
    path, out = recorded(tmp_path / 'drive', rows), tmp_path / 'out'
    assert main(['bag', 'pack', str(path), str(out)]) == 0
    said = capsys.readouterr().out
    assert '/points  1 clouds packed, ' in said
    assert "; 2 stay as they were: cloud in frame 'lidar' is empty" in said
    before, after = (content(p)[1] for p in (path, out))
    assert [a == b for a, b in zip(after, before, strict=True) if a[0] == '/points'] == [
        False,
        True,
        True,
    ]
    np.testing.assert_array_equal(open_sequence(out).scan(2).points, NOISE * 0 + 500)


def swept(stamp, points, after):
    """A cloud whose points tell when they were seen, nanoseconds after its stamp."""
    message = cloud(stamp, points)
    field = TYPES.types['sensor_msgs/msg/PointField']
    table = np.zeros(len(points), [('xyz', '<f4', 3), ('t', '<u4')])
    table['xyz'], table['t'] = points, after
    message.fields = [*message.fields, field(name='t', offset=12, datatype=6, count=1)]
    message.point_step, message.row_step = 16, 16 * len(points)
    message.data = np.frombuffer(table.tobytes(), np.uint8)
    return message


AFTER = np.linspace(0, 10**8, 500).astype(np.uint32)


def test_lost_times_of_points_are_told(tmp_path, capsys):
    timed, plain = swept(times(1)[0], NOISE, AFTER), cloud(times(1)[0], NOISE)
    for name, sent in (('timed', timed), ('plain', plain)):
        path = write(tmp_path / name, [('/points', 1, sent)])
        assert main(['bag', 'pack', str(path), str(tmp_path / f'{name}_packed')]) == 0
        told = '1 of them can no longer be de-skewed' in capsys.readouterr().out
        assert told == (name == 'timed')


def test_clouds_are_de_skewed_by_the_bags_own_odometry(tmp_path, capsys):
    """At 20 m/s along x, of a LiDAR that is mounted across."""
    T_base_lidar = se3.from_xyz_rpy(1.0, yaw=np.pi / 2)
    T_odom_base = lambda seconds: se3.from_xyz_rpy(20 * seconds)  # noqa: E731
    scans, still = [], []
    for stamp in times(60)[::10]:
        poses = np.stack([T_odom_base(a * 1e-9) @ T_base_lidar for a in AFTER.tolist()])
        world = se3.transform(T_base_lidar, NOISE.astype(float))  # at the stamp, from the origin
        seen = np.stack([se3.transform(se3.inverse(T), w[None])[0] for T, w in zip(poses, world)])
        scans.append(('/points', stamp + 10**8, swept(stamp, seen.astype(np.float32), AFTER)))
        still.append(NOISE)
    odometer = [('/odom', t, odometry(t, T_odom_base(t * 1e-9))) for t in times(60)]
    link = transform(0, 'base_link', 'lidar', T_base_lidar)
    static = [('/tf_static', 0, TYPES.types['tf2_msgs/msg/TFMessage'](transforms=[link]))]
    path = write(tmp_path / 'drive', sorted(scans + odometer + static, key=lambda row: row[1]))
    out = tmp_path / 'packed'
    settings = ['--odometry', '/odom', '--voxel-size', '0.02', '--max-range', '60']
    assert main(['bag', 'pack', str(path), str(out), *settings]) == 0
    said = capsys.readouterr().out
    assert '6 of them de-skewed first' in said
    assert 'no longer' not in said
    drive = open_sequence(out)
    for index, points in enumerate(still):
        away, _ = cKDTree(points).query(drive.scan(index).points)
        assert away.max() < 0.03
    assert main(['bag', 'pack', str(path), str(tmp_path / 'x'), '--odometry', '/points']) == 2
    assert 'has no topic of poses /points; it has /odom' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['none', 'out'], 'cannot read bag none: it does not exist'),
        (['drive', 'drive'], 'drive exists already; remove it or choose another name'),
        (['drive', 'out', '--topics', '/x'], 'has no topic of clouds /x; it has /points'),
        (['poses', 'out'], 'bag poses holds no clouds; it has none of sensor_msgs'),
        (['packed', 'out'], 'no cloud of /points was packed: it is compact already'),
        (['far', 'out'], 'lies within 100 m of the sensor'),
        (['drive', 'out', '--voxel-size', '99'], 'voxel_size is 99 m; choose'),
        (['drive', 'out', '--max-range', '1000', '--voxel-size', '0.01'], 'larger voxels'),
        (['cut', 'out'], 'cut off or damaged'),
    ],
)
def test_what_cannot_be_packed_is_refused_and_nothing_is_left(
    arguments, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    wide = np.vstack([NOISE, [[-700, 0, 0], [700, 0, 0]]]).astype(np.float32)
    path = recorded(tmp_path / 'drive', [PointCloud(wide)])
    write(tmp_path / 'poses', [('/odom', 1, odometry(1, np.eye(4)))])
    recorded(tmp_path / 'far', [PointCloud(NOISE + 900)])
    pack_bag(path, tmp_path / 'packed', CompactConfig())
    whole = next(recorded(tmp_path / 'cut', [PointCloud(NOISE)]).glob('*.mcap'))
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    before = sorted(tmp_path.rglob('*'))
    assert main(['bag', 'pack', *arguments]) == 2
    assert message in capsys.readouterr().err
    assert sorted(tmp_path.rglob('*')) == before


@pytest.fixture(scope='module')
def encounters(drive):
    """Pairs that meet, 8 to 20 m apart, and one of noise."""
    pairs = [(98, 90), (70, 60), (140, 122)]
    found = []
    for number, (s, t) in enumerate(pairs):
        T = se3.inverse(drive.T_world_lidar(t)) @ drive.T_world_lidar(s)
        found.append(Encounter(1.0 + number, drive.scan(s), drive.scan(t), T))
    noise = PointCloud(np.random.default_rng(1).normal(0, 12, (3000, 3)).astype(np.float32))
    return [*found, Encounter(9.0, noise, drive.scan(90), np.eye(4))]


@pytest.fixture(scope='module')
def two_bags(encounters, tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    write_bag(folder / 'raw', encounters, pair_list='four pairs')
    pack_bag(folder / 'raw', folder / 'packed', CompactConfig())
    return folder


def recall(folder, tmp_path, monkeypatch, capsys):
    """Rows of the bags `raw` and `packed`, evaluated offline."""
    (tmp_path / 'fast.yaml').write_text('headings: 1\n')
    rows = {}
    for name in ('raw', 'packed'):
        arguments = [str(folder / name), '--out', str(tmp_path / f'out_{name}'), '--json']
        config = ['--offline', '--config', str(tmp_path / 'fast.yaml')]
        monkeypatch.setattr(sys, 'argv', ['evaluate_bag', *arguments, *config])
        assert evaluate_bag.main() == 0
        printed = json.loads(capsys.readouterr().out)
        kept = ('bin', 'pairs', 'strict', 'loose', 'wrong')
        rows[name] = printed['pairs'], [[row[key] for key in kept] for row in printed['rows']]
    return rows


def test_a_packed_bag_is_evaluated_with_the_same_recall(two_bags, tmp_path, monkeypatch, capsys):
    rows = recall(two_bags, tmp_path, monkeypatch, capsys)
    assert rows['packed'] == rows['raw']
    label, bins = rows['raw']
    assert label == 'four pairs'
    assert sum(strict for _, _, strict, _, _ in bins) == 3
    assert [wrong for *_, wrong in bins] == [0] * len(bins)


def test_a_bag_of_real_scans_keeps_its_recall(real_root, tmp_path, monkeypatch, capsys):
    made = ['bag', 'from-kitti', str(real_root), '80', str(tmp_path / 'raw')]
    assert main([*made, '--distance', '20', '--every', '14']) == 0
    assert main(['bag', 'pack', str(tmp_path / 'raw'), str(tmp_path / 'packed'), '--json']) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert all(t['after'] / t['packed'] < 14_000 for t in facts['topics'])
    assert facts['before'] / facts['after'] > 100
    rows = recall(tmp_path, tmp_path, monkeypatch, capsys)
    assert rows['packed'] == rows['raw']
    assert sum(pairs for _, pairs, *_ in rows['raw'][1]) >= 2
    assert sum(strict for _, _, strict, _, _ in rows['raw'][1]) > 0


def test_a_packed_drive_is_evaluated(tmp_path, scans, drive, capsys):
    poses = [drive.T_world_lidar(i) for i in (90, 95, 100)]
    path, out = recorded(tmp_path / 'drive', scans, poses=poses), tmp_path / 'packed'
    pack_bag(path, out, CompactConfig())
    (tmp_path / 'fast.yaml').write_text('headings: 1\n')
    (tmp_path / 'few.txt').write_text('packed 1 0\npacked 2 1\n')
    arguments = ['--pairs', str(tmp_path / 'few.txt'), '--registrar', str(tmp_path / 'fast.yaml')]
    assert main(['evaluate', '--data', str(out), *arguments, '--json']) == 0
    (row,) = json.loads(capsys.readouterr().out)['rows']
    assert (row['pairs'], row['strict']) == (2, 2)


def test_encounters_of_a_packed_bag_are_those_of_the_scans(two_bags, encounters):
    for own, packed in zip(encounters, read_encounters(two_bags / 'packed'), strict=True):
        assert packed.stamp == own.stamp
        np.testing.assert_allclose(packed.T_target_source, own.T_target_source, atol=1e-12)
        for side in ('source', 'target'):
            expected = decode(encode(getattr(own, side))).points
            np.testing.assert_array_equal(getattr(packed, side).points, expected)
    assert not metrics.registered(np.eye(4), encounters[0].T_target_source, metrics.STRICT)


def test_a_packed_bag_is_replayed_over_dds(rig, two_bags, encounters):
    heard = {topic: rig.listen(PointCloud2, topic) for topic in (SOURCE, TARGET)}
    played = threading.Thread(
        target=replay, args=(two_bags / 'packed', Playback(rate=20.0), rig.node), daemon=True
    )
    played.start()
    played.join(timeout=60)
    assert rig.until(lambda: all(len(messages) == 4 for messages in heard.values()))
    for topic, side in ((SOURCE, 'source'), (TARGET, 'target')):
        for message, own in zip(heard[topic], encounters, strict=True):
            assert is_compact(message)
            expected = decode(encode(getattr(own, side))).points
            np.testing.assert_array_equal(cloud_of(message).points, expected)
