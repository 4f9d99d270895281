"""How good the features are, on the sample at hand and on held-out streets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.augment import random_turn
from gcl_core.data.pairs import draw_pairs
from gcl_core.data.sequence import T_target_source
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.estimation.ransac import RansacConfig, ransac
from gcl_core.evaluation.metrics import LOOSE, registered
from gcl_core.matching.match import MatchConfig, match
from gcl_core.models.backbone import Backbone, Prepared
from gcl_core.models.zoo import NetworkConfig, build
from gcl_core.ops.heading import dominant_heading
from gcl_core.types import Features, PointCloud, PositiveGroups

HELD_OUT = range(990_000_000, 990_000_006)  # seeds of streets that no training run reaches
PAIRS_PER_BIN = 1  # of each street
INLIER = 0.6  # metres; a match this far from the truth counts as right


def top1(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    splits: tuple[int, ...],
    queries: int = 256,
) -> float:
    """Share of centre points whose nearest feature in a neighbour scan is of their group.

    The scan is the last that the group has a point in.
    """
    has_far = groups.offsets[1:] - 1  # last member: of the last scan the group has a point in
    rows = torch.linspace(0, len(groups) - 1, min(queries, len(groups))).long()
    source = groups.member[groups.offsets[:-1][rows]]
    target = groups.member[has_far[rows]]
    own = groups.group * splits[-1] + groups.member  # one number for each group and member
    hits = 0
    for scan in range(1, len(splits) - 1):
        inside = (target >= splits[scan]) & (target < splits[scan + 1])
        candidates = features[splits[scan] : splits[scan + 1]]
        nearest = (features[source[inside]] @ candidates.t()).argmax(1) + splits[scan]
        hits += int(torch.isin(rows[inside] * splits[-1] + nearest, own).sum())
    return hits / max(1, len(rows))


@dataclass(frozen=True)
class HeldOutPair:
    """Two scans of a held-out street.

    Attributes:
        source: turned by up to the yaw that the network bears, ready for it.
        target: ready for the network.
        T_target_source: the truth.
        bin: distance between the sensors, metres.
    """

    source: Prepared
    target: Prepared
    T_target_source: Float[np.ndarray, '4 4']
    bin: tuple[int, int]


@lru_cache(maxsize=1)
def held_out_pairs(config: NetworkConfig) -> list[HeldOutPair]:
    """Simulate the held-out streets; the same pairs in every run."""
    network, pairs = build(config), []
    bearable = np.deg2rad(config.max_yaw_deg)
    for seed in HELD_OUT:
        street, rng = SimulatedSequence(seed), np.random.default_rng([seed, 17])
        for pair in draw_pairs(street, per_bin=PAIRS_PER_BIN, seed=seed):
            clouds = street.scan(pair.source), street.scan(pair.target)
            aligned = -dominant_heading(clouds[1].points) if config.align else 0.0
            turns = (
                random_turn(rng, shared_yaw=aligned, yaw_range=bearable, tilt_range=0.0),
                se3.from_xyz_rpy(yaw=aligned),
            )
            T = T_target_source(street, source=pair.source, target=pair.target)
            T = turns[1] @ T @ se3.inverse(turns[0])
            scans = [
                PointCloud(se3.transform(turn, cloud.points))
                for turn, cloud in zip(turns, clouds, strict=True)
            ]
            source, target = (network.prepare(network.voxelize([scan])) for scan in scans)
            pairs.append(HeldOutPair(source, target, T, pair.bin))
    return pairs


def validate(model: Backbone[Any, Any]) -> dict[str, float]:
    """Register the held-out pairs; returns figures by distance bin.

    `inliers` is the share of right ones among mutual matches, `recall` the share of pairs whose
    best hypothesis meets the loose criterion, without refinement.
    """
    model.eval()
    bearable_yaw = 2 * np.deg2rad(model.config.max_yaw_deg)
    device = next(model.parameters()).device
    figures: dict[str, list[float]] = {}
    for pair in held_out_pairs(model.config):
        with torch.inference_mode():
            described = [model(scan.to(device)) for scan in (pair.source, pair.target)]
        source, target = (Features(points.cpu(), f.cpu()) for points, f, _ in described)
        matches = match(source=source, target=target, config=MatchConfig())
        T = torch.from_numpy(pair.T_target_source).float()
        moved = matches.source @ T[:3, :3].t() + T[:3, 3]
        right = (moved - matches.target).norm(dim=1) < INLIER
        found = ransac(matches, RansacConfig(samples=200_000), max_yaw=bearable_yaw)
        best = found[0].T_target_source.numpy() if found else None
        hit = registered(best, pair.T_target_source, LOOSE)
        name = f'{pair.bin[0]}_{pair.bin[1]}'
        figures.setdefault(f'valid/inliers_{name}', []).append(float(right.float().mean()))
        figures.setdefault(f'valid/recall_{name}', []).append(float(hit))
    return {name: float(np.mean(values)) for name, values in figures.items()}
