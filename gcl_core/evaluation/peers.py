"""Other methods behind the same interface, for the same pairs in the same run."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from gcl_core.types import Features, PointCloud

FPFH_VOXEL = 0.3  # metres, as the paper's features


def _fpfh(cloud: PointCloud) -> tuple[Any, Any]:
    """Open3D's cloud of key points with normals, and their FPFH."""
    import open3d as o3d

    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.astype(float)))
    points = points.voxel_down_sample(FPFH_VOXEL)
    points.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2 * FPFH_VOXEL, 30))
    search = o3d.geometry.KDTreeSearchParamHybrid(5 * FPFH_VOXEL, 100)
    return points, o3d.pipelines.registration.compute_fpfh_feature(points, search)


def fpfh_features(cloud: PointCloud) -> Features:
    """Describe a scan by FPFH at Open3D's usual radii, brought to unit length."""
    points, fpfh = _fpfh(cloud)
    descriptors = torch.from_numpy(np.array(fpfh.data.T, dtype=np.float32))
    return Features(
        torch.from_numpy(np.array(points.points, dtype=np.float32)),
        torch.nn.functional.normalize(descriptors, dim=1),
    )


def fpfh_ransac(source: PointCloud, target: PointCloud) -> Float[np.ndarray, '4 4'] | None:
    """Open3D's FPFH and feature-matching RANSAC, with Open3D's usual radii and mutual matches.

    Normals within 2 voxels, features within 5, 1.5 voxels of inlier distance, edge ratio 0.9,
    at most 4,000,000 samples at confidence 0.999; then ICP point to plane.
    """
    import open3d as o3d

    registration = o3d.pipelines.registration
    (source_points, source_fpfh), (target_points, target_fpfh) = _fpfh(source), _fpfh(target)
    o3d.utility.random.seed(0)
    reach = 1.5 * FPFH_VOXEL
    coarse = registration.registration_ransac_based_on_feature_matching(
        source_points,
        target_points,
        source_fpfh,
        target_fpfh,
        mutual_filter=True,
        max_correspondence_distance=reach,
        estimation_method=registration.TransformationEstimationPointToPoint(False),
        ransac_n=3,
        checkers=[
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(reach),
        ],
        criteria=registration.RANSACConvergenceCriteria(4_000_000, 0.999),
    )
    fine = registration.registration_icp(
        source_points,
        target_points,
        2 * FPFH_VOXEL,
        coarse.transformation,
        registration.TransformationEstimationPointToPlane(),
    )
    return np.asarray(fine.transformation)
