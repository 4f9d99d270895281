"""The matches that agree with a transform, for pictures."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.matching.match import MatchConfig, match
from gcl_core.types import Correspondences
from gcl_core.view import View

REACH = 1.0  # metres between a match's two points after the transform


def agreeing(
    T_target_source: Float[np.ndarray, '4 4'], *, source: View, target: View, config: MatchConfig
) -> Correspondences:
    """Match anew at the heading nearest to the transform's; keep what lies within `REACH`.

    Both ends are in their scan's own frame, metres.
    """
    turns = [turn.numpy() @ source.T_view_lidar for turn in source.turns]
    T_view_source = target.T_view_lidar @ T_target_source
    at = int(np.argmin([abs(se3.yaw(T_view_source @ se3.inverse(turn))) for turn in turns]))
    matches = match(source=source.headings[at], target=target.headings[0], config=config)
    own = se3.transform(se3.inverse(turns[at]), matches.source.double().numpy())
    other = se3.transform(se3.inverse(target.T_view_lidar), matches.target.double().numpy())
    gap = np.linalg.norm(se3.transform(T_target_source, own) - other, axis=1)
    close = torch.from_numpy(gap < REACH)
    ends = [torch.from_numpy(points)[close] for points in (own, other)]
    return Correspondences(ends[0], ends[1], matches.weight[close])
