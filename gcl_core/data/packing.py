"""Scans to files a hundredth of their size: one, or all of a drive with its poses."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from gcl_core.compact.scan import CompactConfig, read_header
from gcl_core.data.clouds import CloudReader, write_cloud
from gcl_core.data.folder import FolderSequence
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.poses import write_poses
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.files import whole_folder
from gcl_core.progress import progress

SUFFIX = '.gcl'


@dataclass(frozen=True)
class Packed:
    """What became of some scans.

    Attributes:
        scans: how many.
        before: bytes of their files.
        after: bytes now.
        voxels: of all of them.
        poses: whether their poses are beside them.
    """

    scans: int
    before: int
    after: int
    voxels: int
    poses: bool = False


def pack_scan(scan: Path, out: Path, config: CompactConfig, clouds: CloudReader) -> Packed:
    """Pack the file of one scan.

    Args:
        scan: its file.
        out: to write, `.gcl`.
        config: how much is kept.
        clouds: reads it.

    Raises:
        GclError: the scan cannot be read, nothing of it is kept, or `out` cannot be written.
    """
    check_suffix(out)
    cloud = clouds(scan)
    write_cloud(out, cloud, config)
    return Packed(1, scan.stat().st_size, out.stat().st_size, _voxels(out))


def pack_drive(drive: Sequence, out: Path, config: CompactConfig) -> Packed:
    """Pack every scan of a drive into a folder, as `FolderSequence` reads it.

    Scans keep their names; `poses.txt` gets the LiDAR's own poses, and a `times.txt` is copied.

    Args:
        drive: a folder of clouds, or a KITTI sequence.
        out: folder to write.
        config: how much is kept.

    Raises:
        GclError: the drive is none of these, a scan cannot be read, nothing of it is kept, or
            `out` is there already or cannot be written.
    """
    files = drive_files(drive)
    posed = not isinstance(drive, FolderSequence) or drive.posed
    after = voxels = 0
    with whole_folder(out) as part:
        part.mkdir()
        for index, file in enumerate(progress(files, unit='scan')):
            packed = part / f'{file.stem}{SUFFIX}'
            write_cloud(packed, drive.scan(index), config)
            after, voxels = after + packed.stat().st_size, voxels + _voxels(packed)
        if posed:
            poses = [drive.T_world_lidar(i) for i in range(len(drive))]
            write_poses(part / 'poses.txt', poses)
        _copy_times(files[0], part)
    before = sum(file.stat().st_size for file in files)
    return Packed(len(files), before, after, voxels, posed)


def drive_files(drive: Sequence) -> list[Path]:
    """Files of the scans of a drive, in their order.

    Raises:
        GclError: it does not keep each in a file, or two of them differ in their suffix alone.
    """
    if not isinstance(drive, FolderSequence | KittiSequence) or not drive.files:
        raise GclError(
            f'{drive.name} is neither a folder of clouds nor a KITTI sequence with its scans, '
            'which are packed here; of a bag, `gcl bag pack BAG OUT` does it'
        )
    if len({file.stem for file in drive.files}) < len(drive.files):
        raise GclError(
            f'{drive.name}: two scans have the same name but for the suffix; rename one'
        )
    return drive.files


def check_suffix(out: Path) -> None:
    """See that a packed scan is called so.

    Raises:
        GclError: it is not.
    """
    if out.suffix.lower() != SUFFIX:
        raise GclError(f'{out}: a packed scan ends in {SUFFIX}; call it {out.stem}{SUFFIX}')


def _voxels(packed: Path) -> int:
    return read_header(packed.read_bytes(), str(packed)).count


def _copy_times(first: Path, out: Path) -> None:
    """Copy the times of the scans, which are beside them or, as in KITTI, one folder up."""
    places: Iterable[Path] = (first.with_name('times.txt'), first.parent.with_name('times.txt'))
    for times in places:
        if times.is_file():
            shutil.copyfile(times, out / 'times.txt')
            return
