"""Simulated pairs to calibrate on: easy ones, hard ones, and places that are not the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.evaluation.repeated import RepeatedSequence
from gcl_core.evaluation.trials import Trial, blurred, run_trial
from gcl_core.registrar import Registrar, View
from gcl_core.types import PointCloud

MAX_BLUR = 0.4  # noise on descriptors: few inliers, as on real scans beyond 30 m
MAX_SKEW = 0.5  # metres that a sweep is drawn out by uncompensated motion
MAX_JITTER = 0.04  # metres
TILT = np.deg2rad(1.0)  # roll and pitch of a vehicle, standard deviation
REPEATED_EVERY = 4  # every fourth world repeats one house


@dataclass(frozen=True)
class Seen:
    """A scan of a world, and its pose there."""

    view: View
    T_world_lidar: Float[np.ndarray, '4 4']


def roughened(cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
    """Half of the scans: motion within the sweep, noise, and half of the returns lost."""
    points = cloud.points
    if rng.random() < 0.5:
        return cloud
    if rng.random() < 0.3:
        points = points[rng.random(len(points)) < 0.5]
    turn = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi)
    skew = rng.uniform(-MAX_SKEW, MAX_SKEW) * np.array([1.0, 0.0, 0.0])
    noise = rng.normal(size=points.shape) * rng.uniform(0, MAX_JITTER)
    return PointCloud((points + turn[:, None] * skew + noise).astype(np.float32))


def see(
    registrar: Registrar, drive: Sequence, index: int, turns: int, rng: np.random.Generator
) -> Seen:
    """Take a scan of a drive, its vehicle turned and tilted at random."""
    turn = se3.from_xyz_rpy(
        roll=rng.normal() * TILT, pitch=rng.normal() * TILT, yaw=rng.uniform(-np.pi, np.pi)
    )
    cloud = roughened(drive.scan(index), rng)
    moved = PointCloud(se3.transform(turn, cloud.points))
    T_world_lidar = drive.T_world_lidar(index) @ se3.inverse(turn)
    return Seen(registrar.view(moved, turns=turns), T_world_lidar)


def street(
    registrar: Registrar, seed: int, rng: np.random.Generator
) -> tuple[list[Seen], list[Seen], str]:
    """Two targets near the middle of a world; sources 5 to 55 m away, and one out of sight."""
    if seed % REPEATED_EVERY == 0:
        drive = RepeatedSequence(seed)
        half = len(drive) // 2
        chosen = half // 2 + rng.integers(-8, 8, 2)
        offsets = rng.uniform(5, 55, 3) * rng.choice([-1, 1], 3)
        where = np.concatenate([half // 2 + offsets, [half + rng.integers(10, half - 10)]])
        drives, indices = [drive] * 4, np.clip(where, 0, 2 * half - 1).astype(int).tolist()
        targets = [see(registrar, drive, int(i), 1, rng) for i in chosen]
        kind = 'repeated'
    else:
        both = [SimulatedSequence(seed, oncoming=oncoming) for oncoming in (False, True)]
        middle = len(both[0]) // 2
        targets = [see(registrar, d, int(middle + rng.integers(-8, 8)), 1, rng) for d in both]
        offsets = rng.uniform(5, 55, 3) * rng.choice([-1, 1], 3)
        drives = [both[int(rng.integers(2))] for _ in range(4)]
        indices = [*(middle + offsets).astype(int).tolist(), int(rng.choice([2, 2 * middle - 2]))]
        kind = 'street'
    turns = registrar.config.turns
    sources = [see(registrar, d, i, turns, rng) for d, i in zip(drives, indices)]
    return targets, sources, kind


def encounters(registrar: Registrar, seed: int, others: list[Seen]) -> Iterator[Trial]:
    """Trials of one world, and of its sources against targets of others.

    Args:
        registrar: as it is to be calibrated.
        seed: of the world; training must not have seen it.
        others: targets of other worlds; this world's targets are added.
    """
    rng = np.random.default_rng([seed, 11])
    generator = torch.Generator().manual_seed(seed)
    targets, sources, kind = street(registrar, seed, rng)
    strangers = [others[i] for i in rng.permutation(len(others))[:2]]
    for source in sources:
        for number, target in enumerate([*targets, *strangers]):
            stranger = number >= len(targets)
            T_true = se3.inverse(target.T_world_lidar) @ source.T_world_lidar
            sigma = float(rng.uniform(0, MAX_BLUR))
            trial = run_trial(
                registrar,
                source=blurred(source.view, sigma, generator),
                target=target.view,
                T_true=None if stranger else T_true,
                kind='unrelated' if stranger else kind,
            )
            if trial is not None:
                yield trial
    others.extend(targets)
