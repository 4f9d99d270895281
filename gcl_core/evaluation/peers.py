"""Other methods behind the same interface, for the same pairs in the same run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation.predict import Method
from gcl_core.types import Features, PointCloud

FPFH_VOXEL = 0.3  # metres, as the paper's features
REACH = 1.5 * FPFH_VOXEL  # metres between corresponding points, Open3D's usual ratio


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
    from open3d.pipelines import registration

    return _coarse_to_fine(
        source,
        target,
        registration.registration_ransac_based_on_feature_matching,
        mutual_filter=True,
        max_correspondence_distance=REACH,
        estimation_method=registration.TransformationEstimationPointToPoint(False),
        ransac_n=3,
        checkers=[
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(REACH),
        ],
        criteria=registration.RANSACConvergenceCriteria(4_000_000, 0.999),
    )


def fpfh_fgr(source: PointCloud, target: PointCloud) -> Float[np.ndarray, '4 4'] | None:
    """Open3D's FPFH and fast global registration (Zhou et al., 2016), then ICP point to plane.

    Open3D's defaults, but for the distance of corresponding points, 1.5 voxels.
    """
    from open3d.pipelines import registration

    return _coarse_to_fine(
        source,
        target,
        registration.registration_fgr_based_on_feature_matching,
        option=registration.FastGlobalRegistrationOption(maximum_correspondence_distance=REACH),
    )


def _coarse_to_fine(
    source: PointCloud, target: PointCloud, estimate: Callable[..., Any], **settings: Any
) -> Float[np.ndarray, '4 4']:
    """Register by FPFH, then by ICP point to plane within 2 voxels."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    (source_points, source_fpfh), (target_points, target_fpfh) = _fpfh(source), _fpfh(target)
    o3d.utility.random.seed(0)
    coarse = estimate(source_points, target_points, source_fpfh, target_fpfh, **settings)
    plane = registration.TransformationEstimationPointToPlane()
    fine = registration.registration_icp(
        source_points, target_points, 2 * FPFH_VOXEL, coarse.transformation, plane
    )
    return np.asarray(fine.transformation)


def _kiss_matcher() -> Method:
    """KISS-Matcher (Lim et al., 2025) on whole clouds, its defaults at 0.3 m voxels, then GICP.

    Raises:
        GclError: the package is not installed.
    """
    try:
        import kiss_matcher as kiss
    except ImportError:
        raise GclError(
            'peer kiss_matcher needs its package: pip install kiss-matcher, or leave it out'
        ) from None

    def register(source: PointCloud, target: PointCloud) -> Float[np.ndarray, '4 4'] | None:
        matcher = kiss.KISSMatcher(kiss.KISSMatcherConfig(voxel_size=FPFH_VOXEL))
        columns = [list(cloud.points[:, :, None]) for cloud in (source, target)]
        solution = matcher.estimate(*columns)
        T = se3.from_rotation_translation(
            np.asarray(solution.rotation), np.asarray(solution.translation)
        )
        return _gicp(source, target, T, 2 * FPFH_VOXEL) if solution.valid else None

    return register


def gicp(source: PointCloud, target: PointCloud) -> Float[np.ndarray, '4 4'] | None:
    """GICP from the identity (small_gicp) at 0.3 m, with up to 2 m between corresponding points.

    What a method makes of a pair that nothing has brought near before.
    """
    return _gicp(source, target, np.eye(4), 2.0)


def _gicp(
    source: PointCloud, target: PointCloud, start: Float[np.ndarray, '4 4'], reach: float
) -> Float[np.ndarray, '4 4'] | None:
    import small_gicp

    result = small_gicp.align(
        target.points.astype(np.float64),
        source.points.astype(np.float64),
        init_T_target_source=start,
        registration_type='GICP',
        downsampling_resolution=FPFH_VOXEL,
        max_correspondence_distance=reach,
        num_threads=1,  # more differ in the last bits from run to run
    )
    T = np.asarray(result.T_target_source)
    return T if np.isfinite(T).all() else None


# Called when a method is first needed, so that a missing package is told before the first pair.
PEERS: dict[str, Callable[[], Method]] = {
    'fpfh': lambda: fpfh_ransac,
    'fpfh_fgr': lambda: fpfh_fgr,
    'kiss_matcher': _kiss_matcher,
    'gicp': lambda: gicp,
}
