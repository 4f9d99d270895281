"""The matches that agree with a transform, for pictures."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.estimation.evidence import nearest_heading
from gcl_core.matching.match import match
from gcl_core.registrar import Registrar
from gcl_core.types import Correspondences
from gcl_core.view import View

REACH = 1.0  # metres between a match's two points after the transform


def agreeing(
    registrar: Registrar,
    T_target_source: Float[np.ndarray, '4 4'],
    *,
    source: View,
    target: View,
) -> Correspondences:
    """Match again at the transform's heading; keep what lies within `REACH`.

    Both ends are in their scan's own frame, metres.
    """
    T = target.T_view_lidar @ T_target_source @ se3.inverse(source.T_view_lidar)
    yaw = se3.yaw(T)
    heading = source.headings[int(nearest_heading(torch.from_numpy(T)[None], source.headings))]
    if abs(np.angle(np.exp(1j * (yaw - heading.yaw)))) > registrar.max_yaw:
        heading = registrar.model.describe_headings(source.cloud, yaw)[0]
    matches = match(source=heading.features, target=target.features, config=registrar.config.match)
    own = se3.transform(se3.inverse(source.T_view_lidar), matches.source.double().numpy())
    other = se3.transform(se3.inverse(target.T_view_lidar), matches.target.double().numpy())
    gap = np.linalg.norm(se3.transform(T_target_source, own) - other, axis=1)
    close = torch.from_numpy(gap < REACH)
    ends = [torch.from_numpy(points)[close] for points in (own, other)]
    return Correspondences(ends[0], ends[1], matches.weight[close])
