"""An endless, seeded stream of training samples, cut by background processes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch.utils.data import IterableDataset, get_worker_info

from gcl_core import se3
from gcl_core.data.augment import random_turn, thin_out
from gcl_core.data.formats import open_sequences
from gcl_core.data.group_index import GroupIndex, ScanGroup
from gcl_core.data.groups import REACH
from gcl_core.errors import GclError
from gcl_core.models.backbone import Backbone
from gcl_core.models.zoo import NetworkConfig, build
from gcl_core.ops.heading import dominant_heading
from gcl_core.training.sample import Sample
from gcl_core.training.sample_cache import SampleCache, Voxels, folder_for
from gcl_core.training.simulated import SimulatedGroups, SimulationConfig
from gcl_core.types import PointCloud

MIN_REACH, MAX_REACH = 10.0, 150.0  # metres; a simulated street ends 190 m from its middle


@dataclass(frozen=True)
class SampleConfig:
    """How samples are drawn.

    Attributes:
        data: folder of recorded drives to train on; simulated streets if there is none.
        drives: names of the drives in it, such as KITTI's ['00', '01'].
        simulation: what is simulated.
        phi: neighbour scans of a centre scan (the paper: 6).
        reach: farthest of them, metres (the paper: 60), one from each of phi segments.
        pair_stages: for the pair-wise baseline: distances of the one neighbour, metres; several
            ranges share the run evenly (the paper: 5 to 20, then to 30, 40, 50, 60).
        shared_yaw_deg: half width of the heading that a whole group is turned by. If the network
            has scans aligned, it is any quarter turn instead.
        yaw_deg: half width of each scan's own heading, at the first and at the last step.
        tilt_deg: half width of roll and pitch.
        keep: least share of a neighbour's points that random thinning leaves.
    """

    data: str = ''
    drives: tuple[str, ...] = ()
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    phi: int = 6
    reach: float = REACH
    pair_stages: tuple[tuple[float, float], ...] = ()
    shared_yaw_deg: float = 180.0
    yaw_deg: tuple[float, float] = (20.0, 20.0)
    tilt_deg: float = 1.5
    keep: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.keep <= 1:
            raise GclError(f'samples.keep is {self.keep}; choose from ]0, 1]')
        if not MIN_REACH <= self.reach <= MAX_REACH:
            raise GclError(
                f'samples.reach is {self.reach:g} m; choose {MIN_REACH:g} to {MAX_REACH:g}'
            )
        if any(low >= high for low, high in self.pair_stages):
            raise GclError(f'samples.pair_stages is {self.pair_stages}; low comes before high')

    def distances(self, progress: float) -> tuple[float, float] | None:
        """Distances of the pair-wise baseline at this fraction of the run; None for groups."""
        if not self.pair_stages:
            return None
        stage = int(progress * len(self.pair_stages))
        return self.pair_stages[min(stage, len(self.pair_stages) - 1)]


class Groups(Protocol):
    """A source of scans that are trained together."""

    def group(
        self, number: int, *, seed: int, distances: tuple[float, float] | None = None
    ) -> ScanGroup:
        """Draw group `number`: the centre and its neighbours, or one neighbour that far away."""


@lru_cache(maxsize=1)
def source_of(config: SampleConfig) -> Groups:
    """Open what the recipe trains on."""
    if not config.data:
        return SimulatedGroups(config.simulation, config.phi, config.reach)
    drives = open_sequences(Path(config.data), config.drives or None)
    return GroupIndex(list(drives.values()), phi=config.phi, reach=config.reach)


def augment(
    group: ScanGroup,
    config: SampleConfig,
    progress: float,
    rng: np.random.Generator,
    *,
    align: bool = False,
) -> tuple[list[PointCloud], Float[np.ndarray, 's 4 4']]:
    """Turn and thin the scans; returns them with their poses in the centre's own frame."""
    yaw_range = np.deg2rad(np.interp(progress, [0, 1], config.yaw_deg))
    shared = (
        rng.integers(4) * np.pi / 2 - dominant_heading(group.clouds[0].points)
        if align
        else rng.uniform(-1, 1) * np.deg2rad(config.shared_yaw_deg)
    )
    clouds, poses = [], []
    for place, (cloud, T_centre_scan) in enumerate(
        zip(group.clouds, group.T_centre_scan, strict=True)
    ):
        if place > 0 and config.keep < 1:
            cloud = thin_out(cloud, rng.uniform(config.keep, 1), rng)
        # What drives the other way faces the other way: headings are taken from the centre's.
        facing = se3.yaw(T_centre_scan)
        turn = random_turn(
            rng,
            shared_yaw=shared + facing,
            yaw_range=yaw_range,
            tilt_range=np.deg2rad(config.tilt_deg),
        )
        clouds.append(PointCloud(se3.transform(turn, cloud.points)))
        poses.append(T_centre_scan @ se3.inverse(turn))
    return clouds, np.stack(poses)


class SampleStream(IterableDataset[Sample[Any]]):
    """Sample number `i` depends on the recipe, the seed and `i` alone: a run can be resumed.

    Args:
        config: how samples are drawn.
        network: whose input they become.
        seed: of everything.
        numbers: of the samples to yield, in order.
        last: number of samples of the whole run.
        cache: folder to keep samples in, and its largest size in GB; None cuts each anew.
    """

    def __init__(
        self,
        config: SampleConfig,
        network: NetworkConfig,
        seed: int,
        numbers: range,
        last: int,
        *,
        cache: tuple[Path, float] | None = None,
    ) -> None:
        self._config, self._network = config, network
        self._seed, self._numbers, self._last = seed, numbers, last
        if cache:
            folder = folder_for(cache[0], config, network, seed, last)
            self._cache: SampleCache | None = SampleCache(folder, cache[1])
        else:
            self._cache = None

    def __iter__(self) -> Iterator[Sample[Any]]:
        network = build(self._network)
        worker = get_worker_info()
        own = self._numbers[worker.id :: worker.num_workers] if worker else self._numbers
        for number in own:
            if self._cache:
                sample = self._cache.get(number, lambda n: self.sample(n, network))
            else:
                sample = self.sample(number, network)
            yield Sample(network.prepare(sample.inputs), sample.T_centre_scan)

    def sample(self, number: int, network: Backbone[Any, Any]) -> Voxels:
        """Cut sample `number`."""
        progress = number / max(self._last, 1)
        group = source_of(self._config).group(
            number, seed=self._seed, distances=self._config.distances(progress)
        )
        rng = np.random.default_rng([self._seed, number, 7])
        clouds, poses = augment(group, self._config, progress, rng, align=self._network.align)
        return Sample(network.voxelize(clouds), poses)


def leave_cores_to_the_network(worker: int) -> None:
    """Start a worker with one thread."""
    torch.set_num_threads(1)
