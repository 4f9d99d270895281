"""Small trees in the layouts of the data sets, with three simulated scans 4 m apart."""

import json

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.clouds import write_cloud

SCANS = (90, 92, 94)
TR = np.array([[0, -1, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, -0.3], [0, 0, 0, 1.0]])  # KITTI's
T_EGO_SENSOR = se3.from_xyz_rpy(0.94, 0.0, 1.84, yaw=-1.5)  # nuScenes'
TO_SENSOR = se3.from_xyz_rpy(yaw=np.pi / 2)  # KITTI's axes to the sensor's: x right, y forward


@pytest.fixture(scope='module')
def scans(drive):
    return [drive.scan(i) for i in SCANS]


@pytest.fixture(scope='module')
def poses(drive):
    return [drive.T_world_lidar(i) for i in SCANS]


@pytest.fixture
def kitti(tmp_path, scans, poses):
    """Sequence 08; SemanticKITTI's poses are 5 m along the camera's x from KITTI's."""
    folder = tmp_path / 'sequences' / '08'
    (folder / 'velodyne').mkdir(parents=True)
    (tmp_path / 'poses').mkdir()
    for i, cloud in enumerate(scans):
        write_cloud(folder / 'velodyne' / f'{i:06d}.bin', cloud)
    numbers = ' '.join(str(x) for x in TR[:3].ravel())
    (folder / 'calib.txt').write_text(f'P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: {numbers}\n')
    camera = [TR @ T @ se3.inverse(TR) for T in poses]
    np.savetxt(tmp_path / 'poses/08.txt', [T[:3].ravel() for T in camera])
    shifted = [se3.from_xyz_rpy(x=5.0) @ T for T in camera]
    np.savetxt(folder / 'poses.txt', [T[:3].ravel() for T in shifted])
    return tmp_path


def quaternion(T):
    x, y, z, w = se3.to_quaternion(T[:3, :3])
    return {'rotation': [w, x, y, z], 'translation': T[:3, 3].tolist()}


@pytest.fixture
def nuscenes(tmp_path, scans, poses):
    """Two scenes of one log listed in the wrong order, and a sweep and a camera beside them."""
    (tmp_path / 'samples/LIDAR_TOP').mkdir(parents=True)
    tables = tmp_path / 'v1.0-mini'
    tables.mkdir()
    sample, data, ego = [], [], []
    for i, (cloud, T) in enumerate(zip(scans, poses, strict=True)):
        name = f'samples/LIDAR_TOP/log__{i}.pcd.bin'
        rows = np.zeros((len(cloud), 5), np.float32)
        rows[:, :3] = se3.transform(TO_SENSOR, cloud.points)
        rows.tofile(tmp_path / name)
        T_world_ego = T @ se3.inverse(TO_SENSOR) @ se3.inverse(T_EGO_SENSOR)
        ego.append({'token': f'e{i}', 'timestamp': i, **quaternion(T_world_ego)})
        sample.append({'token': f's{i}', 'scene_token': 'late' if i == 2 else 'early'})
        row = {
            'token': f'd{i}',
            'sample_token': f's{i}',
            'ego_pose_token': f'e{i}',
            'calibrated_sensor_token': 'lidar',
            'timestamp': 1_000_000 + 500_000 * i,
            'is_key_frame': True,
            'filename': name,
        }
        data += [
            row,
            {**row, 'token': f'w{i}', 'is_key_frame': False, 'filename': 'sweeps/LIDAR_TOP/x'},
            {**row, 'token': f'c{i}', 'filename': 'samples/CAM_FRONT/x.jpg'},
        ]
    content = {
        'sample': sample,
        'sample_data': data[::-1],
        'ego_pose': ego,
        'calibrated_sensor': [{'token': 'lidar', **quaternion(T_EGO_SENSOR)}],
        'scene': [{'token': t, 'log_token': 'L'} for t in ('late', 'early')],
        'log': [{'token': 'L', 'logfile': 'n015-2018'}],
    }
    for name, rows in content.items():
        (tables / f'{name}.json').write_text(json.dumps(rows))
    return tmp_path


def entry(i, j, T):
    return f'{i}\t{j}\t3\n' + ''.join('\t'.join(str(x) for x in row) + '\n' for row in T)


@pytest.fixture
def eth(tmp_path, scans, poses):
    """Clouds 0-1 and 2-1 are linked, 0-2 is not."""
    folder = tmp_path / 'wood_autmn'
    folder.mkdir()
    for i, cloud in enumerate(scans):
        write_cloud(folder / f'Hokuyo_{i}.ply', cloud)
    links = [(i, j, se3.inverse(poses[i]) @ poses[j]) for i, j in ((0, 1), (2, 1))]
    (folder / 'gt.log').write_text(''.join(entry(*link) for link in links))
    return folder
