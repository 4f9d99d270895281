"""Other methods behind the same interface, for the same pairs in the same run."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core.types import PointCloud

FPFH_VOXEL = 0.3  # metres, as the paper's features


def fpfh_ransac(source: PointCloud, target: PointCloud) -> Float[np.ndarray, '4 4'] | None:
    """Open3D's FPFH and feature-matching RANSAC, with Open3D's usual radii and mutual matches.

    Normals within 2 voxels, features within 5, 1.5 voxels of inlier distance, edge ratio 0.9,
    at most 4,000,000 samples at confidence 0.999; then ICP point to plane.
    """
    import open3d as o3d

    registration = o3d.pipelines.registration
    clouds, features = [], []
    for cloud in (source, target):
        points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.astype(float)))
        points = points.voxel_down_sample(FPFH_VOXEL)
        points.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2 * FPFH_VOXEL, 30))
        search = o3d.geometry.KDTreeSearchParamHybrid(5 * FPFH_VOXEL, 100)
        features.append(registration.compute_fpfh_feature(points, search))
        clouds.append(points)
    o3d.utility.random.seed(0)
    reach = 1.5 * FPFH_VOXEL
    coarse = registration.registration_ransac_based_on_feature_matching(
        clouds[0],
        clouds[1],
        features[0],
        features[1],
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
        clouds[0],
        clouds[1],
        2 * FPFH_VOXEL,
        coarse.transformation,
        registration.TransformationEstimationPointToPlane(),
    )
    return np.asarray(fine.transformation)
