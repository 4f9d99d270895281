"""Simulated pairs to calibrate on: easy ones, hard ones, and places that are not the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.evaluation.barren import BarrenSequence
from gcl_core.evaluation.repeated import RepeatedSequence
from gcl_core.evaluation.trials import Trial, blurred, run_trials
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_core.view import View

MAX_BLUR = 0.4  # noise on descriptors: few inliers, as on real scans beyond 30 m
MAX_SKEW = 0.5  # metres that a sweep is drawn out by uncompensated motion
MAX_JITTER = 0.04  # metres
TILT = np.deg2rad(1.0)  # roll and pitch of a vehicle, standard deviation
SENSORS = {'hdl64e': 0.4, 'vlp16': 0.2, 'hdl32e': 0.15, 'os1_128': 0.15, 'pandar128': 0.1}
OTHER_SENSOR = 0.2  # of the worlds: the sources' differs from the targets'
REPEATED_EVERY = 4  # every fourth world repeats one house
TUNNEL_EVERY = 12  # of those, every third is a tunnel
Scans = list[tuple[Sequence, int]]  # drives, and the index of a scan of each


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


def sensors(seed: int) -> tuple[str, str]:
    """Sensors of the targets and of the sources in a world."""
    rng = np.random.default_rng([seed, 12])
    targets, other = rng.choice([*SENSORS], 2, p=[*SENSORS.values()]).tolist()
    return targets, other if rng.random() < OTHER_SENSOR else targets


def tunnel_or_houses(seed: int, sensor: str) -> Sequence:
    """A place that looks alike all along; the second half of its scans is out of sight."""
    if seed % TUNNEL_EVERY == 0:
        return BarrenSequence(seed, 'tunnel', span=260.0, sensor=sensor)
    return RepeatedSequence(seed, sensor=sensor)


def both_ways(seed: int, sensor: str) -> list[Sequence]:
    """Two vehicles of one street, one along it, one against it."""
    return [
        SimulatedSequence(seed, sensor=sensor, route='along'),
        SimulatedSequence(seed, sensor=sensor, route='oncoming'),
    ]


def see(
    registrar: Registrar,
    drive: Sequence,
    index: int,
    rng: np.random.Generator,
    *,
    headings: int = 1,
    yaw: float = 0.0,
    change: Float[np.ndarray, '3 3'] | None = None,
) -> Seen:
    """Take a scan of a drive, its vehicle tilted and turned at random.

    Args:
        registrar: describes it.
        drive: source of the scan.
        index: of the scan.
        rng: of tilt, turn and noise.
        headings: of the vehicle, evenly spaced, one of which is drawn.
        yaw: of the turned vehicle in the world, radians, but for what two scans may differ by.
        change: what a stranger does to the points in the end, such as to mirror them; the pose
            follows if it is a rotation.
    """
    off = np.deg2rad(registrar.model.config.max_yaw_deg) / 2
    ahead = yaw + rng.uniform(-off, off) + 2 * np.pi * rng.integers(headings) / headings
    turn = se3.from_xyz_rpy(
        roll=rng.normal() * TILT,
        pitch=rng.normal() * TILT,
        yaw=se3.yaw(drive.T_world_lidar(index)) - ahead,
    )
    cloud = roughened(drive.scan(index), rng)
    if change is not None:
        turn[:3] = change @ turn[:3]
    moved = PointCloud((cloud.points @ turn[:3, :3].T + turn[:3, 3]).astype(np.float32))
    T_world_lidar = drive.T_world_lidar(index) @ np.linalg.inv(turn)
    return Seen(registrar.view(moved), T_world_lidar)


@dataclass(frozen=True)
class World:
    """Where the scans of a world are taken.

    Attributes:
        kind: of trials within it.
        yaw: of all vehicles, radians, but for what `see` turns them by.
        targets: two near the middle.
        sources: three 5 to 55 m away, and one out of sight.
    """

    kind: str
    yaw: float
    targets: Scans
    sources: Scans


@lru_cache(maxsize=3)
def world(seed: int) -> World:
    """Draw a world, its vehicles and their places; no scan is taken yet."""
    rng = np.random.default_rng([seed, 11])
    yaw = float(rng.uniform(-np.pi, np.pi))
    ours, theirs = sensors(seed)
    offsets = rng.uniform(5, 55, 3) * rng.choice([-1, 1], 3)
    near = rng.integers(-8, 8, 2)
    if seed % REPEATED_EVERY == 0:
        drive = tunnel_or_houses(seed, ours)
        other = drive if theirs == ours else tunnel_or_houses(seed, theirs)
        half = len(drive) // 2
        where = np.concatenate([half // 2 + offsets, [half + rng.integers(10, half - 10)]])
        indices = np.clip(where, 0, 2 * half - 1).astype(int).tolist()
        targets = [(drive, int(half // 2 + i)) for i in near]
        return World('repeated', yaw, targets, [(other, i) for i in indices])
    both = both_ways(seed, ours)
    others = both if theirs == ours else both_ways(seed, theirs)
    middle = len(both[0]) // 2
    away = int(rng.choice([2, 2 * middle - 2]))
    indices = [*(middle + offsets).astype(int).tolist(), away]
    targets = [(drive, int(middle + i)) for drive, i in zip(both, near, strict=True)]
    return World('street', yaw, targets, [(others[int(rng.integers(2))], i) for i in indices])


@lru_cache(maxsize=4)
def targets_of(registrar: Registrar, seed: int) -> list[Seen]:
    """Both targets of a world."""
    rng, own = np.random.default_rng([seed, 13]), world(seed)
    return [see(registrar, drive, i, rng, yaw=own.yaw) for drive, i in own.targets]


def sources_of(registrar: Registrar, seed: int) -> list[Seen]:
    """The four sources of a world, at headings that the registrar searches."""
    rng, own = np.random.default_rng([seed, 14]), world(seed)
    headings = registrar.config.headings
    return [
        see(registrar, drive, i, rng, headings=headings, yaw=own.yaw) for drive, i in own.sources
    ]


def encounters(registrar: Registrar, seed: int) -> Iterator[Trial]:
    """Trials of one world, and of its sources against targets of the two worlds before it.

    Args:
        registrar: as it is to be calibrated.
        seed: of the world; training must not have seen it. All trials follow from it.
    """
    rng = np.random.default_rng([seed, 15])
    generator = torch.Generator().manual_seed(seed)
    targets = targets_of(registrar, seed)
    strangers = [targets_of(registrar, seed - k)[int(rng.integers(2))] for k in (1, 2)]
    for source in sources_of(registrar, seed):
        for number, target in enumerate([*targets, *strangers]):
            stranger = number >= len(targets)
            T_true = se3.inverse(target.T_world_lidar) @ source.T_world_lidar
            sigma = float(rng.uniform(0, MAX_BLUR))
            yield from run_trials(
                registrar,
                source=blurred(source.view, sigma, generator),
                target=target.view,
                T_true=None if stranger else T_true,
                kind='unrelated' if stranger else world(seed).kind,
            )
