"""The bench of compact scans, on a drive of three scans and one simulated sensor."""

import json
from importlib.util import find_spec

import pytest

from gcl_core.bench import compact
from gcl_core.data.kitti_writer import write_kitti
from gcl_core.data.pairs import BINS, draw_pairs

SCANS = (90, 97, 148)  # of a drive with a scan every metre


@pytest.fixture
def measure(tmp_path, drive, monkeypatch):
    """Function that measures with these arguments; returns what it wrote."""
    monkeypatch.delenv('GCL_REAL_DATA', raising=False)
    monkeypatch.setattr(compact, 'REPEATS', 1)
    write_kitti(tmp_path / 'drives', '80', drive, SCANS, SCANS)
    out = tmp_path / 'compact.json'
    folders = ['--data', tmp_path / 'drives', '--out', out, '--folder', tmp_path / 'runs']

    def run(arguments):
        compact.main([*map(str, folders), *arguments.split()])
        return json.loads(out.read_text())

    return run


def test_bytes_and_time_of_every_source_at_every_voxel_size(measure):
    found = measure('--worlds 1 --sensors vlp16 --scans 2 --per-bin 0')
    rows = {(row['source'], row['voxel_size_m']): row for row in found['sizes']}
    names = ('simulated vlp16', 'recorded 80')
    assert rows.keys() == {(name, size) for name in names for size in compact.VOXEL_SIZES}
    assert found['recall'] == []
    for name in names:
        sizes = [rows[name, size]['bytes_median'] for size in compact.VOXEL_SIZES]
        assert sizes == sorted(sizes, reverse=True)
    for row in rows.values():
        assert row['scans'] == 2
        assert 0 < row['bytes_median'] <= row['bytes_p95'] < row['points_median']
        assert row['voxels_median'] < row['points_median']
        assert row['encode_ms_median'] > 0 < row['decode_ms_median']
        assert (row['draco_bytes_median'] is None) == (find_spec('DracoPy') is None)
    assert found['commit']


def test_recall_of_raw_and_compact_scans_on_the_same_pairs_goes_on(measure, tmp_path):
    found = measure('--worlds 0 --scans 1 --per-bin 1')
    rows = {(row['scans'], row['method'], *row['bin']): row for row in found['recall']}
    methods = ('GCL-ROS', 'GCL-ROS, nothing withheld')
    bins = ((5, 10), (50, 60))
    assert rows.keys() == {
        (scans, method, *bin_)
        for scans in ('raw', 'compact')
        for method in methods
        for bin_ in bins
    }
    for scans in ('raw', 'compact'):
        assert rows[scans, methods[0], 5, 10]['strict'] == 1  # 7 m apart
    raw, sent = (rows[scans, methods[1], 5, 10]['rte_median'] for scans in ('raw', 'compact'))
    assert raw != sent  # the scans did go through the coder
    before = {path: path.read_text() for path in (tmp_path / 'runs').rglob('*.jsonl')}
    assert len(before) == 2
    again = measure('--worlds 0 --scans 1 --per-bin 1')
    assert again['recall'] == found['recall']
    assert {path: path.read_text() for path in before} == before


def test_pairs_farther_than_the_papers_leave_the_nearer_as_they_are(drive):
    farther = draw_pairs(drive, per_bin=3, bins=(*BINS, (50, 60)))
    assert farther[:-3] == draw_pairs(drive, per_bin=3)
    assert all(50 <= pair.distance < 60 for pair in farther[-3:])
