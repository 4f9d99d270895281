"""Scans of a moving sensor come out as if seen at once."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.data.kitti_writer import write_kitti
from gcl_core.errors import GclError
from gcl_core.evaluation.benchmark import BenchmarkConfig, SourceConfig
from gcl_core.evaluation.plan import open_source
from gcl_core.types import PointCloud

SWEEP, STEP = 0.1, 0.3  # seconds
RNG = np.random.default_rng(0)
WORLD = np.stack([*RNG.uniform(-40, 40, (2, 600)), RNG.uniform(-2, 3, 600)], axis=1)


def pose(seconds):
    """12 m/s on a bend of 20 degrees a second."""
    turn, radius = np.deg2rad(20.0) * seconds, 12.0 / np.deg2rad(20.0)
    return se3.from_xyz_rpy(radius * np.sin(turn), radius * (1 - np.cos(turn)), yaw=turn)


class Drive:
    """A clockwise sensor that looks ahead at the time of its pose; `sweep` may be negative."""

    name = 'bend'

    def __init__(self, sweep):
        self.sweep = sweep

    def __len__(self):
        return 4

    def T_world_lidar(self, index):
        return pose(index * STEP)

    def straight(self, index):
        return se3.transform(se3.inverse(self.T_world_lidar(index)), WORLD)

    def scan(self, index):
        """Each point from where the sensor is when it looks that way."""
        seen = self.straight(index)
        for _ in range(5):
            times = -np.arctan2(seen[:, 1], seen[:, 0]) / (2 * np.pi) * self.sweep
            poses = [se3.inverse(pose(index * STEP + t)) for t in times]
            seen = np.stack([T[:3, :3] @ p + T[:3, 3] for T, p in zip(poses, WORLD, strict=True)])
        return PointCloud(seen.astype(np.float32))


@pytest.fixture(params=[SWEEP, -SWEEP], ids=['clockwise', 'counter-clockwise'])
def recorded(request, tmp_path):
    drive = Drive(request.param)
    write_kitti(tmp_path, '05', drive, range(4), [i * STEP for i in range(4)])
    return tmp_path, drive


def off(points, drive, index):
    return np.linalg.norm(points - drive.straight(index), axis=1)


def test_motion_is_taken_out(recorded):
    root, drive = recorded
    source = SourceConfig(data=str(root), sequences=('05',), deskew=drive.sweep)
    sequence = open_source(BenchmarkConfig(source=source))['05']
    assert sequence.name == 'kitti/05, de-skewed'
    for index in range(4):
        behind = np.abs(np.arctan2(*drive.straight(index).T[1::-1])) > 3.0  # the turn's two ends
        assert off(drive.scan(index).points, drive, index).max() > 0.6
        assert off(sequence.scan(index).points, drive, index)[~behind].max() < 0.02
        np.testing.assert_allclose(sequence.T_world_lidar(index), pose(index * STEP), atol=1e-6)


@pytest.mark.parametrize(
    ('times', 'message'),
    [
        (None, r'no file .*times\.txt'),
        ('0 0.3 0.6 0.9', 'expected 1 number a line, got 4'),
        ('0\n0.3\n0.6', 'has 3 times, but there are 4 scans'),
        ('0\n0.3\n0.6\nnan', 'a number that is not finite'),
        ('0\n0.3\n0.6\nx', 'could not convert'),
        ('0\n0.3\n0.3\n0.6', 'these scans are 0 to 0.3 s apart'),
        ('0\n5\n10\n15', 'these scans are 5 to 5 s apart'),
    ],
)
def test_times_that_tell_no_speed_are_named(tmp_path, times, message):
    write_kitti(tmp_path, '05', Drive(SWEEP), range(4), range(4))
    path = tmp_path / 'sequences/05/times.txt'
    path.unlink() if times is None else path.write_text(times)
    with pytest.raises(GclError, match=message):
        open_source(BenchmarkConfig(source=SourceConfig(data=str(tmp_path), deskew=0.1)))


@pytest.mark.parametrize('sweep', [100.0, -1.5, float('nan'), float('inf')])
def test_a_sweep_that_is_none_is_named(tmp_path, sweep):
    write_kitti(tmp_path, '05', Drive(SWEEP), range(4), [i * STEP for i in range(4)])
    with pytest.raises(GclError, match=f'a sweep of {sweep:g} s; expected seconds up to 1'):
        open_source(BenchmarkConfig(source=SourceConfig(data=str(tmp_path), deskew=sweep)))


def test_only_recorded_drives_in_kittis_layout(tmp_path, capsys):
    np.save(tmp_path / '0.npy', np.zeros((10, 3), np.float32))
    assert main(['evaluate', '--data', str(tmp_path), '--deskew', '0.1']) == 2
    assert 'takes times.txt of the KITTI layout' in capsys.readouterr().err
    assert main(['evaluate', '--simulated', '3', '--deskew', '0.1']) == 2
    assert '--deskew is of --data' in capsys.readouterr().err
