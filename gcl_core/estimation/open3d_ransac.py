"""Open3D's RANSAC with the paper's settings, for comparison."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.support import Support
from gcl_core.types import Correspondences


@dataclass(frozen=True)
class Open3dRansacConfig:
    """The paper's settings; its matches are one-way, of 5,000 random key points.

    Attributes:
        threshold: residual of an inlier, metres.
        points: of a minimal set.
        edge_ratio: edges of a minimal set agree in length to this ratio.
        samples: most minimal sets drawn.
        confidence: for stopping early; the paper's 10,000 is clamped to 1, which never stops.
        seed: of the draws.
    """

    threshold: float = 0.3
    points: int = 4
    edge_ratio: float = 0.9
    samples: int = 4_000_000
    confidence: float = 1.0
    seed: int = 0


def open3d_ransac(
    correspondences: Correspondences, config: Open3dRansacConfig, *, max_yaw: float = math.pi
) -> list[Hypothesis]:
    """Search the transform with most inliers; one hypothesis or none.

    Repeatable on one thread only: Open3D's threads share one random stream.
    """
    import open3d as o3d

    registration = o3d.pipelines.registration
    if len(correspondences) < config.points:
        return []
    clouds = [
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(side.double().numpy()))
        for side in (correspondences.source, correspondences.target)
    ]
    pairs = np.repeat(np.arange(len(correspondences), dtype=np.int32)[:, None], 2, 1)
    o3d.utility.random.seed(config.seed)
    result = registration.registration_ransac_based_on_correspondence(
        *clouds,
        o3d.utility.Vector2iVector(pairs),
        config.threshold,
        registration.TransformationEstimationPointToPoint(False),
        config.points,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(config.edge_ratio),
            registration.CorrespondenceCheckerBasedOnDistance(config.threshold),
        ],
        registration.RANSACConvergenceCriteria(config.samples, config.confidence),
    )
    if len(result.correspondence_set) < config.points:
        return []
    T = torch.from_numpy(np.array(result.transformation))
    if abs(math.atan2(T[1, 0], T[0, 0])) > max_yaw:
        return []
    return Support(correspondences, config.threshold).polish(T[None], steps=0)
