"""An endless, seeded stream of training samples, cut by one background process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from torch.utils.data import IterableDataset

from gcl_core import se3
from gcl_core.data.augment import random_turn
from gcl_core.data.groups import draw_neighbors
from gcl_core.data.sequence import positions
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.models.resunet import ResUNet, ResUNetConfig
from gcl_core.types import PointCloud, SparseTensor

CENTRE_SPAN = (
    30  # scans, a metre apart, around the middle of a street where centre scans are taken
)


@dataclass(frozen=True)
class SampleConfig:
    """How samples are drawn.

    Attributes:
        phi: neighbour scans of a centre scan (the paper: 6).
        samples_per_world: samples taken from one simulated street before a new one is built.
        shared_yaw_deg: half width of the heading that a whole group is turned by.
        yaw_deg: half width of each scan's own heading, at the first and at the last step.
        tilt_deg: half width of roll and pitch.
        sensor: simulated sensor.
    """

    phi: int = 6
    samples_per_world: int = 2
    shared_yaw_deg: float = 180.0
    yaw_deg: tuple[float, float] = (20.0, 20.0)
    tilt_deg: float = 1.5
    sensor: str = 'hdl64e'


@dataclass(frozen=True)
class Sample:
    """A centre scan (first) and its neighbours, ready for the network.

    Attributes:
        voxels: of all scans, each turned by its augmentation.
        T_centre_scan: from each turned scan's frame to the centre's own, (scans, 4, 4).
    """

    voxels: SparseTensor
    T_centre_scan: np.ndarray


@lru_cache(maxsize=1)
def _world(seed: int, sensor: str) -> SimulatedSequence:
    return SimulatedSequence(seed, sensor=sensor)


class SampleStream(IterableDataset[Sample]):
    """Sample number `i` depends on the seed and `i` alone, so that a run can be resumed."""

    def __init__(
        self, config: SampleConfig, network: ResUNetConfig, seed: int, first: int, last: int
    ) -> None:
        self._config, self._network = config, network
        self._seed, self._first, self._last = seed, first, last

    def __iter__(self) -> Iterator[Sample]:
        voxelizer = ResUNet(self._network)
        for number in range(self._first, self._last):
            yield self.sample(number, voxelizer)

    def sample(self, number: int, voxelizer: ResUNet) -> Sample:
        """Cut sample `number`."""
        config = self._config
        world = _world(self._seed * 1_000_000 + number // config.samples_per_world, config.sensor)
        rng = np.random.default_rng([self._seed, number, 7])
        along = positions(world)
        middle = len(world) // 2
        centre = int(rng.integers(middle - CENTRE_SPAN, middle + CENTRE_SPAN))
        scans = [centre, *draw_neighbors(along, centre, config.phi, rng)]

        progress = number / max(self._last, 1)
        yaw_range = np.deg2rad(np.interp(progress, [0, 1], config.yaw_deg))
        shared = rng.uniform(-1, 1) * np.deg2rad(config.shared_yaw_deg)
        T_lidar_world = se3.inverse(world.T_world_lidar(centre))
        clouds, poses = [], []
        for index in scans:
            turn = random_turn(
                rng, shared_yaw=shared, yaw_range=yaw_range, tilt_range=np.deg2rad(config.tilt_deg)
            )
            clouds.append(PointCloud(se3.transform(turn, world.scan(index).points)))
            poses.append(T_lidar_world @ world.T_world_lidar(index) @ se3.inverse(turn))
        return Sample(voxelizer.voxelize(clouds), np.stack(poses))
