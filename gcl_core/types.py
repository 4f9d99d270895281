"""What one stage hands to the next.

Axis glossary, used in every shape of this project:
    n, m    points or voxels (source, target)     c   feature channels
    k       neighbours or kernel offsets          d   descriptor length
    g       positive groups                       h   hypotheses
Points are in metres in the frame of the sensor that saw them unless a name says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64

from gcl_core import se3
from gcl_core.errors import GclError

MOST_COLUMNS = 32  # of a cloud as an array: beyond, each column is a point


@dataclass(frozen=True)
class PointCloud:
    """One LiDAR scan.

    Attributes:
        points: finite x, y, z in metres, sensor frame (x forward, y left, z up).
        name: of its file, for messages; empty where it has none.
    """

    points: Float32[np.ndarray, 'n 3']
    name: str = ''

    def __len__(self) -> int:
        return len(self.points)

    def moved(self, T: Float[np.ndarray, '4 4']) -> PointCloud:
        """The scan in another frame, `T_other_own`."""
        return PointCloud(se3.transform(T, self.points), self.name)

    @staticmethod
    def from_array(array: np.ndarray, name: str = 'cloud') -> PointCloud:
        """Take x, y, z from the first three columns and drop points that are not finite.

        Raises:
            GclError: the array has no three columns, or a column for each point, or no finite
                point.
        """
        if array.ndim != 2 or array.shape[1] < 3 or array.shape[1] > MOST_COLUMNS:
            turned = array.ndim == 2 and 3 <= array.shape[0] <= MOST_COLUMNS
            remedy = '; its columns look like points: give array.T' if turned else ''
            raise GclError(
                f'{name}: expected an (n, 3) array of points, got shape {array.shape}{remedy}'
            )
        with np.errstate(over='ignore'):  # beyond float32 is not finite
            points = np.ascontiguousarray(array[:, :3], dtype=np.float32)
        finite = np.isfinite(points).all(axis=1)
        if not finite.any():
            raise GclError(f'{name}: none of its {len(points)} points is finite; check the sensor')
        return PointCloud(points if finite.all() else points[finite], name)

    @staticmethod
    def check(cloud: object, name: str = 'cloud') -> None:
        """Refuse what is no cloud.

        Raises:
            GclError: says how to make one.
        """
        points = getattr(cloud, 'points', None) if isinstance(cloud, PointCloud) else cloud
        shape = getattr(points, 'shape', ())
        plain = isinstance(points, np.ndarray) and points.ndim == 2 and points.shape[1] == 3
        if not (isinstance(cloud, PointCloud) and plain):
            held = (
                f'{type(points).__name__} of shape {tuple(shape)}'
                if shape
                else type(points).__name__
            )
            raise GclError(
                f'{name}: expected a PointCloud, got {held}; make one of an (n, 3) array of '
                'metres by PointCloud.from_array(points)'
            )


@dataclass(frozen=True)
class SparseTensor:
    """Occupied voxels of one or more scans.

    Attributes:
        keys: sorted voxel keys, scan index in the top bits (see `gcl_core.ops.voxelize`).
        points: barycentre of each voxel's points, metres, sensor frame.
        features: input features of each voxel.
        splits: voxel i belongs to scan b when `splits[b] <= i < splits[b + 1]`.
    """

    keys: Int64[torch.Tensor, ' n']
    points: Float[torch.Tensor, 'n 3']
    features: Float[torch.Tensor, 'n c']
    splits: tuple[int, ...]

    def to(self, device: torch.device) -> SparseTensor:
        """Copy to a device, or return itself if it is there."""
        if self.keys.device == device:
            return self
        return SparseTensor(
            keys=self.keys.to(device),
            points=self.points.to(device),
            features=self.features.to(device),
            splits=self.splits,
        )


@dataclass(frozen=True)
class Features:
    """What a scan looks like to others: key points with descriptors. Computed once per scan.

    Attributes:
        points: metres, sensor frame.
        descriptors: unit length.
    """

    points: Float[torch.Tensor, 'n 3']
    descriptors: Float[torch.Tensor, 'n d']

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True)
class Heading:
    """A scan as a network describes it when it is turned about the vertical.

    Attributes:
        yaw: by which it is turned, radians.
        features: descriptors of the turned scan; key points in the frame of the unturned one.
    """

    yaw: float
    features: Features


@dataclass(frozen=True)
class Correspondences:
    """Matched key points, row by row.

    Attributes:
        source: metres, source frame.
        target: metres, target frame.
        weight: similarity of the two descriptors (cosine), in [-1, 1].
    """

    source: Float[torch.Tensor, 'n 3']
    target: Float[torch.Tensor, 'n 3']
    weight: Float[torch.Tensor, ' n']

    def __len__(self) -> int:
        return len(self.source)


@dataclass(frozen=True)
class PositiveGroups:
    """Observations of the same spots from several scans, in CSR form.

    Group j holds the members `member[offsets[j]:offsets[j + 1]]`; its first member is the
    centre scan's own. A pair is a group of two.

    Attributes:
        offsets: start of each group, and the end of the last.
        member: row of the stacked features of all scans.
        sensor_range: distance from each member to the sensor that saw it, metres.
        finest: position in `member` of each group's finest one (see `gcl_core.data.groups`).
        anchor: where each spot is, metres, centre scan's frame.
    """

    offsets: Int64[torch.Tensor, ' g+1']
    member: Int64[torch.Tensor, ' n']
    sensor_range: Float[torch.Tensor, ' n']
    finest: Int64[torch.Tensor, ' g']
    anchor: Float[torch.Tensor, 'g 3']

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def sizes(self) -> Int64[torch.Tensor, ' g']:
        """Number of members of each group."""
        return self.offsets[1:] - self.offsets[:-1]

    @property
    def group(self) -> Int64[torch.Tensor, ' n']:
        """Group index of each member."""
        rows = torch.arange(len(self), device=self.offsets.device)
        return torch.repeat_interleave(rows, self.sizes)

    def to(self, device: torch.device) -> PositiveGroups:
        """Copy to a device, or return itself if it is there."""
        if self.offsets.device == device:
            return self
        return PositiveGroups(**{f.name: getattr(self, f.name).to(device) for f in fields(self)})


@dataclass(frozen=True)
class Registration:
    """The outcome for one pair of scans.

    Attributes:
        T_target_source: maps source points into the target frame: the best hypothesis, accepted
            or not; None when there is none.
        inliers: correspondences that agree with the transform.
        correspondences: correspondences that were offered.
        reason: why it is not accepted; empty if it is.
        ms: time of each stage in milliseconds, `total` among them.
        accepted: whether the transform is to be used.
        probability: that it is right within 0.6 m and 1.5 degrees, as calibrated.
        covariance: of x, y, z, rot_x, rot_y, rot_z (metres and radians, ROS's order) about the
            target's axes, if it is right; None without a transform or where refinement failed.
        calibrated: whether the calibration was made with these weights and settings. If not, the
            probability is that of others and may be far off.
        headings: of the source that were searched.
    """

    T_target_source: Float[np.ndarray, '4 4'] | None
    inliers: int
    correspondences: int
    reason: str = ''
    ms: dict[str, float] = field(default_factory=dict)
    accepted: bool = False
    probability: float = 0.0
    covariance: Float[np.ndarray, '6 6'] | None = None
    calibrated: bool = True
    headings: int = 0
